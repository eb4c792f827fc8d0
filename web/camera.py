"""Where one viewer looks from: around everything, after the aircraft, from above, or through an instrument.

The flight hangs under the node ``/world``, in station ENU. To follow the aircraft one viewer's own ``/world``
is moved, not the camera, so following never fights the hand on the mouse.
"""

from itertools import product
from typing import NamedTuple

import numpy as np
import viser
from viser.transforms import SO3

from gcs.contract.messages import Scene
from web.memory.geometry import on_picture
from web.scene.names import Lens

AWAY = np.array([-0.7, -1.7, 1.1])  # from behind and above, north up
ABOVE = np.array([0.0, -0.01, 1.0])  # a hair to the south, so that north is up
ROOM = 0.88  # of the sight: the rest is for names and glyphs at its edge
NEAR_M = 160.0  # radius of what is to be seen when following
LEAST_M = 300.0  # radius of the smallest scene
GROWTH = 1.2  # a camera nobody has moved is set back when the flight has outgrown its sight by so much
RESHAPED = 0.03  # … or when the picture has become so much wider or narrower
UNMOVED_M = 1.0
FOV, TELESCOPE = 0.9, 0.25  # radians, vertical
EYE_M = 4.0  # an instrument's eye is above its foot
ORBIT, FOLLOW, TOP = "orbit", "follow", "top"


def modes(scene: Scene) -> list[str]:
    return [ORBIT, FOLLOW, TOP, *(f"from {instrument.name}" for instrument in scene.instruments)]


class Placed(NamedTuple):
    """Where a camera was put, and what for."""

    eye: np.ndarray  # (3,) in the viewer's world
    radius_m: float  # of what was to be seen
    aspect: float  # of the picture, width over height


class Camera:
    """One viewer's."""

    def __init__(self, client: viser.ClientHandle, scene: Scene):
        self._client = client
        self._eyes = {f"from {one.name}": np.array(one.position_enu_m) for one in scene.instruments}
        self._world = client.scene.add_frame("/world", show_axes=False)
        self._low, self._high = np.zeros(3), np.zeros(3)
        self._placed = Placed(np.zeros(3), np.inf, 1.0)
        self.mode = ORBIT

    def set_mode(self, mode: str) -> None:
        self.mode = mode
        self.look()

    def look(self) -> None:
        """Put the camera where its mode has it."""
        if self.mode == FOLLOW:
            self._place(*_around(np.zeros(3), NEAR_M), AWAY)
        elif self.mode in (ORBIT, TOP):
            self._place(*self._extent(), ABOVE if self.mode == TOP else AWAY)
        self._client.camera.fov = TELESCOPE if self.mode in self._eyes else FOV

    def update(self, aircraft: np.ndarray | None, low: np.ndarray, high: np.ndarray) -> None:
        """Follow or point at the aircraft, or widen the sight of a viewer who has not moved the camera.

        ``low`` and ``high`` are corners of all there is to see.
        """
        self._low, self._high = low, high
        offset = -aircraft if self.mode == FOLLOW and aircraft is not None else np.zeros(3)
        if np.any(offset != self._world.position):
            self._world.position = offset
        if self.mode in self._eyes:
            if aircraft is not None:
                self._aim(self._eyes[self.mode] + (0, 0, EYE_M), aircraft)
            return
        unmoved = np.linalg.norm(self._client.camera.position - self._placed.eye) < UNMOVED_M
        grown = self.mode != FOLLOW and _radius(*self._extent()) > GROWTH * self._placed.radius_m
        reshaped = abs(self._aspect() / self._placed.aspect - 1.0) > RESHAPED
        if unmoved and (grown or reshaped):
            self.look()

    @property
    def offset(self) -> np.ndarray:
        """(3,) what this viewer's world is moved by."""
        return np.array(self._world.position)

    def eye(self) -> np.ndarray:
        """(3,) where the camera is, station ENU."""
        return np.asarray(self._client.camera.position) - self.offset

    def on_picture(self, places: np.ndarray) -> np.ndarray:
        """(n, 3) station ENU → (n, 2) where this viewer sees it: shares of the picture's width and height."""
        camera = self._client.camera
        axes = SO3(np.asarray(camera.wxyz)).as_matrix()
        return on_picture(places - self.eye(), axes, float(camera.fov), self._aspect())

    def lens(self) -> Lens:
        """How this viewer sees the picture."""
        camera = self._client.camera
        size = max(camera.image_width, 1), max(camera.image_height, 1)
        return Lens(lambda places: self.on_picture(places) * size, size, self.pixel_rad())

    def pixel_rad(self) -> float:
        """How much of the sight one pixel takes, in the middle of the picture."""
        return float(self._client.camera.fov) / max(self._client.camera.image_height, 1)

    def _aspect(self) -> float:
        """Width over height of the picture, which ends at the panels."""
        camera = self._client.camera
        return max(camera.image_width, 1) / max(camera.image_height, 1)

    def _place(self, low: np.ndarray, high: np.ndarray, away: np.ndarray) -> None:
        aspect = self._aspect()
        eye, at = fit(corners(low, high), away, FOV, aspect)
        if self.mode == FOLLOW:  # the hand on the mouse turns around the aircraft
            eye, at = eye - at, np.zeros(3)
        self._aim(eye, at)
        self._placed = Placed(eye, _radius(low, high), aspect)

    def _aim(self, eye: np.ndarray, at: np.ndarray) -> None:
        with self._client.atomic():
            self._client.camera.position = eye
            self._client.camera.look_at = at

    def _extent(self) -> tuple[np.ndarray, np.ndarray]:
        """Corners of what is to be seen."""
        low, high = self._low, self._high
        return (low, high) if _radius(low, high) > LEAST_M else _around((low + high) / 2, LEAST_M)


def corners(low: np.ndarray, high: np.ndarray) -> np.ndarray:
    """(8, 3) of a box."""
    return np.array(list(product(*zip(low, high, strict=True))))


def fit(points: np.ndarray, away: np.ndarray, fov_rad: float, aspect: float) -> tuple[np.ndarray, np.ndarray]:
    """Eye (3,) on the side ``away``, nearest to where it sees all (n, 3) points; and what it looks at (3,).

    In the axes of the picture a point at (x, y) and depth z is inside when |x − eye_x| ≤ t (z − eye_z), and
    so with y: four half planes for each point, of which the outermost ones hold the eye.
    """
    ahead = -away / np.linalg.norm(away)
    right = np.cross(ahead, (0.0, 0.0, 1.0))
    right /= np.linalg.norm(right)
    axes = np.array([right, np.cross(ahead, right), ahead])  # x to the right, y down, z into the picture
    seen = points @ axes.T
    depth, middle = np.inf, np.zeros(2)
    for k, tangent in enumerate((aspect * np.tan(fov_rad / 2), np.tan(fov_rad / 2))):
        reach = ROOM * tangent * seen[:, 2]
        low, high = (seen[:, k] + reach).min(), (seen[:, k] - reach).max()
        middle[k] = (low + high) / 2
        depth = min(depth, (low - high) / (2 * ROOM * tangent))
    eye, at = (np.array([*middle, z]) @ axes for z in (depth, seen[:, 2].mean()))
    return eye, at


def _radius(low: np.ndarray, high: np.ndarray) -> float:
    return float(np.linalg.norm(high - low)) / 2


def _around(middle: np.ndarray, radius_m: float) -> tuple[np.ndarray, np.ndarray]:
    half = radius_m / np.sqrt(3.0)
    return middle - half, middle + half
