"""The view alone, on the bus: a plain subscriber of one vehicle's station or of several."""

import threading
from collections.abc import Callable, Collection, Iterable, Mapping
from typing import TYPE_CHECKING

from gcs.contract.messages import Scene
from web.memory.other import Geodetic
from web.memory.site import GroundPicture
from web.view import View

if TYPE_CHECKING:  # zenoh is loaded by whoever opens the bus
    from gcs.contract.wire.bus import Bus

WAIT_S = 0.05  # for the messages of all vehicles together


class Heard:
    """What comes of one vehicle."""

    def __init__(self, name: str, bus: "Bus"):
        self.name = name
        self._scenes, self._smoothed = bus.subscribe("scene"), bus.subscribe("smoothed")
        self._rest = bus.subscribe("state", "verdict/*", "wind", "health", "event")

    def scene(self, wait_s: float) -> Scene | None:
        """What stands still, once its station has said so."""
        found = [message for _, message in self._scenes.drain(wait_s) if isinstance(message, Scene)]
        return found[0] if found else None

    def hand_on(self, view: View, wait_s: float) -> None:
        for _, message in self._rest.drain(wait_s):
            view.put(message, vehicle=self.name)
        for _, message in self._smoothed.drain(0.0):
            view.put(message, "smoothed", self.name)


def run(
    buses: Mapping[str, "Bus"],
    port: int,
    stop: threading.Event,
    opened: Callable[[str], None],
    *,
    origins: Collection[str] = (),
    other: Geodetic | None = None,
    ground: GroundPicture | None = None,
    more: Callable[[], Iterable[tuple[str, "Bus"]]] = tuple,
) -> None:
    """Wait for the ``Scene`` of a station, then show all until ``stop``; ``buses`` by vehicle.

    ``opened`` is told the page's address; ``other`` is a course to lay beside the first vehicle's flight,
    ``ground`` a picture. ``more`` gives vehicles that have come since it was asked last.
    """
    heard = [Heard(name, bus) for name, bus in buses.items()]
    first = None
    while first is None and not stop.is_set():
        heard += [Heard(name, bus) for name, bus in more()]
        if not heard:
            stop.wait(WAIT_S)
        first = next((scene for one in heard if (scene := one.scene(WAIT_S / len(heard)))), None)
    if first is None:
        return
    beside = other if first.vehicle == heard[0].name else None
    view = View(first, port=port, origins=origins, other=beside, ground=ground)
    view.expect([one.name for one in heard])
    opened(view.url)
    try:
        while not stop.is_set():
            for name, bus in more():
                heard.append(Heard(name, bus))
                view.expect([one.name for one in heard])
            for one in heard:
                if view.vehicles[one.name]:
                    one.hand_on(view, WAIT_S / len(heard))
                elif scene := one.scene(WAIT_S / len(heard)):
                    view.add(scene, other if one is heard[0] else None)
    finally:
        view.close()
