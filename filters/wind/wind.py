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
from numpy.typing import ArrayLike

from filters.models.update import update
from filters.models.update import weight as weight_of
from filters.wind.arf import ALPHA_FLOOR, sandwich, times

SEA_LEVEL_K, LAPSE_KPM, EXPONENT = 288.15, 0.0065, 5.25588  # ISO 2533: T = T0 − L h, p = p0 (T/T0)^EXPONENT
N = 8
PE, PN, ME, MN, GE, GN, SCALE, HEADING = range(N)


class WindSettings(NamedTuple):
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
    k0: float = 1.0  # three-segment weight of a measurement; gusts are in its sigma, so 3 is far out
    k1: float = 3.0
    c0: float = 3.0  # the same for the prediction, judged by the mean residual
    c1: float = 8.0
    memory_s: float = 5.0  # of that mean; refused for so long, and it is the wind that has changed


class MeanWind(NamedTuple):
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


def true_airspeed(
    calibrated_mps: ArrayLike, alt_msl_m: ArrayLike, temperature_k: ArrayLike | None = None
) -> float | np.ndarray:
    """True airspeed of a calibrated one: CAS √(ρ0/ρ), incompressible (below 100 m/s within 0.5 %).

    Pressure by the standard atmosphere at ``alt_msl_m``; so is the temperature, unless that of the outside
    air is given. Scalars or arrays.
    """
    ratio = 1.0 - LAPSE_KPM * np.asarray(alt_msl_m, float) / SEA_LEVEL_K
    temperature_k = SEA_LEVEL_K * ratio if temperature_k is None else temperature_k
    return calibrated_mps * np.sqrt(temperature_k / SEA_LEVEL_K / ratio**EXPONENT)


class WindEstimator:
    """One aircraft's wind, from the first airspeed on."""

    def __init__(self, settings: WindSettings = WindSettings(), *, coordinated: bool = True):  # noqa: B008
        """``coordinated``: a fixed wing, whose nose points where it flies through the air."""
        self.settings, self.coordinated = WindSettings(*map(float, settings)), coordinated
        self._x, self._P = np.zeros(N), np.zeros((N, N))
        _forget(self._x, self._P, self.settings)
        self._evidence, self._t_ns = np.zeros((2, 2)), None

    def step(self, t_ns: int, tas_mps: float, attitude: np.ndarray, velocity: np.ndarray) -> MeanWind:
        """Take in what was valid at one instant.

        ``attitude`` (3,) roll, pitch, yaw in rad, from true north; ``velocity`` (3,) fused, ground, ENU, m/s.
        An airspeed below ``least_mps``, or anything not finite, only lets time pass; what is not later than
        the last is left out.
        """
        dt_s = 0.0 if self._t_ns is None else (t_ns - self._t_ns) * 1e-9
        if self._t_ns is None or dt_s > 0.0:
            self._t_ns = t_ns
            _advance(self._x, self._P, dt_s, self.settings)
            attitude, velocity = np.asarray(attitude, float), np.asarray(velocity, float)
            if tas_mps >= self.settings.least_mps and np.isfinite([*attitude, *velocity]).all():
                _learn(
                    self._x, self._P, dt_s, tas_mps, attitude, velocity, self.coordinated, self._evidence,
                    self.settings,
                )  # fmt: skip
        return self.wind

    @property
    def wind(self) -> MeanWind:
        """The newest estimate."""
        covariance = self._P[ME:GE, ME:GE].copy()
        known = np.linalg.eigvalsh(covariance)[-1] <= self.settings.observable_mps**2
        return MeanWind(self._t_ns or 0, self._x[ME:GE].copy(), covariance, bool(known), 1.0 + self._x[SCALE])

    def carry(self, t_ns: int, position: np.ndarray, covariance: np.ndarray) -> "DeadReckoning":
        """Go on from the last position, east and north (2,) m with covariance (2, 2)."""
        return DeadReckoning(self, t_ns, position, covariance)


class DeadReckoning:
    """The way on by air data plus wind: every error of both grows in the covariance."""

    def __init__(self, wind: WindEstimator, t_ns: int, position: np.ndarray, covariance: np.ndarray):
        self._x, self._P, self._settings = wind._x.copy(), wind._P.copy(), wind.settings
        self._x[:ME], self._P[:ME, :ME] = position, covariance
        self._t_ns = t_ns

    def step(self, t_ns: int, tas_mps: float, attitude: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Position east, north (2,) m and its covariance (2, 2) at ``t_ns``.

        Arguments as for the wind, all finite: where one is missing, the last one goes on.
        """
        dt_s, self._t_ns = (t_ns - self._t_ns) * 1e-9, t_ns
        _move(self._x, self._P, dt_s, tas_mps, np.asarray(attitude, float))
        _advance(self._x, self._P, dt_s, self._settings)
        return self._x[:ME].copy(), self._P[:ME, :ME].copy()


@njit(cache=True)
def _forget(x, P, s):
    """Nothing is known but the priors."""
    x[ME:] = 0.0
    P[:] = 0.0
    P[ME, ME] = P[MN, MN] = s.wind_mps**2
    P[GE, GE] = P[GN, GN] = s.gust_mps**2
    P[SCALE, SCALE], P[HEADING, HEADING] = s.scale**2, s.heading_rad**2


@njit(cache=True)
def _advance(x, P, dt, s):
    """Let ``dt`` seconds pass: wind walks, gusts and heading error decay towards their balance."""
    P[ME, ME] += s.wind_walk**2 * dt
    P[MN, MN] += s.wind_walk**2 * dt
    _decay(x, P, GE, np.exp(-dt / s.gust_tau_s), s.gust_mps)
    _decay(x, P, GN, np.exp(-dt / s.gust_tau_s), s.gust_mps)
    _decay(x, P, HEADING, np.exp(-dt / s.heading_tau_s), s.heading_rad)


@njit(cache=True)
def _decay(x, P, k, phi, sigma):
    """One step of a first-order Markov state whose 1-sigma in balance is ``sigma``."""
    x[k] *= phi
    for j in range(N):
        P[k, j] *= phi
        P[j, k] *= phi
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
        if P[ME, ME] >= s.wind_mps**2 and P[MN, MN] >= s.wind_mps**2:
            _guess(x, tas, attitude, velocity)
        turned = attitude.copy()
        turned[2] -= x[HEADING]
        wing, by_yaw = _right_wing(turned)
        air = _through_air(x, velocity)
        h[ME] = h[GE] = -wing[0]
        h[MN] = h[GN] = -wing[1]
        h[HEADING] = -by_yaw @ air
        _weigh(x, P, h, -wing @ air, (s.sideslip_rad * tas) ** 2, dt, evidence[0], s)
    air = _through_air(x, velocity)
    speed = np.sqrt(air @ air)
    if speed > 0.0:
        h[:] = 0.0
        h[ME] = h[GE] = -air[0] / speed
        h[MN] = h[GN] = -air[1] / speed
        h[SCALE] = -tas
        _weigh(x, P, h, tas * (1.0 + x[SCALE]) - speed, s.airspeed_mps**2, dt, evidence[1], s)


@njit(cache=True)
def _guess(x, tas, attitude, velocity):
    """The wind triangle as it stands: not evidence yet, but the place to linearise at."""
    x[ME] = velocity[0] - tas * np.cos(attitude[1]) * np.sin(attitude[2])
    x[MN] = velocity[1] - tas * np.cos(attitude[1]) * np.cos(attitude[2])


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
    spread = times(P, h)
    u = innovation / np.sqrt(spread @ h + variance)
    weight = weight_of(u, s.k0, s.k1)
    evidence[1] = evidence[1] + dt if weight == 0.0 else 0.0
    if evidence[1] > s.memory_s:
        _forget(x, P, s)
        evidence[:] = 0.0
    elif weight > 0.0:
        fresh = 1.0 - np.exp(-dt / s.memory_s)
        evidence[0] += fresh * (u - evidence[0])
        delta = evidence[0] * np.sqrt(2.0 * s.memory_s / s.correlation_s)
        alpha = max(weight_of(delta, s.c0, s.c1), ALPHA_FLOOR)
        P[ME, ME] *= 1.0 + fresh * (1.0 / alpha - 1.0)
        P[MN, MN] *= 1.0 + fresh * (1.0 / alpha - 1.0)
        spread = times(P, h)
        # errors that last for many samples count once
        repeated = max(1.0, s.correlation_s / dt) if dt > 0.0 else 1.0
        update(x, P, spread, innovation, spread @ h + variance * repeated / weight)


@njit(cache=True)
def _move(x, P, dt, tas, attitude):
    """Position by ``dt`` seconds of airspeed along the nose, plus wind."""
    yaw = attitude[2] - x[HEADING]
    level = tas * np.cos(attitude[1])
    east, north = level * np.sin(yaw), level * np.cos(yaw)
    scale = 1.0 + x[SCALE]
    F = np.zeros((N, N))
    for k in range(N):
        F[k, k] = 1.0
    F[PE, ME] = F[PE, GE] = F[PN, MN] = F[PN, GN] = dt
    F[PE, SCALE], F[PN, SCALE] = dt * east, dt * north
    F[PE, HEADING], F[PN, HEADING] = -dt * scale * north, dt * scale * east
    x[PE] += dt * (scale * east + x[ME] + x[GE])
    x[PN] += dt * (scale * north + x[MN] + x[GN])
    P[:] = sandwich(F, P)
