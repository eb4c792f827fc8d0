"""One vehicle on the page: what came in of it, what is kept of its flight, and its picture."""

from collections import deque

import viser

from gcs.contract.frames import frame_of
from gcs.contract.messages import ANY, Scene
from web.memory.flight import SeenFlight
from web.memory.other import Geodetic, OtherTrack
from web.memory.site import GroundPicture, laid
from web.scene.picture import Picture

QUEUE = 200_000  # messages; at more than a million a minute the oldest are skipped, counted and shown


class SeenVehicle:
    """``put`` may be called from any thread; all else runs in the one that draws."""

    def __init__(
        self,
        server: viser.ViserServer,
        scene: Scene,
        other: Geodetic | None = None,
        ground: GroundPicture | None = None,
    ):
        self.flight = SeenFlight(scene, OtherTrack(other, scene) if other else None)
        self.picture = Picture(server, self.flight, laid(ground, frame_of(scene)) if ground else None)
        self.skipped = 0
        self._queue: deque = deque(maxlen=QUEUE)

    @property
    def name(self) -> str:
        return self.flight.scene.vehicle

    @property
    def waiting(self) -> int:
        """Messages that came and are not taken in yet."""
        return len(self._queue)

    def put(self, message: ANY, source: str) -> None:
        if len(self._queue) == QUEUE:
            self.skipped += 1
        self._queue.append((message, source))

    def clear(self) -> None:
        """Forget the flight, what waits of it too."""
        self._queue.clear()
        self._queue.append((None, ""))

    def take_all(self) -> bool:
        """Take what waits; whether the flight was forgotten."""
        forgotten = False
        for _ in range(len(self._queue)):
            message, source = self._queue.popleft()
            if message is None:
                self.flight.clear()
                self.picture.clear()
                forgotten = True
            else:
                self.flight.take(message, source)
        self.flight.settle()
        return forgotten
