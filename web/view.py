"""The view in the browser, itself a sink: messages in, a page on the loopback interface out.

``View.put`` may be called from any thread and returns at once; one thread draws ten times a second.
The page has no password: it binds to 127.0.0.1 only, put a proxy in front for anything wider.
"""

import contextlib
import io
import threading
from collections import deque
from collections.abc import Callable, Collection, Iterable, Iterator
from functools import partial

import viser

from gcs.contract.messages import ANY, InputError, Scene
from gcs.contract.supervision import Part, brief, log
from web.look import colours
from web.memory.flight import SeenFlight
from web.memory.other import Geodetic
from web.memory.site import GroundPicture
from web.memory.timeline import Playable, Rewind
from web.origins import only
from web.panel.fleet import worst
from web.panel.limits import OperatorLimits
from web.scene.picture import Picture
from web.vehicle import SeenVehicle
from web.viewer import Viewer

PERIOD_S = 0.1
UNSEEN_TICKS, UNSEEN_MOST = 30, 1_000  # a picture that nobody looks at is drawn every so many turns or claims
NEAR_M, FAR_M, FOV = 1.0, 100_000.0, 0.9  # of the first camera


class ViewError(InputError):
    """The view cannot open; the message says what to do."""


class View:
    """A page for any number of viewers. With ``playback`` they also steer a replay.

    ``other`` is another course of the same flight, to be laid beside it; ``ground`` a picture, below all.
    """

    def __init__(
        self,
        scene: Scene,
        *,
        port: int = 8080,
        playback: Playable | None = None,
        origins: Collection[str] = (),
        other: Geodetic | None = None,
        ground: GroundPicture | None = None,
    ):
        with _hush(), only(port, origins):
            self._server = viser.ViserServer(host="127.0.0.1", port=port, label="gcs", verbose=False)
        if self._server.get_port() != port:  # viser quietly takes the next free one
            self._stop_server()
            raise ViewError(f"port {port} is in use: stop the program that holds it, or take another port")
        self.url = f"http://127.0.0.1:{port}"
        self.limits, self._ground = OperatorLimits(), ground
        self.dark = False
        self._todo: deque[Callable[[], None]] = deque()
        self._tick = 0
        self._failures: deque[str] = deque(maxlen=3)
        self._viewers: dict[int, Viewer] = {}
        self._stop = threading.Event()
        scenery = self._server.scene
        scenery.set_up_direction("+z")
        scenery.configure_environment_map(None)  # that and shadows take seconds before the first picture
        scenery.configure_default_lights(cast_shadow=False)
        scenery.add_light_ambient("/light", intensity=1.2)
        camera = self._server.initial_camera
        camera.near, camera.far, camera.fov = NEAR_M, FAR_M, FOV
        self.vehicles: dict[str, SeenVehicle | None] = {}  # None: its station has not been heard
        self.add(scene, other)
        self.playback = Rewind(playback, self.flight) if playback else None
        self.set_dark(dark=False)
        self._server.on_client_connect(lambda client: self.soon(lambda: self._welcome(client)))
        self._server.on_client_disconnect(lambda client: self.soon(lambda: self._leave(client)))
        self.part = Part("view", self._run, self._stop)
        self.part.start()

    @property
    def seen(self) -> list[SeenVehicle]:
        """The vehicles whose stations have been heard."""
        return [vehicle for vehicle in list(self.vehicles.values()) if vehicle]

    @property
    def flight(self) -> SeenFlight:
        """Of the first vehicle."""
        return self.seen[0].flight

    @property
    def picture(self) -> Picture:
        """Of the first vehicle."""
        return self.seen[0].picture

    def expect(self, names: Iterable[str]) -> None:
        """List vehicles that may not have been heard yet; each is shown once ``add`` brings its scene."""
        self.vehicles = {name: self.vehicles.get(name) for name in (*names, *self.vehicles)}

    def add(self, scene: Scene, other: Geodetic | None = None) -> None:
        """Show a vehicle; one that is shown already stays as it is."""
        if not self.vehicles.get(scene.vehicle):
            vehicle = SeenVehicle(self._server, scene, other, self._ground)
            vehicle.picture.set_dark(dark=self.dark)
            self.vehicles = self.vehicles | {scene.vehicle: vehicle}

    def put(self, message: ANY, source: str = "", vehicle: str = "") -> None:
        """Show a message. ``source`` is "smoothed" for a smoothed state; any thread may call.

        ``vehicle`` is whose it is, the first one's where it is left out.
        """
        whose = self.vehicles[vehicle] if vehicle else self.seen[0]
        if whose:
            whose.put(message, source)

    def clear(self) -> None:
        """Forget the first one's flight, as after a seek backwards; what follows starts a new one."""
        self.seen[0].clear()

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
            control_width="large",
            dark_mode=dark,
            show_logo=False,
            show_share_button=False,
            brand_color=colours.BRAND,
        )
        for vehicle in self.seen:
            vehicle.picture.set_dark(dark=dark)

    def look_at(self, client: viser.ClientHandle, name: str) -> None:
        """Give a viewer the page of another vehicle."""
        before, vehicle = self._viewers.get(client.client_id), self.vehicles.get(name)
        if before and vehicle and vehicle is not before.vehicle:
            before.leave()
            self._viewers[client.client_id] = Viewer(client, self, vehicle)

    def notes(self) -> list[str]:
        """What the page has to say of itself."""
        count = sum(vehicle.skipped for vehicle in self.seen)
        skipped = f"the view skipped {count} messages: data come faster than it draws"
        return ([skipped] if count else []) + list(self._failures)

    def _stop_server(self) -> None:
        with _hush():
            self._server.stop()

    def _welcome(self, client: viser.ClientHandle) -> None:
        heard = {vehicle.name: vehicle for vehicle in self.seen}
        first = worst({name: vehicle.flight for name, vehicle in heard.items()}, self.limits)
        self._viewers[client.client_id] = Viewer(client, self, heard[first])

    def _leave(self, client: viser.ClientHandle) -> None:
        self._viewers.pop(client.client_id, None)

    def _run(self, stop: threading.Event) -> None:
        while not stop.wait(PERIOD_S):
            self._tick += 1
            for step in self._steps():
                try:
                    step()
                except Exception as error:  # whatever fails, the rest of the page goes on and says so
                    self._fail(error)

    def _steps(self) -> Iterator[Callable[[], None]]:
        """One turn of the page; what one vehicle or one viewer breaks is not the others' matter."""
        for vehicle in self.seen:
            yield partial(self._take_all, vehicle)
        yield self._act
        if self.playback:
            yield self.playback.step
        for vehicle in self.seen:
            yield partial(self._draw, vehicle)
        for viewer in list(self._viewers.values()):
            yield viewer.refresh

    def _fail(self, error: Exception) -> None:
        line = f"the page failed to draw something: {brief(error)}"
        if line not in self._failures:
            self._failures.append(line)
            log.error("view: %s", line, exc_info=error)

    def _take_all(self, vehicle: SeenVehicle) -> None:
        if vehicle.take_all():
            for viewer in self._at(vehicle):
                viewer.clear()

    def _act(self) -> None:
        for _ in range(len(self._todo)):
            self._todo.popleft()()

    def _draw(self, vehicle: SeenVehicle) -> None:
        eyes = [viewer.camera.eye() for viewer in self._at(vehicle)]
        piled = vehicle.flight.piled > UNSEEN_MOST  # a replay at full speed would heap up memory
        if eyes or piled or self._tick % UNSEEN_TICKS == 0:
            vehicle.picture.update(vehicle.flight.state, eyes)

    def _at(self, vehicle: SeenVehicle) -> list[Viewer]:
        """Who looks at it."""
        return [viewer for viewer in self._viewers.values() if viewer.vehicle is vehicle]


def _hush() -> contextlib.redirect_stdout:
    """viser prints its address and its end; where the page is, the command says."""
    return contextlib.redirect_stdout(io.StringIO())
