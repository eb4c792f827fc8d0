"""The view alone, on the bus: a plain subscriber of one vehicle's station or of several."""

import threading
from collections.abc import Callable, Collection, Mapping
from typing import TYPE_CHECKING

from gcs.contract.messages import Scene
from web.memory.other import Geodetic
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
) -> None:
    """Wait for the ``Scene`` of a station, then show all until ``stop``; ``buses`` by vehicle.

    ``opened`` is told the page's address; ``other`` is a course to lay beside the first vehicle's flight.
    """
    heard = [Heard(name, bus) for name, bus in buses.items()]
    wait_s = WAIT_S / len(heard)
    first = None
    while first is None and not stop.is_set():
        first = next((scene for one in heard if (scene := one.scene(wait_s))), None)
    if first is None:
        return
    view = View(first, port=port, origins=origins, other=other if first.vehicle == heard[0].name else None)
    view.expect(buses)
    opened(view.url)
    try:
        while not stop.is_set():
            for one in heard:
                if view.vehicles[one.name]:
                    one.hand_on(view, wait_s)
                elif scene := one.scene(wait_s):
                    view.add(scene, other if one is heard[0] else None)
    finally:
        view.close()
