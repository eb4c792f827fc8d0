"""The view in the browser, itself a sink: messages in, a page on the loopback interface out.

``View.put`` may be called from any thread and returns at once; one thread draws ten times a second.
The page has no password: it binds to 127.0.0.1 only, put a proxy in front for anything wider.
"""

import contextlib
import io
import threading
from collections import deque
from collections.abc import Callable, Collection
from typing import TYPE_CHECKING

import viser

from gcs.contract.messages import ANY, InputError, Scene
from gcs.contract.supervision import Part, brief, log
from web.memory.flight import SeenFlight
from web.memory.other import Geodetic, OtherTrack
from web.origins import only
from web.panel.limits import OperatorLimits
from web.panel.player import Playable
from web.scene.picture import Picture
from web.viewer import Viewer

if TYPE_CHECKING:  # zenoh is loaded by whoever opens the bus
    from gcs.contract.wire.bus import Bus

QUEUE = 200_000  # messages; at more than a million a minute the oldest are skipped, counted and shown
PERIOD_S = 0.1
NEAR_M, FAR_M, FOV = 1.0, 100_000.0, 0.9  # of the first camera


class ViewError(InputError):
    """The view cannot open; the message says what to do."""


class View:
    """A page for any number of viewers. With ``playback`` they also steer a replay.

    ``other`` is another course of the same flight, to be laid beside it.
    """

    def __init__(
        self,
        scene: Scene,
        *,
        port: int = 8080,
        playback: Playable | None = None,
        origins: Collection[str] = (),
        other: Geodetic | None = None,
    ):
        with _hush(), only(port, origins):
            self._server = viser.ViserServer(host="127.0.0.1", port=port, label="gcs", verbose=False)
        if self._server.get_port() != port:  # viser quietly takes the next free one
            self._stop_server()
            raise ViewError(f"port {port} is in use: stop the program that holds it, or take another port")
        self.url = f"http://127.0.0.1:{port}"
        self.flight = SeenFlight(scene, OtherTrack(other, scene) if other else None)
        self.playback, self.limits = playback, OperatorLimits()
        self.dark = False
        self._queue: deque = deque(maxlen=QUEUE)
        self._todo: deque[Callable[[], None]] = deque()
        self._skipped = 0
        self._failures: deque[str] = deque(maxlen=3)
        self._viewers: dict[int, Viewer] = {}
        self._stop = threading.Event()
        self._server.scene.set_up_direction("+z")
        camera = self._server.initial_camera
        camera.near, camera.far, camera.fov = NEAR_M, FAR_M, FOV
        self.picture = Picture(self._server, self.flight)
        self.set_dark(dark=False)
        self._server.on_client_connect(lambda client: self.soon(lambda: self._welcome(client)))
        self._server.on_client_disconnect(lambda client: self.soon(lambda: self._leave(client)))
        self.part = Part("view", self._run, self._stop)
        self.part.start()

    def put(self, message: ANY, source: str = "") -> None:
        """Show a message. ``source`` is "smoothed" for a smoothed state; any thread may call."""
        if len(self._queue) == QUEUE:
            self._skipped += 1
        self._queue.append((message, source))

    def clear(self) -> None:
        """Forget the flight, for example after a seek backwards; what follows starts a new one."""
        self._queue.clear()
        self._queue.append((None, "clear"))

    def close(self) -> None:
        self._stop.set()
        self.part.join()
        self._stop_server()

    def soon(self, act: Callable[[], None]) -> None:
        """Do it in the thread that draws."""
        self._todo.append(act)

    def set_dark(self, *, dark: bool) -> None:
        self.dark = dark
        self._server.gui.configure_theme(
            control_width="large", dark_mode=dark, show_logo=False, show_share_button=False
        )
        self.picture.set_dark(dark=dark)

    def notes(self) -> list[str]:
        """What the page has to say of itself."""
        skipped = f"the view skipped {self._skipped} messages: data come faster than it draws"
        return ([skipped] if self._skipped else []) + list(self._failures)

    def _stop_server(self) -> None:
        with _hush():
            self._server.stop()

    def _welcome(self, client: viser.ClientHandle) -> None:
        self._viewers[client.client_id] = Viewer(client, self)

    def _leave(self, client: viser.ClientHandle) -> None:
        self._viewers.pop(client.client_id, None)

    def _run(self, stop: threading.Event) -> None:
        while not stop.wait(PERIOD_S):
            for step in (self._take_all, self._act, self._draw, *self._refreshers()):
                try:
                    step()
                except Exception as error:  # whatever fails, the rest of the page goes on and says so
                    self._fail(error)

    def _fail(self, error: Exception) -> None:
        line = f"the page failed to draw something: {brief(error)}"
        if line not in self._failures:
            self._failures.append(line)
            log.error("view: %s", line, exc_info=error)

    def _take_all(self) -> None:
        for _ in range(len(self._queue)):
            message, source = self._queue.popleft()
            if message is None:
                self.flight.clear()
                self.picture.clear()
                for viewer in self._viewers.values():
                    viewer.clear()
            else:
                self.flight.take(message, source)
        self.flight.settle()

    def _act(self) -> None:
        for _ in range(len(self._todo)):
            self._todo.popleft()()

    def _draw(self) -> None:
        eyes = [viewer.camera.eye() for viewer in self._viewers.values()]
        self.picture.update(self.flight.state, eyes)

    def _refreshers(self) -> list[Callable[[], None]]:
        return [viewer.refresh for viewer in self._viewers.values()]


def _hush() -> contextlib.redirect_stdout:
    """viser prints its address and its end; where the page is, the command says."""
    return contextlib.redirect_stdout(io.StringIO())


def run(
    bus: "Bus",
    port: int,
    stop: threading.Event,
    opened: Callable[[str], None],
    *,
    origins: Collection[str] = (),
    other: Geodetic | None = None,
) -> None:
    """The view alone, on the bus: waits for the station's ``Scene``, then shows all until ``stop``.

    ``opened`` is told the page's address; ``other`` is a course to lay beside the flight.
    """
    scenes, smoothed = bus.subscribe("scene"), bus.subscribe("smoothed")
    rest = bus.subscribe("state", "verdict/*", "wind", "health", "event")
    scene = None
    while scene is None and not stop.is_set():
        scene = next((message for _, message in scenes.drain(0.5) if isinstance(message, Scene)), None)
    if scene is None:
        return
    view = View(scene, port=port, origins=origins, other=other)
    opened(view.url)
    try:
        while not stop.is_set():
            for _, message in rest.drain(0.05):
                view.put(message)
            for _, message in smoothed.drain(0.0):
                view.put(message, "smoothed")
    finally:
        view.close()
