"""The 3-D picture: where it flew, what the sensors saw, what was refused."""

from collections import defaultdict

import numpy as np
import viser

from gcs.contract.messages import Scene, State, Verdict
from web import colours, glyphs
from web.aircraft import Aircraft
from web.camera import Cameras
from web.claims import ACCEPTED, MISPLACED, Claims
from web.colours import Colour
from web.ground import draw_ground, draw_instrument
from web.lines import Lines
from web.trail import Trail, crosses, dots, line

LAYERS = ("raw", "filtered", "smoothed", "outliers", "sight", "ellipsoid")
STEP_NS = 100_000_000  # trajectories are drawn ten times a second of flight; finer cannot be seen
BREAK_NS = 5_000_000_000  # a longer gap is not bridged by a straight line
FRESH_NS = 2_000_000_000  # a line of sight goes this long after the instrument's last claim
DOT_M = 1.6  # least width of a raw point
INSTRUMENT, DOT = 0.045, 0.0016  # sizes as a share of the camera's distance
CROSS = 2.5  # half-width of an outlier's cross, in raw points


class Picture:
    """Takes messages, keeps the trails, draws them on ``update``."""

    def __init__(self, server: viser.ViserServer, scene: Scene):
        self._server, self._scene = server, scene
        self._colours = colours.of_sensors(scene)
        self.cameras = Cameras(server)
        self.layers = {name: server.scene.add_frame(f"/world/{name}", show_axes=False) for name in LAYERS}
        self._lines = Lines(server.scene)
        draw_ground(server.scene, self._lines)
        self._glyphs = []
        for instrument in scene.instruments:
            self._glyphs.append(draw_instrument(server.scene, instrument, self._colours[instrument.name]))
            self.cameras.include(instrument.position_enu_m)
        self.aircraft = Aircraft(server.scene, scene.vehicle)
        self._dot_m = DOT_M
        self._filtered = Trail("/world/filtered", line, self._lines.drawer(colours.FILTERED, 4.0))
        self._smoothed = Trail("/world/smoothed", line, self._lines.drawer(colours.SMOOTHED, 2.0))
        self._misplaced = Trail(
            "/world/outliers/misplaced", self._crosses, self._lines.drawer(colours.OUTLIER, 1.3)
        )
        self._misjudged = self._dots("outliers/misjudged", colours.OUTLIER)
        self._raw: dict[str, Trail] = {}  # by sensor
        self._claims = Claims(lambda sensor, position, kind: self._trail(sensor, kind).add(position))
        self._state: State | None = None
        self._drawn: dict[Trail, State] = {}  # the newest state on each line

    def take(self, message: State | Verdict, source: str) -> None:
        if isinstance(message, Verdict):
            self._claims.take(message)
        elif source == "smoothed":
            self._extend(self._smoothed, message)
        else:
            self._extend(self._filtered, message)
            self._state = message

    def update(self) -> None:
        """Draw what changed."""
        self._claims.settle()
        with self._server.atomic():
            if self._state:
                self._move(self._state)
            pending = defaultdict(list)
            for sensor, position, kind in self._claims.pending():
                pending[self._trail(sensor, kind)].append(position)
            for trail in self._trails():
                trail.update(pending[trail])

    def clear(self) -> None:
        for trail in self._trails():
            trail.clear()
        self._claims.clear()
        self._drawn.clear()

    def _extend(self, trail: Trail, state: State) -> None:
        last = self._drawn.get(trail, state)
        gap_ns = state.t_ns - last.t_ns
        if state.reset_counter != last.reset_counter or not 0 <= gap_ns < BREAK_NS:
            trail.cut()
        elif 0 < gap_ns < STEP_NS:
            return
        trail.add(state.position_enu_m)
        self._drawn[trail] = state
        self.cameras.include(state.position_enu_m)

    def _trails(self) -> list[Trail]:
        return [self._filtered, self._smoothed, self._misplaced, self._misjudged, *self._raw.values()]

    def _trail(self, sensor: str, kind: str) -> Trail:
        """Where a claim of that kind is drawn."""
        if kind != ACCEPTED:
            return self._misplaced if kind == MISPLACED else self._misjudged
        if sensor not in self._raw:
            self._raw[sensor] = self._dots(f"raw/{sensor}", self._colours.get(sensor, colours.GROUND))
        return self._raw[sensor]

    def _dots(self, name: str, colour: Colour) -> Trail:
        def draw(name: str, segments: np.ndarray) -> None:
            self._lines.draw(name, segments, colour, self._dot_m, "world")

        return Trail(f"/world/{name}", dots, draw)

    def _move(self, state: State) -> None:
        position = np.array(state.position_enu_m)
        self.cameras.update(position)
        distance_m = self.cameras.distance(position)
        self.aircraft.move(state, distance_m)
        self._size_dots(distance_m)
        plumb = np.array([[position, position * (1, 1, 0)]])
        self._lines.draw("/world/plumb", plumb, colours.GROUND, 1.0)
        for instrument, glyph in zip(self._scene.instruments, self._glyphs, strict=True):
            glyph.scale = scale = max(2.0, INSTRUMENT * self.cameras.distance(instrument.position_enu_m))
            self._draw_sight(instrument.name, glyph, scale, state)

    def _crosses(self, points: np.ndarray) -> np.ndarray:
        return crosses(points, CROSS * self._dot_m)

    def _draw_sight(self, name: str, glyph: viser.MeshHandle, scale: float, state: State) -> None:
        """A line to the aircraft, or in the outliers' colour to where the instrument wrongly saw it."""
        t_ns, claim = self._claims.newest.get(name, (0, None))
        fresh = claim is not None and abs(state.t_ns - t_ns) < FRESH_NS
        seen = claim if fresh and claim is not None and claim.kind == MISPLACED else None
        head = np.array(glyph.position) + np.array([0, 0, glyphs.HEAD * scale])
        beam = np.array([[head, seen.position if seen else state.position_enu_m]])
        nothing, path = beam[:0], f"/world/sight/{name}"
        self._lines.draw(path, beam if fresh and not seen else nothing, self._colours[name], 1.5)
        self._lines.draw(f"{path}-refused", beam if seen else nothing, colours.OUTLIER, 1.5)

    def _size_dots(self, distance_m: float) -> None:
        octaves = np.log2(max(1.0, DOT * distance_m / DOT_M))
        dot_m = DOT_M * 2 ** (round(2 * octaves) / 2)  # in steps, because a change goes to every chunk
        if dot_m != self._dot_m:
            self._dot_m = dot_m
            for under in ("/world/raw/", "/world/outliers/misjudged/"):
                self._lines.set_width(under, dot_m)
            self._misplaced.redraw()
