"""What a click meant, and where an instrument has to look."""

from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from gcs.contract.frames import ecef_to_enu, frame_of
from gcs.contract.messages import Scene


def off_ray(origin: ArrayLike, direction: ArrayLike, points: np.ndarray) -> np.ndarray:
    """(n,) angle in radians between a ray and each of (n, 3) points as its origin sees them."""
    away = np.asarray(points, float).reshape(-1, 3) - np.asarray(origin, float)
    along = np.asarray(direction, float) / np.linalg.norm(direction)
    return np.arctan2(np.linalg.norm(np.cross(away, along), axis=1), away @ along)


def hit(origin: ArrayLike, direction: ArrayLike, points: np.ndarray, within_rad: float) -> int | None:
    """Which of (n, 3) points a ray passes within ``within_rad``: the nearest to it; None: none."""
    off = off_ray(origin, direction, points)
    if not len(off) or not np.nanmin(off, initial=np.inf) <= within_rad:
        return None
    return int(np.nanargmin(off))


class Rectangle(NamedTuple):
    """A part of a picture: shares of its width and height from the upper left corner."""

    left: float
    top: float
    right: float
    bottom: float

    def holds(self, seen: np.ndarray) -> np.ndarray:
        """(n, 2) shares → (n,) bool; NaN, what is behind the eye, is in no part."""
        x, y = seen.T
        return (x >= self.left) & (x <= self.right) & (y >= self.top) & (y <= self.bottom)


def on_picture(away: np.ndarray, axes: np.ndarray, fov_rad: float, aspect: float) -> np.ndarray:
    """(n, 2) where something is seen, as shares of the picture from its upper left; NaN behind the eye.

    ``away`` (n, 3) from the eye; ``axes`` (3, 3) by columns right, down and ahead; ``fov_rad`` upwards.
    """
    right, down, ahead = (away @ axes).T
    with np.errstate(divide="ignore", invalid="ignore"):
        reach = np.where(ahead > 0.0, 2.0 * np.tan(fov_rad / 2) * ahead, np.nan)
        return np.column_stack([0.5 + right / (reach * aspect), 0.5 + down / reach])


def look(scene: Scene, from_enu_m: ArrayLike, to_enu_m: ArrayLike) -> tuple[float, float, float]:
    """Slant range in m, true azimuth and elevation in degrees, in the local frame of a place in station ENU.

    Straight line: refraction is the instrument's own matter.
    """
    frame = frame_of(scene)
    lat_deg, lon_deg, _ = frame.to_geodetic(np.asarray(from_enu_m, float))
    turn = ecef_to_enu(float(lat_deg), float(lon_deg)) @ ecef_to_enu(frame.lat_deg, frame.lon_deg).T
    east, north, up = turn @ (np.asarray(to_enu_m, float) - np.asarray(from_enu_m, float))
    azimuth_deg = np.degrees(np.arctan2(east, north)) % 360.0
    return (
        float(np.hypot(np.hypot(east, north), up)),
        float(azimuth_deg),
        float(np.degrees(np.arctan2(up, np.hypot(east, north)))),
    )
