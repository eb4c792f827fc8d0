"""The aircraft as it was, in the page of one viewer who looks back."""

import numpy as np
import viser

from gcs.contract.messages import State
from web.memory.flight import SeenFlight
from web.scene.aircraft import OF_NOW, THEN, Aircraft


class Ghost:
    """Takes the place of what is of now, as long as there is a state to show."""

    def __init__(self, api: viser.SceneApi, flight: SeenFlight):
        self._api, self._flight = api, flight
        self._drawn: Aircraft | None = None
        self._now: list[viser.FrameHandle] = []  # this viewer's, in place of those that all share

    @property
    def called(self) -> str:
        """Its name in the picture; when, the panel's clock says: a longer name runs into others."""
        return f"{self._flight.scene.vehicle} then"

    def show(self, state: State, eye: np.ndarray, *, dark: bool) -> None:
        """Show ``state``, sized for an eye (3,) there."""
        if self._drawn is None:
            self._drawn = Aircraft(self._api, self._flight.root, self.called, THEN)
            self._see_now(seen=False)
        self._drawn.set_dark(dark=dark)
        self._drawn.move(state, float(np.linalg.norm(eye - np.array(state.position_enu_m))))

    def clear(self) -> None:
        if self._drawn:
            self._drawn.remove()
            self._drawn = None
            self._see_now(seen=True)

    def _see_now(self, *, seen: bool) -> None:
        if not self._now:
            root = self._flight.root
            self._now = [self._api.add_frame(f"{root}/{path}", show_axes=False) for path in OF_NOW]
        for frame in self._now:
            frame.visible = seen
