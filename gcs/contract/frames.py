"""Between WGS84 and the local frames, through pymap3d. Nothing else in the station does geodesy."""

from typing import NamedTuple

import numpy as np
import pymap3d
from numpy.typing import ArrayLike

from gcs.contract.config import Position, SensorSection, Station
from gcs.contract.messages import InputError, Instrument, Scene


class Frame(NamedTuple):
    """Station ENU: East-North-Up at the origin, WGS84 degrees and ellipsoidal metres."""

    lat_deg: float
    lon_deg: float
    alt_m: float

    def to_enu(self, lat_deg: ArrayLike, lon_deg: ArrayLike, alt_m: ArrayLike) -> np.ndarray:
        """(n, 3) station ENU in m of WGS84 positions, each (n,)."""
        return np.stack(pymap3d.geodetic2enu(lat_deg, lon_deg, alt_m, *self), axis=-1)

    def to_geodetic(self, enu_m: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """lat_deg, lon_deg, alt_m, each (n,), of (n, 3) station ENU."""
        return pymap3d.enu2geodetic(*np.moveaxis(enu_m, -1, 0), *self)

    def turn(self, vectors: np.ndarray, lat_deg: np.ndarray, lon_deg: np.ndarray) -> np.ndarray:
        """(n, 3) vectors in the local ENU frames at (lat, lon), each (n,), turned into station ENU."""
        ecef = np.stack(pymap3d.enu2uvw(*np.moveaxis(vectors, -1, 0), lat_deg, lon_deg), axis=-1)
        return ecef @ ecef_to_enu(self.lat_deg, self.lon_deg).T

    def place(self, position: Position) -> tuple[np.ndarray, np.ndarray]:
        """An instrument's offset (3,) in station ENU, and its rotation (3, 3) station ENU → sensor ENU."""
        offset = self.to_enu(position.lat_deg, position.lon_deg, position.alt_m)
        here, there = ecef_to_enu(self.lat_deg, self.lon_deg), ecef_to_enu(position.lat_deg, position.lon_deg)
        return offset, there @ here.T

    def place_sensor(self, sensor: SensorSection) -> tuple[np.ndarray, np.ndarray]:
        """`place` of an instrument as it is mounted: it may lean, and its azimuth begin elsewhere."""
        offset, rotation = self.place(sensor.position)
        return offset, mount(sensor.tilt_deg.east, sensor.tilt_deg.north, sensor.orientation_deg) @ rotation


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
