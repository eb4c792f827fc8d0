"""The 3-D picture: what stands still, what flew, what was refused.

Everything hangs under one node, ``/world``, in station ENU. The follow camera moves that node, not the
camera, so it never fights the hand on the mouse.
"""

import numpy as np
import viser
import viser.transforms

from gcs.messages import Scene, State, Verdict
from web import colours, glyphs
from web.claims import Claims
from web.colours import Colour
from web.trail import Trail, crosses, dots, line

LAYERS = ("raw", "filtered", "smoothed", "outliers", "sight", "ellipsoid")
STEP_NS = 100_000_000  # trajectories are drawn ten times a second of flight; finer cannot be seen
BREAK_NS = 5_000_000_000  # a longer gap is not bridged by a straight line
FRESH_NS = 2_000_000_000  # a line of sight fades this long after the instrument's last claim
GRAVITY_MPS2 = 9.80665
DOT_M = 1.6  # least width of a raw point
AIRCRAFT, INSTRUMENT, ELLIPSOID, DOT = 0.08, 0.045, 0.025, 0.0016  # sizes as a share of the camera's distance
FACTORS = (1, 2, 5, 10, 20, 50, 100, 200, 500, 1000)  # how much larger than life the ellipsoid may be


class Picture:
    """Takes messages, keeps the trails, draws them on ``update``."""

    def __init__(self, server: viser.ViserServer, scene: Scene):
        self._server, self._scene = server, scene
        self._api = server.scene
        self._colours = colours.of_sensors(scene)
        self._lines: dict[str, viser.LineSegmentsHandle] = {}
        self.follow = False
        self._dot_m = DOT_M
        self.sigma_factor = 1  # how much larger than life the ellipsoid is drawn
        self._world = self._api.add_frame("/world", show_axes=False)
        self.layers = {
            name: self._api.add_frame(f"/world/{name}", show_axes=False) for name in (*LAYERS, "fixed")
        }
        self._trails = {
            "filtered": Trail("/world/filtered", line, self._drawer(colours.FILTERED, 4.0)),
            "smoothed": Trail("/world/smoothed", line, self._drawer(colours.SMOOTHED, 2.0)),
            "outliers": Trail("/world/outliers", crosses, self._drawer(colours.OUTLIER, 2.5)),
        }
        self._raw: dict[str, Trail] = {}
        self._claims = Claims(self._settle)
        self._state: State | None = None
        self._last_ns: dict[str, int] = {}
        self._reset_counter = 0
        self._draw_ground()
        self._glyphs = [self._draw_instrument(instrument) for instrument in scene.instruments]
        self._draw_aircraft()
        stands = np.array([[0, 0, 0], *[i.position_enu_m for i in scene.instruments]], float)
        self._low, self._high = stands.min(0), stands.max(0)

    def take(self, message, source: str) -> None:
        match message:
            case State() if source == "smoothed":
                self._extend("smoothed", message)
            case State():
                self._extend("filtered", message)
                self._state = message
            case Verdict():
                self._claims.take(message)

    def update(self) -> None:
        """Draw what changed."""
        self._claims.settle()
        if self._state:
            self._move_aircraft(self._state)
            self._draw_sight(self._state)
        self._size_to_camera()
        self._trails["filtered"].update()
        self._trails["smoothed"].update()
        accepted, refused = self._claims.pending()
        self._trails["outliers"].update(refused)
        for sensor in {*self._raw, *accepted}:
            self._raw_trail(sensor).update(accepted.get(sensor, ()))

    def clear(self) -> None:
        for trail in [*self._trails.values(), *self._raw.values()]:
            trail.clear()
        self._claims.clear()
        self._last_ns.clear()

    def look(self, client: viser.ClientHandle) -> None:
        """Bring everything, or when following the aircraft, into one client's sight."""
        centre, radius = (self._low + self._high) / 2, np.linalg.norm(self._high - self._low) / 2
        if self.follow:
            centre, radius = np.zeros(3), 160.0
        away = np.array([-0.35, -0.8, 0.5]) * max(radius, 150.0) * 2.0
        with client.atomic():
            client.camera.position = centre + away
            client.camera.look_at = centre

    def set_dark(self, dark: bool) -> None:
        self._aircraft.color = colours.INK[dark]

    def _extend(self, which: str, state: State) -> None:
        gap_ns = state.t_ns - self._last_ns.get(which, state.t_ns - STEP_NS)
        reset = which == "filtered" and state.reset_counter != self._reset_counter
        if not reset and 0 <= gap_ns < STEP_NS:
            return
        if reset or not 0 <= gap_ns < BREAK_NS:
            self._trails[which].cut()
        self._trails[which].add(state.position_enu_m)
        self._last_ns[which] = state.t_ns
        self._low = np.minimum(self._low, state.position_enu_m)
        self._high = np.maximum(self._high, state.position_enu_m)
        if which == "filtered":
            self._reset_counter = state.reset_counter

    def _settle(self, sensor: str, position, outlier: bool) -> None:
        if outlier:
            self._trails["outliers"].add(position)
        else:
            self._raw_trail(sensor).add(position)

    def _raw_trail(self, sensor: str) -> Trail:
        if sensor not in self._raw:
            draw = self._drawer(self._colours.get(sensor, colours.GROUND), self._dot_m, "world")
            self._raw[sensor] = Trail(f"/world/raw/{sensor}", dots, draw)
        return self._raw[sensor]

    def _drawer(self, colour: Colour, width: float, units: str = "screen"):
        def draw(name: str, segments: np.ndarray) -> None:
            shown = self._lines.get(name)
            if len(segments) == 0:
                if shown:
                    self._lines.pop(name).remove()
            elif shown:
                shown.points = segments
            else:
                self._lines[name] = self._api.add_line_segments(
                    name, segments, colour, thickness=width, thickness_units=units
                )

        return draw

    def _draw_ground(self) -> None:
        grid = {"infinite_grid": True, "fade_distance": 12_000.0, "cell_size": 100.0, "section_size": 1000.0}
        self._api.add_grid(
            "/world/fixed/grid",
            **grid,
            cell_color=colours.GROUND,
            section_color=colours.GROUND,
            cell_thickness=0.5,
            section_thickness=1.1,
            fade_strength=2.0,
            shadow_opacity=0.0,
        )
        north = np.array(
            [[(0, 0, 0), (0, 300, 0)], [(0, 300, 0), (-30, 240, 0)], [(0, 300, 0), (30, 240, 0)]]
        )
        self._drawer(colours.GROUND, 4.0)("/world/fixed/north", north.astype(np.float32))
        self._api.add_label("/world/fixed/n", "N", position=(0, 340, 0), anchor="center-center")
        for side, e, n in (("E", 1000, 0), ("N", 0, 1000), ("W", -1000, 0), ("S", 0, -1000)):
            place = {"position": (e, n, 0), "font_screen_scale": 0.8, "anchor": "center-center"}
            self._api.add_label(f"/world/fixed/1km-{side}", f"1 km {side}", **place)

    def _draw_instrument(self, instrument) -> viser.MeshHandle:
        name, position = instrument.name, instrument.position_enu_m
        vertices, faces = glyphs.radar() if instrument.kind == "radar" else glyphs.theodolite()
        self._api.add_label(f"/world/fixed/{name}-label", name, position=position, anchor="top-center")
        return self._api.add_mesh_simple(
            f"/world/fixed/{name}",
            vertices,
            faces,
            color=self._colours[name],
            flat_shading=True,
            side="double",
            position=position,
        )

    def _draw_aircraft(self) -> None:
        vertices, faces = glyphs.aircraft()
        self._aircraft = self._api.add_mesh_simple(
            "/world/aircraft",
            vertices,
            faces,
            color=colours.INK[False],
            flat_shading=True,
            side="double",
            visible=False,
        )
        self._name = self._api.add_label(
            "/world/aircraft-label", self._scene.vehicle, visible=False, anchor="bottom-center"
        )
        self._sphere = self._api.add_icosphere(
            "/world/ellipsoid/sigma", color=colours.FILTERED, opacity=0.22, visible=False, cast_shadow=False
        )

    def _move_aircraft(self, state: State) -> None:
        position = np.array(state.position_enu_m)
        distance = self._camera_distance(position)
        with self._server.atomic():
            if self.follow:
                self._world.position = -position
            elif np.any(self._world.position):
                self._world.position = (0, 0, 0)
            size_m = max(2.0, AIRCRAFT * distance)
            self._aircraft.scale = size_m
            self._aircraft.position = self._sphere.position = position
            self._name.position = position + np.array([0, 0, size_m / 2])
            if np.linalg.norm(state.velocity_enu_mps) > 2.0:
                self._aircraft.wxyz = attitude(state.velocity_enu_mps, state.acceleration_enu_mps2)
            self._aircraft.visible = self._name.visible = self._sphere.visible = True
            self._size_ellipsoid(state, distance)
        self._drawer(colours.GROUND, 1.0)(
            "/world/plumb", np.array([[position, position * (1, 1, 0)]], np.float32)
        )

    def _size_ellipsoid(self, state: State, distance: float) -> None:
        radii, axes = ellipsoid(state.covariance)
        seen = (factor for factor in FACTORS if factor * radii.max() > ELLIPSOID * distance)
        self.sigma_factor = next(seen, FACTORS[-1])
        self._sphere.scale = tuple(radii * self.sigma_factor)
        self._sphere.wxyz = viser.transforms.SO3.from_matrix(axes).wxyz

    def _draw_sight(self, state: State) -> None:
        for instrument, glyph in zip(self._scene.instruments, self._glyphs, strict=True):
            t_ns, claim = self._claims.newest.get(instrument.name, (0, None))
            fresh = claim is not None and abs(state.t_ns - t_ns) < FRESH_NS
            refused = fresh and claim.outlier
            target = claim.position if refused else state.position_enu_m
            head = np.array(instrument.position_enu_m) + np.array([0, 0, glyphs.HEAD * glyph.scale])
            beam = np.array([[head, target]], np.float32)
            nothing = beam[:0]
            name, colour = f"/world/sight/{instrument.name}", self._colours[instrument.name]
            self._drawer(colour, 1.5)(name, beam if fresh and not refused else nothing)
            self._drawer(colours.OUTLIER, 1.5)(f"{name}-refused", beam if refused else nothing)

    def _size_to_camera(self) -> None:
        for glyph in self._glyphs:
            glyph.scale = max(2.0, INSTRUMENT * self._camera_distance(np.array(glyph.position)))
        distance = self._camera_distance(np.array(self._aircraft.position))
        octaves = np.log2(max(1.0, DOT * distance / DOT_M))
        dot_m = DOT_M * 2 ** (round(2 * octaves) / 2)  # in steps, for a change goes out once per chunk
        if dot_m != self._dot_m:
            self._dot_m = dot_m
            for name, points in self._lines.items():
                if name.startswith("/world/raw/"):
                    points.thickness = dot_m

    def _camera_distance(self, position: np.ndarray) -> float:
        """Metres from the nearest camera to a point of the world."""
        shift = np.array(self._world.position)
        eyes = [client.camera.position for client in self._server.get_clients().values()]
        return min((float(np.linalg.norm(eye - shift - position)) for eye in eyes), default=2000.0)


def ellipsoid(covariance: list[float]) -> tuple[np.ndarray, np.ndarray]:
    """3-sigma radii (3,) in metres and axes (3, 3) of the position, from a lower triangle by rows."""
    xx, yx, yy, zx, zy, zz = covariance[:6]
    variances, axes = np.linalg.eigh(np.array([[xx, yx, zx], [yx, yy, zy], [zx, zy, zz]]))
    axes[:, 2] *= np.sign(np.linalg.det(axes))
    return 3 * np.sqrt(np.maximum(variances, 1e-6)), axes


def attitude(velocity, acceleration) -> np.ndarray:
    """Unit quaternion wxyz of an aircraft in a coordinated turn: nose along the velocity."""
    nose = np.array(velocity) / np.linalg.norm(velocity)
    lift = np.array([0, 0, GRAVITY_MPS2]) + acceleration
    lift = lift - (lift @ nose) * nose
    up = lift / np.linalg.norm(lift)
    return viser.transforms.SO3.from_matrix(np.column_stack([nose, np.cross(up, nose), up])).wxyz
