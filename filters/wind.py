"""Wind from airspeed, attitude and ground velocity, and the way on by air data when every position is lost.

The wind triangle: ground velocity = air velocity + wind. Two scalar measurements of it:

    |v − w| = (1 + κ) TAS        needs turns: on a straight leg κ and a head wind look the same
    y · (v − w) = 0              fixed wing only: it flies without sideslip, y is its right wing

State (8): position east, north (in dead reckoning only), mean wind east, north (random walk), gust east,
north (first-order Markov, e^(−h/L)), scale error κ of the airspeed, heading error b (Markov). The mean wind
is where the air goes; ``from_deg`` is where it comes from.
"""

from typing import NamedTuple

import numpy as np
from numba import njit

from filters.arf import ALPHA_FLOOR, three_segments

SEA_LEVEL_K, LAPSE_KPM, EXPONENT = 288.15, 0.0065, 5.25588  # ISO 2533: T = T0 − L h, p = p0 (T/T0)^EXPONENT
N = 8
PE, PN, ME, MN, GE, GN, SCALE, HEADING = range(N)


class Settings(NamedTuple):
    """What is assumed about air, airspeed sensor and heading; all 1-sigma."""

    wind_mps: float = 10.0  # of the mean wind before anything is known
    wind_walk: float = 0.05  # m/s per √s: 0.4 m/s after a minute
    gust_mps: float = 0.8  # light to moderate turbulence
    gust_tau_s: float = 3.0
    scale: float = 0.05  # pitot position error and calibration
    heading_rad: float = 0.05  # magnetometer and mean sideslip
    heading_tau_s: float = 120.0
    airspeed_mps: float = 0.5
    sideslip_rad: float = 0.05
    correlation_s: float = 1.0  # sideslip and airspeed errors last so long: faster samples say no more
    least_mps: float = 8.0  # below it a pitot tube measures its own noise
    observable_mps: float = 1.0  # largest 1-sigma of the mean wind that is called known
    k0: float = 2.0  # three-segment weight of a measurement
    k1: float = 6.0
    c0: float = 1.5  # the same for the prediction, judged by the mean residual
    c1: float = 6.0
    memory_s: float = 5.0  # of that mean; refused for so long, and it is the wind that has changed


class Wind(NamedTuple):
    """The mean wind. East and north: where the air goes."""

    t_ns: int
    en_mps: np.ndarray  # (2,)
    covariance: np.ndarray  # (2, 2)
    observable: bool
    airspeed_scale: float  # true airspeed = scale × measured

    @property
    def speed_mps(self) -> float:
        return float(np.hypot(*self.en_mps))

    @property
    def from_deg(self) -> float:
        """Direction it blows from, clockwise from true north."""
        return float(np.degrees(np.arctan2(-self.en_mps[0], -self.en_mps[1])) % 360.0)


def true_airspeed(calibrated_mps, alt_msl_m, temperature_k=None):
    """True airspeed of a calibrated one: CAS √(ρ0/ρ), incompressible (below 100 m/s within 0.5 %).

    Pressure by the standard atmosphere at ``alt_msl_m``; so is the temperature, unless that of the outside
    air is given. Scalars or arrays.
    """
    ratio = 1.0 - LAPSE_KPM * np.asarray(alt_msl_m, float) / SEA_LEVEL_K
    temperature_k = SEA_LEVEL_K * ratio if temperature_k is None else temperature_k
    return calibrated_mps * np.sqrt(temperature_k / SEA_LEVEL_K / ratio**EXPONENT)


class WindEstimator:
    """One aircraft's wind, from the first airspeed on."""

    def __init__(self, settings: Settings = Settings(), coordinated: bool = True):  # noqa: B008
        """``coordinated``: a fixed wing, whose nose points where it flies through the air."""
        self.settings, self.coordinated = settings, coordinated
        self._parameters = np.array(settings)
        self._x, self._P = np.zeros(N), np.zeros((N, N))
        _forget(self._x, self._P, self._parameters)
        self._evidence, self._t_ns = np.zeros((2, 2)), None

    def step(self, t_ns: int, tas_mps: float, attitude: np.ndarray, velocity: np.ndarray) -> Wind:
        """Take in what was valid at one instant.

        ``attitude`` (3,) roll, pitch, yaw in rad, from true north; ``velocity`` (3,) fused, ground, ENU, m/s.
        Airspeeds below ``least_mps``, not finite, or not later than the last one only let time pass.
        """
        dt_s = 0.0 if self._t_ns is None else (t_ns - self._t_ns) * 1e-9
        if self._t_ns is None or dt_s > 0.0:
            self._t_ns = t_ns
            _advance(self._x, self._P, dt_s, self._parameters)
            if tas_mps >= self.settings.least_mps:
                _learn(
                    self._x, self._P, dt_s, tas_mps, np.asarray(attitude, float), np.asarray(velocity, float),
                    self.coordinated, self._evidence, self._parameters,
                )  # fmt: skip
        return self.wind

    @property
    def wind(self) -> Wind:
        """The newest estimate."""
        covariance = self._P[ME:GE, ME:GE].copy()
        known = np.linalg.eigvalsh(covariance)[-1] <= self.settings.observable_mps**2
        return Wind(self._t_ns or 0, self._x[ME:GE].copy(), covariance, bool(known), 1.0 + self._x[SCALE])

    def carry(self, t_ns: int, position: np.ndarray, covariance: np.ndarray) -> "DeadReckoning":
        """Go on from the last position, east and north (2,) m with covariance (2, 2)."""
        return DeadReckoning(self, t_ns, position, covariance)


class DeadReckoning:
    """The way on by air data plus wind: every error of both grows in the covariance."""

    def __init__(self, wind: WindEstimator, t_ns: int, position: np.ndarray, covariance: np.ndarray):
        self._x, self._P, self._parameters = wind._x.copy(), wind._P.copy(), wind._parameters
        self._x[:ME], self._P[:ME, :ME] = position, covariance
        self._t_ns = t_ns

    def step(self, t_ns: int, tas_mps: float, attitude: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Position east, north (2,) m and its covariance (2, 2) at ``t_ns``; arguments as for the wind."""
        dt_s, self._t_ns = (t_ns - self._t_ns) * 1e-9, t_ns
        _move(self._x, self._P, dt_s, tas_mps, np.asarray(attitude, float))
        _advance(self._x, self._P, dt_s, self._parameters)
        return self._x[:ME].copy(), self._P[:ME, :ME].copy()


@njit(cache=True)
def _forget(x, P, s):
    """Nothing is known but the priors."""
    wind_mps, gust_mps, scale, heading = s[0], s[2], s[4], s[5]
    x[ME:] = 0.0
    P[:] = 0.0
    for k, sigma in enumerate((wind_mps, wind_mps, gust_mps, gust_mps, scale, heading)):
        P[ME + k, ME + k] = sigma**2


@njit(cache=True)
def _advance(x, P, dt, s):
    """Let ``dt`` seconds pass: wind walks, gusts and heading error decay towards their balance."""
    wind_walk, gust_mps, gust_tau, heading, heading_tau = s[1], s[2], s[3], s[5], s[6]
    P[ME, ME] += wind_walk**2 * dt
    P[MN, MN] += wind_walk**2 * dt
    for k, sigma, tau in (
        (GE, gust_mps, gust_tau),
        (GN, gust_mps, gust_tau),
        (HEADING, heading, heading_tau),
    ):
        phi = np.exp(-dt / tau)
        x[k] *= phi
        P[k, :] *= phi
        P[:, k] *= phi
        P[k, k] += sigma**2 * (1.0 - phi * phi)


@njit(cache=True)
def _right_wing(attitude):
    """Right wing's direction (3,) ENU and its derivative by yaw (Stevens & Lewis, eq. 1.3-20)."""
    sr, cr, sp, cp = np.sin(attitude[0]), np.cos(attitude[0]), np.sin(attitude[1]), np.cos(attitude[1])
    sy, cy = np.sin(attitude[2]), np.cos(attitude[2])
    north, east, up = sr * sp * cy - cr * sy, sr * sp * sy + cr * cy, -sr * cp
    return np.array([east, north, up]), np.array([north, -east, 0.0])


@njit(cache=True)
def _learn(x, P, dt, tas, attitude, velocity, coordinated, evidence, s):
    """Both measurements, one after the other."""
    h = np.zeros(N)
    if coordinated:
        turned = attitude.copy()
        turned[2] -= x[HEADING]
        wing, by_yaw = _right_wing(turned)
        air = _through_air(x, velocity)
        h[ME] = h[GE] = -wing[0]
        h[MN] = h[GN] = -wing[1]
        h[HEADING] = -by_yaw @ air
        _weigh(x, P, h, -wing @ air, (s[8] * tas) ** 2, dt, evidence[0], s)
    air = _through_air(x, velocity)
    speed = np.sqrt(air @ air)
    if speed > 0.0:
        h[:] = 0.0
        h[ME] = h[GE] = -air[0] / speed
        h[MN] = h[GN] = -air[1] / speed
        h[SCALE] = -tas
        _weigh(x, P, h, tas * (1.0 + x[SCALE]) - speed, s[7] ** 2, dt, evidence[1], s)


@njit(cache=True)
def _through_air(x, velocity):
    """Velocity through the air (3,) ENU."""
    return velocity - np.array([x[ME] + x[GE], x[MN] + x[GN], 0.0])


@njit(cache=True)
def _weigh(x, P, h, innovation, variance, dt, evidence, s):
    """Kalman update by one scalar: the measurement with its weight, the wind's prediction with its own.

    ``evidence`` holds the mean standardised residual and the seconds since one was accepted. A measurement
    off by chance is off once: it loses weight. A wind that has changed is off all the time, in one sense.
    """
    correlation_s, memory_s = s[9], s[15]
    u = innovation / np.sqrt(h @ P @ h + variance)
    weight = three_segments(u, s[11], s[12])
    evidence[1] = evidence[1] + dt if weight == 0.0 else 0.0
    if evidence[1] > memory_s:
        _forget(x, P, s)
        evidence[:] = 0.0
    elif weight > 0.0:
        fresh = 1.0 - np.exp(-dt / memory_s)
        evidence[0] += fresh * (u - evidence[0])
        delta = evidence[0] * np.sqrt(2.0 * memory_s / correlation_s)
        alpha = max(three_segments(delta, s[13], s[14]), ALPHA_FLOOR)
        for k in (ME, MN):
            P[k, k] *= 1.0 + fresh * (1.0 / alpha - 1.0)
        # errors that last for many samples count once
        spread, repeated = P @ h, max(1.0, correlation_s / dt) if dt > 0.0 else 1.0
        S = h @ spread + variance * repeated / weight
        x += spread * (innovation / S)
        P -= np.outer(spread, spread) / S
        P[:] = 0.5 * (P + P.T)


@njit(cache=True)
def _move(x, P, dt, tas, attitude):
    """Position by ``dt`` seconds of airspeed along the nose, plus wind."""
    yaw = attitude[2] - x[HEADING]
    level = tas * np.cos(attitude[1])
    east, north = np.sin(yaw), np.cos(yaw)
    F = np.eye(N)
    F[PE, ME] = F[PE, GE] = F[PN, MN] = F[PN, GN] = dt
    F[PE, SCALE], F[PN, SCALE] = dt * level * east, dt * level * north
    F[PE, HEADING], F[PN, HEADING] = (
        -dt * level * (1.0 + x[SCALE]) * north,
        dt * level * (1.0 + x[SCALE]) * east,
    )
    x[PE] += dt * (level * (1.0 + x[SCALE]) * east + x[ME] + x[GE])
    x[PN] += dt * (level * (1.0 + x[SCALE]) * north + x[MN] + x[GN])
    P[:] = F @ P @ F.T
