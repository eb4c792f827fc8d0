"""The view in the browser, itself a sink: messages in, a page on the loopback interface out.

``View.put`` may be called from any thread and returns at once; one thread draws ten times a second.
The page has no password: it binds to 127.0.0.1 only, put a proxy in front for anything wider.
"""

import contextlib
import io
import threading
import time
from collections import deque
from collections.abc import Collection
from functools import partial
from typing import TYPE_CHECKING

import viser

from gcs.contract.messages import ANY, Event, Health, InputError, Scene, State, Verdict, Wind
from gcs.contract.supervision import Part
from web import colours, panel
from web.controls import Playable, Player
from web.origins import only
from web.scene import LAYERS, Picture

if TYPE_CHECKING:  # zenoh is loaded by whoever opens the bus
    from gcs.contract.bus import Bus

QUEUE = 200_000  # messages; at more than a million a minute the oldest are skipped, counted and shown
PERIOD_S = 0.1
PANEL_PERIODS = 3  # the panel is read by people: three times a second is enough
EVENTS = 3
NAMES = {"sight": "lines of sight", "ellipsoid": "3σ ellipsoid", "raw": "raw points"}


class ViewError(InputError):
    """The view cannot open; the message says what to do."""


class View:
    """A page with the picture and the panel. With ``playback`` it also steers a replay."""

    def __init__(
        self,
        scene: Scene,
        *,
        port: int = 8080,
        playback: Playable | None = None,
        origins: Collection[str] = (),
    ):
        with _hush(), only(port, origins):
            self._server = viser.ViserServer(host="127.0.0.1", port=port, label="gcs", verbose=False)
        if self._server.get_port() != port:  # viser quietly takes the next free one
            self._stop_server()
            raise ViewError(f"port {port} is in use: stop the program that holds it, or take another port")
        self.url = f"http://127.0.0.1:{port}"
        self._scene = scene
        self._queue: deque = deque(maxlen=QUEUE)
        self._skipped = 0
        self._state: State | None = None
        self._arrived_s = 0.0
        self._health: Health | None = None
        self._wind: Wind | None = None
        self._events: deque[Event] = deque(maxlen=EVENTS)
        self._stop = threading.Event()
        self._set_stage()
        self._picture = Picture(self._server, scene)
        self._theme(dark=False)
        self._build_panel(playback)
        self._server.on_client_connect(self._picture.cameras.look)
        self.part = Part("view", self._run, self._stop)  # drawing that fails is logged, and goes on
        self.part.start()

    def put(self, message: ANY, source: str = "") -> None:
        """Show a message. ``source`` is "smoothed" for a smoothed state; any thread may call."""
        if len(self._queue) == QUEUE:
            self._skipped += 1
        self._queue.append((message, source))

    def clear(self) -> None:
        """Forget the trails, for example after a seek backwards; what follows starts new ones."""
        self._queue.clear()
        self._queue.append((None, "clear"))

    def close(self) -> None:
        self._stop.set()
        self.part.join()
        self._stop_server()

    def _stop_server(self) -> None:
        with _hush():
            self._server.stop()

    def _set_stage(self) -> None:
        self._server.scene.set_up_direction("+z")
        self._server.gui.set_panel_label("Ground station")
        self._server.gui.main_panel.dock_right()

    def _theme(self, *, dark: bool) -> None:
        self._server.gui.configure_theme(
            control_width="large",
            dark_mode=dark,
            show_logo=False,
            show_share_button=False,
        )
        self._picture.aircraft.set_dark(dark=dark)

    def _build_panel(self, playback: Playable | None) -> None:
        gui = self._server.gui
        gui.add_html(panel.title(self._scene))
        self._status = gui.add_html("")
        self._player = Player(gui, playback) if playback else None
        with gui.add_folder("Sensors"):
            self._sensors = gui.add_html("")
        with gui.add_folder("Events"):
            self._log = gui.add_html("")
        with gui.add_folder("Show"):
            self._legend = gui.add_html("")
            gui.add_button("Reset view").on_click(self._reset_view)
            gui.add_checkbox("follow aircraft", False).on_update(
                lambda event: self._picture.cameras.set_follow(follow=event.target.value)
            )
            for name in LAYERS:
                box = gui.add_checkbox(NAMES.get(name, name), True)
                box.on_update(partial(self._show, name))
            gui.add_checkbox("dark", False).on_update(lambda event: self._theme(dark=event.target.value))

    def _reset_view(self, event: viser.GuiEvent) -> None:
        if event.client:
            self._picture.cameras.look(event.client)

    def _show(self, layer: str, event: viser.GuiEvent) -> None:
        self._picture.layers[layer].visible = event.target.value

    def _run(self, stop: threading.Event) -> None:
        tick = 0
        while not stop.wait(PERIOD_S):
            for _ in range(len(self._queue)):
                self._take(*self._queue.popleft())
            self._picture.update()
            if tick % PANEL_PERIODS == 0:
                self._write_panel(tick)
            tick += 1

    def _take(self, message, source: str) -> None:
        match message:
            case None:
                self._picture.clear()
                self._events.clear()
                self._wind = None
            case Wind():
                self._wind = message
            case Health():
                self._health = message
            case Event():
                self._events.append(message)
            case State() | Verdict():
                self._picture.take(message, source)
        if isinstance(message, State) and source != "smoothed":
            self._state, self._arrived_s = message, time.monotonic()

    def _write_panel(self, tick: int) -> None:
        if self._player:
            self._player.update()
        mode = self._player.mode() if self._player else "LIVE"
        age_s = time.monotonic() - self._arrived_s
        word, colour = panel.badge(self._state, age_s, mode)
        stale = colour == colours.BAD
        self._picture.aircraft.say(f"{self._scene.vehicle} · {word}" if stale else self._scene.vehicle)
        self._status.content = panel.status(self._scene, self._state, self._wind, word, colour, tick)
        self._sensors.content = panel.sensors(self._scene, self._health, self._state)
        self._legend.content = panel.legend(self._scene, self._picture.aircraft.factor)
        self._log.content = panel.events(list(self._events), self._skipped)


def _hush() -> contextlib.redirect_stdout:
    """viser prints its address and its end; where the page is, the command says."""
    return contextlib.redirect_stdout(io.StringIO())


def run(bus: "Bus", port: int = 8080, stop: threading.Event | None = None) -> None:
    """The view alone, on the bus: waits for the station's ``Scene``, then shows all until ``stop``."""
    stop = stop or threading.Event()
    scenes, smoothed = bus.subscribe("scene"), bus.subscribe("smoothed")
    rest = bus.subscribe("state", "verdict/*", "wind", "health", "event")
    scene = None
    while scene is None and not stop.is_set():
        scene = next((message for _, message in scenes.drain(0.5) if isinstance(message, Scene)), None)
    if scene is None:
        return
    view = View(scene, port=port)
    try:
        while not stop.is_set():
            for _, message in rest.drain(0.05):
                view.put(message)
            for _, message in smoothed.drain(0.0):
                view.put(message, "smoothed")
    finally:
        view.close()
