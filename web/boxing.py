"""The box that one viewer draws over the picture, to ask of the outliers in it."""

from collections.abc import Callable

import viser

from gcs.contract.supervision import guarded
from web.memory.geometry import Rectangle
from web.plots.dock import BOX

WAITING = "Drag a box; press again to leave"


class Boxing:
    """A press begins it; a box or another press ends it. Until then a drag does not turn the camera."""

    def __init__(
        self, client: viser.ClientHandle, button: viser.GuiButtonHandle, drawn: Callable[[Rectangle], None]
    ):
        self._scene, self._button, self._drawn = client.scene, button, drawn
        self.waiting = False

    def press(self) -> None:
        self._wait(waiting=not self.waiting)

    def _wait(self, *, waiting: bool) -> None:
        self.waiting = waiting
        self._button.label = WAITING if waiting else BOX
        if waiting:
            self._scene.on_rect_select()(guarded("view", self._draw))
        else:
            self._scene.remove_rect_select_callback()

    def _draw(self, event: viser.SceneRectSelectEvent) -> None:
        self._wait(waiting=False)
        self._drawn(Rectangle(*event.screen_min, *event.screen_max))
