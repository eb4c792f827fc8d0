"""What an autopilot's MAVLink fields mean: one formula each, for single messages and for columns alike.

Fields and units: https://mavlink.io/en/messages/common.html (GLOBAL_POSITION_INT, GPS_RAW_INT, ATTITUDE,
RAW_IMU, SCALED_IMU, SCALED_IMU2, HIGHRES_IMU, WIND_COV) and ardupilotmega.html (WIND). Body axes are
forward, right, down; MAVLink's local axes are north, east, down.

VFR_HUD carries the airspeed; where no pitot tube is fitted, an autopilot fills in what it guesses.
"""

from collections.abc import Sequence
from typing import Any

import numpy as np

from gcs.contract.messages import GRAVITY_MPS2

MILLI_G = GRAVITY_MPS2 / 1000  # what ArduPilot divides by to get its mG
IMUS = {
    "HIGHRES_IMU": 1.0,
    "SCALED_IMU": MILLI_G,
    "RAW_IMU": MILLI_G,
    "SCALED_IMU2": MILLI_G,
}  # best first: unit in m/s²
IMU_SAMPLES = 20  # an accelerometer is believed after so many
IMU_RANGE = (0.7 * GRAVITY_MPS2, 1.3 * GRAVITY_MPS2)  # their median; PX4 may send raw counts in RAW_IMU
ATTITUDE_AGE_NS = 100_000_000  # turned further than this, the body rates no longer say where it points
FIX_3D = 3  # GPS_FIX_TYPE_3D_FIX
RECEIVERS = ("GPS_RAW_INT", "GPS2_RAW")  # an autopilot with two goes on with one
GPS_SILENT_MS = 3_000  # they come at least once a second; two in a row may be lost on the way
NULL_ISLAND_E7 = 100_000  # 0.01°: an estimator without origin reports positions around 0, 0
SAME_HEIGHT_MM = 1_000  # above home and above the sea: home is at sea level, or not set yet
WRONG_HEIGHT_MM = 100_000  # barometer and receiver do not differ by so much
GEOID_LIMIT_M = 120.0  # the geoid lies −107 … +86 m from the ellipsoid
CLIMB_MPS, CLIMB_STEP_S = 1.0, 2.0  # between two positions: climbing or sinking that tells up from down
CLIMB_SAMPLES = 5  # enough of it: where vz is right, no three in a row were against it, of 9,000 in 8 flights
UNIX_US = 10**15  # a time_usec above this is UTC, below it is time since boot (MAVLink's own rule)
DIFFERENTIAL_PRESSURE = 0x10  # MAV_SYS_STATUS_SENSOR: a pitot tube is fitted
FIXED_WING = 1  # MAV_TYPE_FIXED_WING
NO_AUTOPILOT = 8  # MAV_AUTOPILOT_INVALID: ground stations, gimbals, companions

Number = Any  # a float or int of one message live, (n,) of all messages of a log; so is what comes out


def has_position(lat: Number, lon: Number, alt: Number, relative_alt: Number, gps_alt: Number) -> Number:
    """Is GLOBAL_POSITION_INT (degE7, mm) a position at all? ``gps_alt`` mm is the receiver's, NaN if unknown.

    Just after the first fix an estimator may have a place and no height yet: it then reports the same height
    above home and above sea level, and the receiver another.
    """
    somewhere = (abs(lat) > NULL_ISLAND_E7) | (abs(lon) > NULL_ISLAND_E7)
    no_datum = (abs(alt - relative_alt) < SAME_HEIGHT_MM) & (abs(alt - gps_alt) > WRONG_HEIGHT_MM)
    return somewhere & ~no_datum


def is_lost(fix_type: Number, silent_ms: Number) -> Number:
    """Has a receiver lost its position, so that without another one GLOBAL_POSITION_INT is dead reckoning?

    ``fix_type`` of its newest message; ``silent_ms`` from the first position since then to the one before
    this: a gap in the link is no silence of the receiver. ArduPilot and PX4 go on telling of a receiver
    without a fix, older PX4s fall silent. Their EKF flags are no witness: they stay good while the filter
    trusts its own reckoning, and may be bad at rest, where the position is the receiver's.
    """
    return (fix_type < FIX_3D) | (silent_ms > GPS_SILENT_MS)


def position_velocity(
    lat: Number, lon: Number, alt: Number, vx: Number, vy: Number, vz: Number
) -> tuple[Number, Number, Number, Number, Number, Number]:
    """(lat_deg, lon_deg, alt_msl_m, ve, vn, vu m/s) of GLOBAL_POSITION_INT (degE7, mm, cm/s NED)."""
    return lat * 1e-7, lon * 1e-7, alt * 1e-3, vy * 1e-2, vx * 1e-2, vz * -1e-2


def vz_is_upward(t_ns: np.ndarray, alt_m: np.ndarray, vu_mps: np.ndarray) -> bool | None:
    """Does the reported climb rate run against the reported height, each (n,)? None: it has not shown.

    GLOBAL_POSITION_INT.vz is positive down, but early ArduCopters sent it positive up.
    """
    step_s = np.diff(t_ns) / 1e9
    usual = (step_s > 0.0) & (step_s < CLIMB_STEP_S)
    climb, said = np.diff(alt_m)[usual] / step_s[usual], 0.5 * (vu_mps[1:] + vu_mps[:-1])[usual]
    moving = (np.abs(climb) > CLIMB_MPS) & (np.abs(said) > CLIMB_MPS)
    against = np.count_nonzero(climb[moving] * said[moving] < 0.0)
    share = against / max(1, moving.sum())
    return bool(share > 0.5) if moving.sum() >= CLIMB_SAMPLES and not 0.1 <= share <= 0.9 else None


def geoid_separation_m(fix_type: Number, alt: Number, alt_ellipsoid: Number) -> Number:
    """Ellipsoidal minus mean-sea-level height in m of GPS_RAW_INT (mm), NaN where it does not say.

    ``alt_ellipsoid`` is a MAVLink 2 extension: zero when the sender does not know it.
    """
    separation = (np.float64(alt_ellipsoid) - alt) * 1e-3
    known = (fix_type >= FIX_3D) & (alt_ellipsoid != 0) & (abs(separation) <= GEOID_LIMIT_M)
    return np.where(known, separation, np.nan)[()]


def wind_en(direction: Number, speed: Number) -> tuple[Number, Number]:
    """(east, north) m/s, where the air goes, of ArduPilot's WIND (degrees it comes from, m/s).

    Of a direction that is no number it is none.
    """
    with np.errstate(invalid="ignore"):  # a damaged frame may say inf
        return -speed * np.sin(np.radians(direction)), -speed * np.cos(np.radians(direction))


def wind_cov_en(wind_x: Number, wind_y: Number) -> tuple[Number, Number]:
    """(east, north) m/s, where the air goes, of PX4's WIND_COV (m/s north, m/s east, also where it goes)."""
    return wind_y, wind_x


def is_accelerometer(force: Sequence[np.ndarray] | np.ndarray) -> bool:
    """Do the first specific forces ((n, 3), m/s²) of a message type measure about one g?"""
    if len(force) < IMU_SAMPLES:
        return False
    median = np.median(np.linalg.norm(force[:IMU_SAMPLES], axis=-1))
    return bool(IMU_RANGE[0] <= median <= IMU_RANGE[1])


def acceleration_enu(
    force: np.ndarray, attitude: np.ndarray, rates: np.ndarray, age_s: np.ndarray | float
) -> np.ndarray:
    """(..., 3) kinematic acceleration in local ENU, m/s².

    ``force`` (..., 3) specific force in body axes, m/s²; ``attitude`` (..., 3) roll, pitch, yaw in rad and
    ``rates`` (..., 3) body rates in rad/s, both ``age_s`` (...) older than the force. The attitude is carried
    on by the rates (to second order: 0.5 % at 0.3 rad), then the force turns by roll, pitch, yaw (Stevens &
    Lewis, Aircraft Control and Simulation, eq. 1.3-20) and gravity is added.
    """
    turn = rates * np.asarray(age_s)[..., None]
    once = np.cross(turn, force)
    x, y, z = np.moveaxis(force + once + 0.5 * np.cross(turn, once), -1, 0)
    (sr, sp, sy), (cr, cp, cy) = np.moveaxis(np.sin(attitude), -1, 0), np.moveaxis(np.cos(attitude), -1, 0)
    level = sr * y + cr * z
    ahead, right, down = cp * x + sp * level, cr * y - sr * z, cp * level - sp * x
    return np.stack([sy * ahead + cy * right, cy * ahead - sy * right, -(down + GRAVITY_MPS2)], axis=-1)
