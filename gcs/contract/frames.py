"""Between WGS84 and the local frames. Nothing else in the station does geodesy.

Formulas: Groves, *Principles of GNSS, Inertial, and Multisensor Integrated Navigation Systems*, 2013, ch. 2.
They are written out because live every state passes here alone: pymap3d, which the tests hold them against,
takes five times as long for one, and its way back is off by 0.2 µm.
"""

from functools import lru_cache
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from gcs.contract.config import Position, SensorSection, Station
from gcs.contract.messages import InputError, Instrument, Scene

A_M, FLATTENING = 6_378_137.0, 1.0 / 298.257223563  # WGS84
E2 = FLATTENING * (2.0 - FLATTENING)  # eccentricity, squared
ROUNDS = 2  # of Bowring's formula: one leaves 3 µm at most, two less than a double can tell


class Frame(NamedTuple):
    """Station ENU: East-North-Up at the origin, WGS84 degrees and ellipsoidal metres."""

    lat_deg: float
    lon_deg: float
    alt_m: float

    def to_enu(self, lat_deg: ArrayLike, lon_deg: ArrayLike, alt_m: ArrayLike) -> np.ndarray:
        """(n, 3) station ENU in m of WGS84 positions, each (n,)."""
        rotation, origin = _at(self)
        return (geodetic_to_ecef(lat_deg, lon_deg, alt_m) - origin) @ rotation.T

    def to_geodetic(self, enu_m: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """lat_deg, lon_deg, alt_m, each (n,), of (n, 3) station ENU."""
        rotation, origin = _at(self)
        return ecef_to_geodetic(enu_m @ rotation + origin)

    def turn(self, vectors: np.ndarray, lat_deg: np.ndarray, lon_deg: np.ndarray) -> np.ndarray:
        """(n, 3) vectors in the local ENU frames at (lat, lon), each (n,), turned into station ENU.

        Or (n, k, 3), k of them at each of (n, 1) places.
        """
        (east, north, up), rotation = np.moveaxis(vectors, -1, 0), _at(self)[0]
        lat, lon = np.radians(lat_deg), np.radians(lon_deg)
        out = np.cos(lat) * up - np.sin(lat) * north  # away from the Earth's axis
        ecef = np.empty(vectors.shape)
        ecef[..., 0] = np.cos(lon) * out - np.sin(lon) * east
        ecef[..., 1] = np.sin(lon) * out + np.cos(lon) * east
        ecef[..., 2] = np.sin(lat) * up + np.cos(lat) * north
        return ecef @ rotation.T

    def place(self, position: Position) -> tuple[np.ndarray, np.ndarray]:
        """An instrument's offset (3,) in station ENU, and its rotation (3, 3) station ENU → sensor ENU."""
        offset = self.to_enu(position.lat_deg, position.lon_deg, position.alt_m)
        here, there = ecef_to_enu(self.lat_deg, self.lon_deg), ecef_to_enu(position.lat_deg, position.lon_deg)
        return offset, there @ here.T

    def place_sensor(self, sensor: SensorSection) -> tuple[np.ndarray, np.ndarray]:
        """`place` of an instrument as it is mounted: it may lean, and its azimuth begin elsewhere."""
        offset, rotation = self.place(sensor.position)
        return offset, mount(sensor.tilt_deg.east, sensor.tilt_deg.north, sensor.orientation_deg) @ rotation


@lru_cache(maxsize=64)
def _at(frame: Frame) -> tuple[np.ndarray, np.ndarray]:
    """Rotation (3, 3) from ECEF to the frame, and its origin (3,) in ECEF, m."""
    return ecef_to_enu(frame.lat_deg, frame.lon_deg), geodetic_to_ecef(*frame)


def geodetic_to_ecef(lat_deg: ArrayLike, lon_deg: ArrayLike, alt_m: ArrayLike) -> np.ndarray:
    """(n, 3) Earth-centred Earth-fixed in m of WGS84 positions, each (n,): Groves 2013, eq. 2.112."""
    lat, lon, alt = np.radians(np.asarray(lat_deg)), np.radians(np.asarray(lon_deg)), np.asarray(alt_m)
    sin = np.sin(lat)
    radius = A_M / np.sqrt(1.0 - E2 * sin**2)  # of curvature, east to west
    out = (radius + alt) * np.cos(lat)
    return np.stack([out * np.cos(lon), out * np.sin(lon), ((1.0 - E2) * radius + alt) * sin], axis=-1)


def ecef_to_geodetic(ecef_m: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """lat_deg, lon_deg, alt_m, each (n,), of (n, 3) ECEF: Bowring 1976, and `ROUNDS` times so.

    Its angles stand as sine and cosine, so nothing fails at the poles or the equator.
    """
    x, y, z = np.moveaxis(ecef_m, -1, 0)
    out = np.hypot(x, y)  # from the Earth's axis
    rise, run = z, (1.0 - FLATTENING) * out  # tangent of the parametric latitude, on the ellipsoid
    for _ in range(ROUNDS):
        length = np.hypot(rise, run)
        up = z + E2 / (1.0 - FLATTENING) * A_M * (rise / length) ** 3
        level = out - E2 * A_M * (run / length) ** 3
        rise, run = (1.0 - FLATTENING) * up, level
    length = np.hypot(up, level)
    sin, cos = up / length, level / length
    alt = out * cos + z * sin - A_M * np.sqrt(1.0 - E2 * sin**2)
    return np.degrees(np.arctan2(up, level)), np.degrees(np.arctan2(y, x)), alt


def ecef_to_enu(lat_deg: float, lon_deg: float) -> np.ndarray:
    """(3, 3) rotation from Earth-centred Earth-fixed to local ENU (Groves 2013, eq. 2.150, rows E N U)."""
    lat, lon = np.radians([lat_deg, lon_deg])
    return np.array(
        [
            [-np.sin(lon), np.cos(lon), 0.0],
            [-np.sin(lat) * np.cos(lon), -np.sin(lat) * np.sin(lon), np.cos(lat)],
            [np.cos(lat) * np.cos(lon), np.cos(lat) * np.sin(lon), np.sin(lat)],
        ]
    )


def mount(east_deg: float, north_deg: float, orientation_deg: float) -> np.ndarray:
    """(3, 3) rotation from level, north-oriented ENU at an instrument to the frame of its own axes.

    Its vertical axis leans by ``east_deg`` towards east and by ``north_deg`` towards north, in one turn about
    a horizontal axis: a target in the direction of the lean reads higher by as much. It reads azimuth zero
    towards the azimuth ``orientation_deg``. Rodrigues' formula: Goldstein, *Classical Mechanics*, 4.62.
    """
    lean = np.radians(np.hypot(east_deg, north_deg))
    e, n = np.array([east_deg, north_deg]) / (np.hypot(east_deg, north_deg) or 1.0)
    axis = np.array([[0.0, 0.0, e], [0.0, 0.0, n], [-e, -n, 0.0]])  # × of (−n, e, 0): turns up towards (e, n)
    leaning = np.eye(3) + np.sin(lean) * axis + (1.0 - np.cos(lean)) * axis @ axis  # columns: its axes in ENU
    c, s = np.cos(np.radians(orientation_deg)), np.sin(np.radians(orientation_deg))
    return np.array([[c, -s, 0.0], [s, c, 0.0], [0.0, 0.0, 1.0]]) @ leaning.T


def polar_to_enu(
    range_m: np.ndarray,
    azimuth_rad: np.ndarray,
    elevation_rad: np.ndarray,
    offset_m: np.ndarray,
    rotation: np.ndarray,
) -> np.ndarray:
    """(n, 3) station ENU of what one instrument saw, its offset (3,) and rotation (3, 3) from ``place``."""
    with np.errstate(invalid="ignore"):  # a damaged value may be infinite: then there is no position
        east, north = np.sin(azimuth_rad), np.cos(azimuth_rad)
        level, up = np.cos(elevation_rad), np.sin(elevation_rad)
        seen = np.asarray(range_m)[..., None] * np.stack([level * east, level * north, up], axis=-1)
    return offset_m + seen @ rotation


def origin_frame(station: Station) -> Frame:
    """The station's own frame. Raises ``InputError`` where it has no origin."""
    origin = station.range.origin
    if origin is None:
        raise InputError("[range] origin in the station file is missing: every frame hangs on it")
    return Frame(origin.lat_deg, origin.lon_deg, origin.alt_m)


def frame_of(scene: Scene) -> Frame:
    """Station ENU of what a station has published."""
    return Frame(scene.origin_lat_deg, scene.origin_lon_deg, scene.origin_alt_m)


def scene(station: Station, frame: Frame) -> Scene:
    """What stands still, for the views."""

    def instrument(sensor: SensorSection) -> Instrument:
        offset, _ = frame.place_sensor(sensor)
        return Instrument(name=sensor.name, kind=sensor.kind, position_enu_m=tuple(offset.tolist()))

    return Scene(
        range=station.range.name,
        vehicle=station.vehicle.name,
        origin_lat_deg=frame.lat_deg,
        origin_lon_deg=frame.lon_deg,
        origin_alt_m=frame.alt_m,
        instruments=[instrument(sensor) for sensor in station.sensor],
    )
