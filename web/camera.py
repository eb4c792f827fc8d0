"""Where one viewer looks from: around everything, after the aircraft, from above, or through an instrument.

The flight hangs under the node ``/world``, in station ENU. To follow the aircraft one viewer's own ``/world``
is moved, not the camera, so following never fights the hand on the mouse.
"""

import numpy as np
import viser

from gcs.contract.messages import Scene

AWAY = np.array([-0.7, -1.7, 1.1])  # from behind and above, north up, in radii of what is to be seen
ABOVE = np.array([0.0, -0.02, 2.4])  # a hair to the south, so that north is up
NEAR_M = 160.0  # radius of what is to be seen when following
LEAST_M = 300.0  # the smallest scene
GROWTH = 1.2  # a camera nobody has moved is set back when the flight has outgrown its sight by so much
UNMOVED_M = 1.0
FOV, TELESCOPE = 0.9, 0.25  # radians, vertical
EYE_M = 4.0  # an instrument's eye is above its foot
ORBIT, FOLLOW, TOP = "orbit", "follow", "top"


def modes(scene: Scene) -> list[str]:
    return [ORBIT, FOLLOW, TOP, *(f"from {instrument.name}" for instrument in scene.instruments)]


class Camera:
    """One viewer's."""

    def __init__(self, client: viser.ClientHandle, scene: Scene):
        self._client = client
        self._eyes = {f"from {one.name}": np.array(one.position_enu_m) for one in scene.instruments}
        self._world = client.scene.add_frame("/world", show_axes=False)
        self._low, self._high = np.zeros(3), np.zeros(3)
        self._placed: tuple[np.ndarray, float] = np.zeros(3), np.inf  # where we put it, radius then seen
        self.mode = ORBIT

    def set_mode(self, mode: str) -> None:
        self.mode = mode
        self.look()

    def look(self) -> None:
        """Put the camera where its mode has it."""
        if self.mode == FOLLOW:
            self._place(np.zeros(3), NEAR_M, AWAY)
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
        eye, seen = self._placed
        _, radius = self._extent()
        unmoved = np.linalg.norm(self._client.camera.position - eye) < UNMOVED_M
        if self.mode != FOLLOW and radius > GROWTH * seen and unmoved:
            self.look()

    @property
    def offset(self) -> np.ndarray:
        """(3,) what this viewer's world is moved by."""
        return np.array(self._world.position)

    def eye(self) -> np.ndarray:
        """(3,) where the camera is, station ENU."""
        return np.asarray(self._client.camera.position) - self.offset

    def pixel_rad(self) -> float:
        """How much of the sight one pixel takes, in the middle of the picture."""
        return float(self._client.camera.fov) / max(self._client.camera.image_height, 1)

    def _place(self, centre: np.ndarray, radius: float, away: np.ndarray) -> None:
        eye = centre + radius * away
        self._aim(eye, centre)
        self._placed = eye, radius

    def _aim(self, eye: np.ndarray, at: np.ndarray) -> None:
        with self._client.atomic():
            self._client.camera.position = eye
            self._client.camera.look_at = at

    def _extent(self) -> tuple[np.ndarray, float]:
        radius = float(np.linalg.norm(self._high - self._low)) / 2
        return (self._low + self._high) / 2, max(radius, LEAST_M)
