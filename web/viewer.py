"""The page of one viewer: panel, plots, camera and marks of their own, over what all share."""

import time
from collections.abc import Callable
from functools import partial
from typing import TYPE_CHECKING

import numpy as np
import viser

from gcs.contract.messages import Health, State
from gcs.contract.supervision import guarded
from web.boxing import Boxing
from web.camera import FOLLOW, ORBIT, TOP, Camera, modes
from web.look import colours, html
from web.look.handles import Follower, by_hand, set_value
from web.look.html import clock
from web.memory.boxed import boxed
from web.memory.claims import Claim
from web.memory.geometry import Rectangle, hit
from web.memory.lies import lies
from web.memory.residuals import others_then
from web.memory.timeline import LookBack
from web.panel import apart, events, legend, picked, place, player, sensors, status
from web.panel import boxed as in_box
from web.panel.bell import Bell
from web.panel.fleet import Fleet
from web.panel.limits import LimitsForm, alarms
from web.panel.player import Player
from web.plots.dock import Dock
from web.scene.ghost import Ghost
from web.scene.marks import Eye, Marks
from web.scene.names import GroundNames, drawn, hanging, things, together
from web.scene.paint import CHOICES
from web.scene.picture import LAYERS
from web.vehicle import SeenVehicle

if TYPE_CHECKING:
    from viser._messages import HotkeyKey as Key

    from web.view import View

PANEL_TICKS, PLOT_TICKS = 3, 10  # the panel is read by people: three times a second; plots once
PICK_PX = 10.0  # a click may miss by so much
NEAR_NS = 1_000_000_000  # what others said farther from a clicked outlier is not of that instant
NAMES = {
    "raw": "raw points",
    "sticks": "residual sticks",
    "sights": "lines of sight",
    "trust": "3σ, protection",
    "site": "ground picture",
}
PANEL_PX = 380


class Viewer:
    """Everything that belongs to one open page. All but the handles' callbacks runs in the view's thread."""

    def __init__(self, client: viser.ClientHandle, view: "View", vehicle: SeenVehicle):
        self._client, self._view = client, view
        self.vehicle, self._flight, self._picture = vehicle, vehicle.flight, vehicle.picture
        self.camera = Camera(client, self._flight.scene)
        self._marks = Marks(client.scene, self._flight)
        self._names = GroundNames(client.scene, self._flight.root)
        self._time = view.playback or LookBack(self._flight)
        self._ghost = Ghost(client.scene, self._flight)
        self._label: viser.LabelHandle | None = None  # of the outlier that was clicked
        self._hidden = {name for name, shown in LAYERS.items() if not shown}
        self._layers: dict[str, viser.FrameHandle] = {}
        self._tick, self._stood_ns = 0, 0
        self._root = client.scene.add_frame(self._flight.root, show_axes=False)  # the others stay hidden
        client.gui.set_panel_label("Ground station")
        client.gui.main_panel.dock_right()
        client.gui.main_panel.set_width(PANEL_PX)
        self._build()
        self._dock = Dock(client.gui, self._flight)
        self._boxing = Boxing(client, self._dock.box, lambda box: view.soon(partial(self._ask, box)))
        self._dock.box.on_click(guarded("view", lambda _: self._boxing.press()))
        self._add_keys()
        client.scene.on_click()(guarded("view", self._click))
        self.camera.update(None, self._picture.low, self._picture.high)
        self.camera.look()

    def refresh(self) -> None:
        """Bring the page up to date; ten times a second."""
        shown = self.shown()
        aircraft = np.array(shown.position_enu_m) if shown else None
        with self._client.atomic():
            self.camera.update(aircraft, self._picture.low, self._picture.high)
            if self._tick % PANEL_TICKS == 0 or self._sought():
                self._marks.update(Eye(self.camera.eye(), self.camera.pixel_rad()))
                self._haunt(shown)
                self._name_ground(shown)
                self._write(shown)
            if self._tick % PLOT_TICKS == 0:
                self._dock.update(self._time.now_ns)
        self._tick += 1

    def clear(self) -> None:
        """Forget what the flight has forgotten."""
        self._marks.clear()

    def leave(self) -> None:
        """Clear the page for another vehicle's."""
        self._marks.clear()
        self._ghost.clear()
        for name, layer in self._layers.items():
            layer.visible = LAYERS[name]  # whoever comes back finds it as the boxes say
        if self._label:
            self._label.remove()
        self._client.scene.remove_click_callback()
        self._client.scene.remove_rect_select_callback()
        self._root.visible = False
        self._client.gui.reset()

    def shown(self) -> State | None:
        """The state that this viewer sees: the newest, or the one looked back upon."""
        return self._flight.state_at(self._time.now_ns) if self._time.back else self._flight.state

    def _sought(self) -> bool:
        """Whether the page stands elsewhere than before: who seeks does not wait for the panel's turn."""
        before_ns, self._stood_ns = self._stood_ns, self._time.now_ns
        return self._time.back and not self._time.playing and self._stood_ns != before_ns

    def _build(self) -> None:
        gui, scene = self._client.gui, self._flight.scene
        gui.add_html(html.title(scene))
        self._fleet = Fleet(gui, self.vehicle.name, self._choose)
        self._head, self._go = gui.add_html(""), gui.add_html("")
        tabs = gui.add_tab_group()
        with tabs.add_tab("Flight"):
            self._numbers = gui.add_html("")
            self._form = gui.add_dropdown("position as", place.forms(scene))
            self._place, self._apart = gui.add_html(""), gui.add_html("")
            self._player = Player(gui, self._time, self._flight, lambda: self._level.value)
        with tabs.add_tab("Sensors"):
            self._sensors = gui.add_html("")
            with gui.add_folder("Systematic errors"):
                self._errors = gui.add_html("")
        with tabs.add_tab("Events"):
            self._level = gui.add_dropdown("show", tuple(events.LEVELS))
            self._log = gui.add_html("")
        with tabs.add_tab("Limits"):
            self._limits = LimitsForm(gui, self._view.limits, self._set_limit)
            self._bell = Bell(gui)
        with tabs.add_tab("Show"):
            self._add_show()

    def _add_show(self) -> None:
        gui = self._client.gui
        self._camera = gui.add_dropdown("camera", modes(self._flight.scene))
        by_hand(self._camera, self.camera.set_mode)
        gui.add_button("Reset view").on_click(guarded("view", lambda _: self.camera.look()))
        self._paint = gui.add_dropdown("track colour", CHOICES, initial_value=self._picture.paint)
        by_hand(self._paint, lambda choice: self._view.soon(partial(self._picture.set_paint, choice)))
        self._painted = Follower(self._paint)
        self._legend = gui.add_html("")
        self._boxes = {}
        for name in LAYERS:
            if (name == "other" and not self._flight.other) or (name == "site" and not self._picture.site):
                continue
            box = gui.add_checkbox(NAMES.get(name, name), name not in self._hidden)
            by_hand(box, self._switch(name))
            self._boxes[name] = box
        self._dark = gui.add_checkbox("dark", self._view.dark)
        self._darkened = Follower(self._dark)
        by_hand(self._dark, lambda dark: self._view.soon(partial(self._view.set_dark, dark=dark)))

    def _add_keys(self) -> None:
        press, look = self._player.press, self._set_camera
        keys: list[tuple[str, Key, Callable[[], None]]] = [
            ("Play or pause", "space", partial(press, player.PLAY)),
            ("Step back", "J", partial(press, player.BACK)),
            ("Step forward", "L", partial(press, player.FORTH)),
            ("Previous event", "pageup", partial(press, player.BEFORE)),
            ("Next event", "pagedown", partial(press, player.AFTER)),
            ("Return to now", "N", partial(press, player.NOW)),
            ("Camera: orbit", "O", partial(look, ORBIT)),
            ("Camera: follow the aircraft", "F", partial(look, FOLLOW)),
            ("Camera: from above", "T", partial(look, TOP)),
            ("Residual sticks", "S", partial(self._toggle, "sticks")),
            ("Outliers in a box", "B", self._boxing.press),
        ]
        numbers: tuple[Key, ...] = ("1", "2", "3", "4", "5", "6", "7", "8", "9")
        eyes = zip(modes(self._flight.scene)[3:], numbers, strict=False)
        keys += [(f"Camera: {mode}", key, partial(look, mode)) for mode, key in eyes]
        for label, key, act in keys:
            self._client.gui.add_command(label, hotkey=key).on_trigger(guarded("view", partial(_do, act)))

    def _write(self, shown: State | None) -> None:
        flight, view, stand = self._flight, self._view, self._time
        self._player.update()
        back, scene, mode = stand.back, flight.scene, self._player.mode()
        age_s = 0.0 if back else time.monotonic() - flight.arrived_s
        word, colour = status.badge(shown, age_s, mode)
        old = colour == colours.BAD
        self._head.content = status.head(scene, shown, word, colour, self._tick)
        health = flight.healths.at(stand.now_ns) if back else flight.health
        wind = flight.winds.at(stand.now_ns) if back else flight.wind
        self._judge(flight.state if stand.live else shown, flight.health if stand.live else health)
        self._numbers.content = status.numbers(shown, wind, old=old)
        self._place.content = place.block(scene, shown, self._form.value, old=old)
        self._apart.content = apart.block(flight.other, shown, old=old)
        health_s = time.monotonic() - flight.health_s if mode == "LIVE" else 0.0
        self._sensors.content = sensors.rows(scene, health, shown, view.limits, health_s)
        self._errors.content = sensors.errors(scene, health)
        self._log.content = events.listed(
            events.chosen(flight.moments, self._level.value, stand.now_ns), view.notes()
        )
        self._legend.content = legend.shown(
            scene, self._picture.aircraft.factor, self._picture.paint, self._picture.scale, flight.other
        )
        self._sync()
        flights = {name: one.flight if one else None for name, one in view.vehicles.items()}
        self._fleet.update(flights, view.limits, self.vehicle.name)

    def _judge(self, state: State | None, health: Health | None) -> None:
        """What is against the flight. Live it is of now, also for who looks back."""
        limits = self._view.limits
        found = alarms(limits, state, health) if state else []
        lying = lies(self._flight, state.t_ns) if state else []
        texts = [f"{lie.text} since {clock(lie.since_ns)}" for lie in lying]
        self._go.content = status.go(found, texts, demanded=limits.demanded) if state else ""
        self._bell.update(len(found))

    def _sync(self) -> None:
        """Show what another viewer has set for all."""
        self._limits.sync(self._view.limits)
        self._painted.follow(self._picture.paint)
        self._darkened.follow(self._view.dark)

    def _haunt(self, shown: State | None) -> None:
        if self._time.back and shown:
            self._ghost.show(shown, self.camera.eye(), dark=self._view.dark)
        else:
            self._ghost.clear()

    def _name_ground(self, shown: State | None) -> None:
        """Show the names on the ground that are in nobody's way."""
        lens = self.camera.lens()
        called = self._ghost.called if self._time.back else self.vehicle.name
        clicked = [hanging(one.text, np.array(one.position), lens) for one in (self._label,) if one]
        taken = together(things(self._flight.scene, shown, called, lens), *clicked)
        outliers = [piece.places for piece in self._marks.pieces()]
        self._names.update(lens, drawn(self._flight.newest.view["position_enu_m"], outliers, lens), taken)

    def _click(self, event: viser.SceneClickEvent) -> None:
        origin = np.array(event.ray_origin) - self.camera.offset
        within = PICK_PX * self.camera.pixel_rad()
        pending = [c for c in self._flight.claims.pending() if c.refused and c.position]
        outliers = [*self._flight.outliers, *pending] if "outliers" not in self._hidden else []
        found = hit(origin, event.ray_direction, np.array([c.position for c in outliers]), within)
        if found is not None:
            self._view.soon(partial(self._pick, outliers[found]))
            return
        rows = self._flight.newest.view
        found = hit(origin, event.ray_direction, rows["position_enu_m"], within)
        if found is not None:
            self._time.seek(int(rows["t_ns"][found]))

    def _pick(self, claim: Claim) -> None:
        others = others_then(self._flight.residuals, self._flight.claims.pending(), claim, NEAR_NS)
        self._dock.pick(claim, picked.story(claim, others))
        name, place_m = f"{self._flight.root}/outliers/picked", claim.position or (0, 0, 0)
        self._label = self._client.scene.add_label(name, f"{claim.kind} · {claim.sensor}", position=place_m)

    def _ask(self, box: Rectangle) -> None:
        """Tell of the outliers that this viewer sees in a box."""
        found = boxed(self._flight, lambda places: box.holds(self.camera.on_picture(places)))
        self._dock.tell(in_box.story(found))

    def _show(self, layer: str, *, shown: bool) -> None:
        (self._hidden.discard if shown else self._hidden.add)(layer)
        if layer not in self._layers:
            self._layers[layer] = self._client.scene.add_frame(
                f"{self._flight.root}/{layer}", show_axes=False
            )
        self._layers[layer].visible = shown

    def _switch(self, layer: str) -> Callable[[bool], None]:
        return lambda shown: self._show(layer, shown=shown)

    def _toggle(self, layer: str) -> None:
        shown = layer in self._hidden
        set_value(self._boxes[layer], shown)
        self._show(layer, shown=shown)

    def _set_camera(self, mode: str) -> None:
        set_value(self._camera, mode)
        self.camera.set_mode(mode)

    def _set_limit(self, name: str, value: float) -> None:
        self._view.limits = self._view.limits._replace(**{name: value})

    def _choose(self, vehicle: str) -> None:
        self._view.soon(partial(self._view.look_at, self._client, vehicle))


def _do(act: Callable[[], None], _event: object) -> None:
    act()
