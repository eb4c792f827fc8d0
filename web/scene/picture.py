"""The 3-D picture that all viewers share: where it flew, what the sensors saw."""

from collections import defaultdict
from collections.abc import Sequence

import numpy as np
import viser

from gcs.contract.messages import State
from web.look import colours
from web.look.colours import Colour
from web.memory.claims import ACCEPTED, Claim
from web.memory.flight import SeenFlight
from web.memory.site import LaidPicture
from web.scene import glyphs, paint
from web.scene.aircraft import OF_NOW, Aircraft
from web.scene.clouds import Clouds
from web.scene.ground import draw_ground, draw_instrument, draw_site
from web.scene.lines import Lines
from web.scene.trail import Trail, dots, drops, line, shadow, sticks
from web.scene.wind import Arrow

LAYERS = {  # by name: shown at first
    "newest": True,
    "smoothed": True,
    "other": True,
    "raw": True,
    "INS": True,
    "outliers": True,
    "sticks": False,
    "sights": True,
    "trust": True,
    "ground": True,
    "wind": True,
    "site": True,
}
FRESH_NS = 2_000_000_000  # a line of sight goes this long after the instrument's last claim
DROP_NS = 5_000_000_000  # a line down to the ground, of flight
NEWEST_PX, SMOOTHED_PX, OTHER_PX = 5.0, 2.0, 1.5
WITHIN_M = 0.25  # so far off may a line be drawn that is older than some minutes: less than it is wide
MOST_DOTS = 24  # thousands for each sensor, then thinned: closer together nobody sees more
INSTRUMENT = 0.045  # size as a share of the camera's distance
LEAST_M = 2.0  # height of an instrument from near
AFAR_M = 2000.0  # where nobody looks, things have the size for this distance


class Picture:
    """Draws one flight under its own root on ``update``."""

    def __init__(self, server: viser.ViserServer, flight: SeenFlight, site: LaidPicture | None = None):
        self._server, self._flight, self.site = server, flight, site
        self._scene, self._colours = flight.scene, colours.of_sensors(flight.scene)
        self._dark = False
        self.paint = paint.PLAIN
        self.scale: paint.Scale | None = None
        self.low, self.high = np.zeros(3), np.zeros(3)  # corners of what is to be seen
        server.scene.add_frame("/world", show_axes=False)
        self._root = root = flight.root
        server.scene.add_frame(root, show_axes=False, visible=False)  # a viewer shows the one he looks at
        for name, shown in LAYERS.items():
            server.scene.add_frame(f"{root}/{name}", show_axes=False, visible=shown)
        for path in OF_NOW:
            server.scene.add_frame(f"{root}/{path}", show_axes=False)
        self._lines, self._clouds = Lines(server.scene), Clouds(server.scene, AFAR_M)
        draw_ground(server.scene, self._lines, root)
        if site:
            draw_site(server.scene, root, site)
        self._glyphs = []
        for instrument in self._scene.instruments:
            colour = self._colours[instrument.name]
            self._glyphs.append(draw_instrument(server.scene, root, instrument, colour))
            self._include(np.array([instrument.position_enu_m]))
        self.aircraft = Aircraft(server.scene, root, self._scene.vehicle)
        self._wind = Arrow(server.scene, self._lines, root)
        draw = self._lines.drawer
        self._newest = Trail(f"{root}/newest", line, self._draw_newest, wide=7, within_m=WITHIN_M)
        self._smoothed = Trail(
            f"{root}/smoothed", line, draw(colours.SMOOTHED, SMOOTHED_PX), within_m=WITHIN_M
        )
        self._shadow = Trail(f"{root}/ground/shadow", shadow, draw(colours.GROUND, 1.5), within_m=WITHIN_M)
        self._drops = Trail(f"{root}/ground/drops", drops, draw(colours.GROUND, 0.6))
        self._sticks = Trail(f"{root}/sticks", sticks, draw(colours.OUTLIER, 1.0), wide=6)
        self._raw: dict[str, Trail] = {}  # by sensor
        if flight.other:
            places = flight.other.points()
            self._lines.draw(f"{root}/other/course", line(places), colours.OTHER[False], OTHER_PX)
            self._include(places[np.isfinite(places).all(axis=1)])
        self._dropped_ns = 0
        self._moved: tuple | None = None  # time and eyes of what was last drawn

    def set_dark(self, *, dark: bool) -> None:
        self._dark = dark
        self.aircraft.set_dark(dark=dark)
        self._lines.recolour(f"{self._root}/other/", colours.OTHER[dark])
        for sensor in self._raw:
            self._clouds.recolour(f"{self._root}/{_raw_path(sensor)}/", self._dot_colour(sensor))

    def set_paint(self, choice: str) -> None:
        self.paint, self.scale = choice, None
        self._repaint(anew=True)

    def update(self, shown: State | None, eyes: Sequence[np.ndarray]) -> None:
        """Draw what changed. ``shown`` is the newest state; ``eyes``, (3,) each, where it is seen from."""
        fresh = self._flight.take_fresh()
        with self._server.atomic():
            self._extend(self._newest, fresh.newest, paint.values)
            self._extend(self._smoothed, fresh.smoothed)
            self._extend(self._shadow, fresh.newest)
            self._drop(fresh.newest)
            for claim in fresh.settled:
                self._settle(claim)
            self._repaint(anew=False)
            moved = (shown.t_ns if shown else 0, *np.round(eyes, 1).ravel().tolist())
            if moved != self._moved:
                self._scale(eyes)
                if shown:
                    self._move(shown, eyes)
            self._moved = moved
            pending = defaultdict(list)
            for claim in self._flight.claims.pending():
                if claim.kind == ACCEPTED and claim.position:
                    pending[self._trail(claim.sensor)].append(claim.position)
            for trail in self._trails():
                trail.update(pending[trail])

    def clear(self) -> None:
        for trail in self._trails():
            trail.clear()
        self.aircraft.hide()
        self._wind.move(None, np.zeros(3), AFAR_M)
        for instrument in self._scene.instruments:
            path = f"{self._root}/sights/now/{instrument.name}"
            for name in (path, f"{path}-refused"):
                self._lines.draw(name, np.zeros((0, 2, 3)), colours.GROUND, 1.0)
        self._dropped_ns = 0

    def _extend(self, trail: Trail, rows: list, more=None) -> None:
        for row in rows:
            if row["cut"]:
                trail.cut()
            place = row["position_enu_m"].tolist()
            trail.add((*place, *more(row)[0].tolist()) if more else place)
        if rows:
            self._include(np.array([row["position_enu_m"] for row in rows]))

    def _drop(self, rows: list) -> None:
        for row in rows:
            if abs(int(row["t_ns"]) - self._dropped_ns) >= DROP_NS:
                self._drops.add(row["position_enu_m"].tolist())
                self._dropped_ns = int(row["t_ns"])

    def _settle(self, claim: Claim) -> None:
        if not claim.position:
            return
        if claim.kind == ACCEPTED:
            self._trail(claim.sensor).add(claim.position)
        elif (place := self._flight.place_at(claim.t_ns)) is not None:
            self._sticks.add((*claim.position, *place.tolist()))

    def _include(self, places: np.ndarray) -> None:
        self.low = np.minimum(self.low, places.min(axis=0))
        self.high = np.maximum(self.high, places.max(axis=0))

    def _repaint(self, *, anew: bool) -> None:
        scale = paint.scale_of(self.paint, self._flight.newest.view, self.scale)
        if anew or scale != self.scale:
            self.scale = scale
            self._newest.redraw()

    def _draw_newest(self, name: str, segments: np.ndarray) -> None:
        colour = paint.paint(self.paint, self.scale, segments[..., 3:])
        self._lines.draw(name, segments[..., :3], colour, NEWEST_PX)

    def _trails(self) -> list[Trail]:
        lines = [self._newest, self._smoothed, self._shadow, self._drops, self._sticks]
        return [*lines, *self._raw.values()]

    def _trail(self, sensor: str) -> Trail:
        """Where a sensor's accepted claims are drawn."""
        if sensor not in self._raw:
            self._raw[sensor] = Trail(
                f"{self._root}/{_raw_path(sensor)}",
                dots,
                lambda name, places: self._clouds.draw(name, places, self._dot_colour(sensor)),
                most=MOST_DOTS,
            )
        return self._raw[sensor]

    def _dot_colour(self, sensor: str) -> Colour:
        return colours.dimmed(self._colours.get(sensor, colours.GROUND), dark=self._dark)

    def _move(self, state: State, eyes: Sequence[np.ndarray]) -> None:
        position = np.array(state.position_enu_m)
        distance_m = _nearest(eyes, position)
        self.aircraft.move(state, distance_m)
        self._clouds.resize(distance_m)
        self._wind.move(self._flight.wind, position, distance_m)
        for instrument, glyph in zip(self._scene.instruments, self._glyphs, strict=True):
            self._draw_sight(instrument.name, glyph, state)

    def _scale(self, eyes: Sequence[np.ndarray]) -> None:
        """Give the instruments their size; they are to be seen before the aircraft is."""
        for instrument, glyph in zip(self._scene.instruments, self._glyphs, strict=True):
            far_m = _nearest(eyes, np.array(instrument.position_enu_m))
            glyph.scale = max(LEAST_M, INSTRUMENT * far_m)

    def _draw_sight(self, name: str, glyph: viser.MeshHandle, state: State) -> None:
        """A line to the aircraft, or in the outliers' colour to where the instrument wrongly saw it."""
        claim = self._flight.claims.newest.get(name)
        fresh = claim is not None and abs(state.t_ns - claim.t_ns) < FRESH_NS
        seen = claim.position if fresh and claim is not None and claim.misplaced else None
        head = np.array(glyph.position) + np.array([0, 0, glyphs.HEAD]) * glyph.scale
        beam = np.array([[head, seen or state.position_enu_m]])
        nothing, path = beam[:0], f"{self._root}/sights/now/{name}"
        self._lines.draw(path, beam if fresh and not seen else nothing, self._colours[name], 1.5)
        self._lines.draw(f"{path}-refused", beam if seen else nothing, colours.OUTLIER, 1.5)


def _raw_path(sensor: str) -> str:
    return "INS/points" if sensor == "ins" else f"raw/{sensor}"


def _nearest(eyes: Sequence[np.ndarray], place: np.ndarray) -> float:
    return min((float(np.linalg.norm(eye - place)) for eye in eyes), default=AFAR_M)
