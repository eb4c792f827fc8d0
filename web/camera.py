"""Where the page is looked at from: the whole scene, or the aircraft.

Everything hangs under one node, ``/world``, in station ENU. To follow the aircraft that node is moved, not
the camera, so following never fights the hand on the mouse.
"""

import numpy as np
import viser
from numpy.typing import ArrayLike

AWAY = np.array([-0.7, -1.7, 1.1])  # from behind and above, north up, in radii of what is to be seen
NEAR_M = 160.0  # radius of what is to be seen when following
LEAST_M = 300.0  # the smallest scene
GROWTH = 1.2  # a camera nobody has moved is set back when the flight has outgrown its sight by so much
UNMOVED_M = 1.0


class Cameras:
    """The cameras of all who have the page open."""

    def __init__(self, server: viser.ViserServer):
        self._server = server
        self._world = server.scene.add_frame("/world", show_axes=False)
        self._low, self._high = np.zeros(3), np.zeros(3)
        self._placed: dict[int, tuple[np.ndarray, float]] = {}  # by client: where we put it, radius then seen
        self.follow = False
        camera = server.initial_camera
        camera.near, camera.far, camera.fov = 1.0, 100_000.0, 0.9
        camera.position, camera.look_at = tuple(1000.0 * AWAY), (0.0, 0.0, 0.0)

    def include(self, position: ArrayLike) -> None:
        """Count a point of the world, (3,) metres, to what is to be seen."""
        self._low, self._high = np.minimum(self._low, position), np.maximum(self._high, position)

    def look(self, client: viser.ClientHandle) -> None:
        """Bring everything, or when following the aircraft, into one client's sight."""
        centre, radius = (np.zeros(3), NEAR_M) if self.follow else self._extent()
        eye = centre + radius * AWAY
        with client.atomic():
            client.camera.position = eye
            client.camera.look_at = centre
        self._placed[client.client_id] = eye, radius

    def set_follow(self, *, follow: bool) -> None:
        self.follow = follow
        for client in self._server.get_clients().values():
            self.look(client)

    def update(self, aircraft: np.ndarray) -> None:
        """Follow, or widen the sight of those who have not moved their camera."""
        if self.follow:
            self._world.position = -aircraft
            return
        if np.any(self._world.position):
            self._world.position = (0.0, 0.0, 0.0)
        _, radius = self._extent()
        for client in self._server.get_clients().values():
            eye, seen = self._placed.get(client.client_id, (np.zeros(3), np.inf))
            if radius > GROWTH * seen and np.linalg.norm(client.camera.position - eye) < UNMOVED_M:
                self.look(client)

    def distance(self, position: ArrayLike) -> float:
        """Metres from the nearest camera to a point of the world."""
        place = np.array(self._world.position) + np.asarray(position)
        eyes = [client.camera.position for client in self._server.get_clients().values()]
        return min((float(np.linalg.norm(eye - place)) for eye in eyes), default=2000.0)

    def _extent(self) -> tuple[np.ndarray, float]:
        radius = float(np.linalg.norm(self._high - self._low)) / 2
        return (self._low + self._high) / 2, max(radius, LEAST_M)
