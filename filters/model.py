"""The estimator's state for a given set of sensors, and what any row says about it, as arrays for numba."""

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from numba import njit

from filters import ins, motion, theodolite
from filters.rows import AZIMUTH, CHANNELS, ELEVATION, RANGE, RANGE_RATE, E, Sensor
from filters.unscented import transform, transform_position

SLOTS = (
    11  # the most state entries one row can depend on: position, velocity, acceleration, clock, zero error
)


class Model(NamedTuple):
    """s sensors, n states. Indices into the state are −1 where the sensor has no such error."""

    is_ins: np.ndarray  # (s,) bool
    variance: np.ndarray  # (s, 13) of the noise per channel, NaN where the sensor has none
    offset: np.ndarray  # (s, 3) station ENU, m
    rotation: np.ndarray  # (s, 3, 3) station ENU → sensor ENU
    bend: np.ndarray  # (s,) refraction, rad per metre
    bias_at: np.ndarray  # (s, 13) state index of the channel's zero error
    clock_at: np.ndarray  # (s,) state index of clock offset or latency, s: value valid at stamp − offset
    rate: np.ndarray  # (n,) 1/τ of each Gauss-Markov state, 0 for constants, 1/s
    prior: np.ndarray  # (n,) variance of each systematic error before the first row; the core's entries are 0
    jerk_psd: float


def build(
    sensors: Sequence[Sensor], jerk_psd: float, ins_bias_sigma_m: float, ins_bias_tau_s: float
) -> Model:
    """The state is p, v, a, then per sensor its zero errors and its clock, in the sensors' order.

    Instruments have those they are asked to estimate, an INS has always its position error and its latency.
    """
    bias_at = np.full((len(sensors), len(CHANNELS)), -1)
    clock_at = np.full(len(sensors), -1)
    rate, prior = [0.0] * motion.CORE, [0.0] * motion.CORE
    for s, sensor in enumerate(sensors):
        inertial = sensor.kind == "ins"
        if inertial:
            zeros = {E + axis: ins_bias_sigma_m for axis in range(3)}
        else:
            usual = sensor.zero_sigma or theodolite.ZERO_SIGMA
            zeros = (
                dict(zip((RANGE, AZIMUTH, ELEVATION), usual, strict=True))
                if "bias" in sensor.estimate
                else {}
            )
        for channel, sigma in zeros.items():
            if np.isfinite(sensor.sigma[channel]):
                bias_at[s, channel] = len(prior)
                prior.append(sigma**2)
                rate.append(1.0 / ins_bias_tau_s if inertial else 0.0)
        if inertial or "clock" in sensor.estimate:
            clock_at[s] = len(prior)
            usual_s = ins.LATENCY_SIGMA_S if inertial else theodolite.CLOCK_SIGMA_S
            prior.append((sensor.clock_sigma_s or usual_s) ** 2)
            rate.append(0.0)
    return Model(
        is_ins=np.array([sensor.kind == "ins" for sensor in sensors]),
        variance=np.array([sensor.sigma for sensor in sensors], float) ** 2,
        offset=np.array([sensor.offset_m for sensor in sensors], float),
        rotation=np.array([sensor.rotation for sensor in sensors], float),
        bend=np.array(
            [theodolite.REFRACTION[s.refraction] / (2 * theodolite.EARTH_RADIUS_M) for s in sensors]
        ),
        bias_at=bias_at,
        clock_at=clock_at,
        rate=np.array(rate),
        prior=np.array(prior),
        jerk_psd=float(jerk_psd),
    )


def floating(model: Model) -> bool:
    """Whether every sensor's clock is to be estimated, so that none says what the time is."""
    return bool(np.all(model.clock_at >= 0))


def prior_covariance(model: Model) -> np.ndarray:
    """(n, n) of the systematic errors before the first row, zero in the core.

    A shift common to all clocks changes no residual. Where they all float, its share is taken out, so that
    linearisation errors cannot make the filter believe that it had seen one (as in Huang, Mourikis &
    Roumeliotis 2010, *Observability-based rules for consistent EKF SLAM*).
    """
    P = np.diag(model.prior)
    if floating(model):
        P[np.ix_(model.clock_at, model.clock_at)] -= common_variance(model)
    return P


def common_variance(model: Model) -> float:
    """Variance, s², of the shift common to all clocks, by their priors; 0 where a clock is known."""
    return 1.0 / np.sum(1.0 / model.prior[model.clock_at]) if floating(model) else 0.0


def common_shift(model: Model, x: np.ndarray) -> float:
    """What to take off all clocks of state ``x`` (n,), s: the weighted median, so most are right."""
    if not floating(model):
        return 0.0
    order = np.argsort(x[model.clock_at])
    weight = np.cumsum(1.0 / model.prior[model.clock_at][order])
    return float(x[model.clock_at][order][np.searchsorted(weight, weight[-1] / 2)])


@njit(cache=True, fastmath=True)
def predict_row(model, sensor, channel, x, P, index, gain, m, work):
    """What the state says about one row: (predicted value, its variance without noise, non-zero derivatives).

    The gradient goes to ``index``, ``gain`` (SLOTS,), the cross-covariance P h to ``m`` (n,).
    """
    bias, clock = model.bias_at[sensor, channel], model.clock_at[sensor]
    extra = 0.0
    if model.is_ins[sensor]:
        value, count = ins.observe(channel, x, bias, clock, index, gain)
    else:
        value, extra, count = _observe_instrument(model, sensor, channel, x, P, clock, index, gain, work)
        if bias >= 0:
            index[count], gain[count] = bias, 1.0
            value += x[bias]
            count += 1
    n = x.size
    row, factor = P[index[0]], gain[0]
    for j in range(n):
        m[j] = factor * row[j]
    for k in range(1, count):
        row, factor = P[index[k]], gain[k]
        for j in range(n):
            m[j] += factor * row[j]
    variance = extra
    for k in range(count):
        variance += gain[k] * m[index[k]]
    return value, variance, count


@njit(cache=True, fastmath=True)
def _observe_instrument(model, sensor, channel, x, P, clock, index, gain, work):
    """The unscented transform at the instrument's true time, t − c: y = p − v c + ½ a c² (and its rate)."""
    d = 6 if channel == RANGE_RATE else 3
    y, g, C = work[0], work[1], work[2:8]
    if clock < 0:
        for i in range(d):
            y[i] = x[i]
            for j in range(d):
                C[i, j] = P[i, j]
    else:
        _at_true_time(x, P, clock, d, y, C)
    where = model.offset[sensor], model.rotation[sensor], model.bend[sensor]
    if d == 3:
        value, extra = transform_position(channel, y, C, *where, g)
    else:
        value, extra = transform(channel, y, C, *where, d, g, work[8:16])
    for i in range(d):
        index[i], gain[i] = i, g[i]
    if clock < 0:
        return value, extra, d
    c, slope = x[clock], 0.0
    for i in range(3):
        rate = g[i + 3] if d == 6 else 0.0
        index[i + 3], gain[i + 3] = i + 3, rate - c * g[i]
        index[i + 6], gain[i + 6] = i + 6, 0.5 * c * c * g[i] - c * rate
        slope -= g[i] * (x[i + 3] - c * x[i + 6]) + rate * x[i + 6]
    index[9], gain[9] = clock, slope
    return value, extra, 10


@njit(cache=True, fastmath=True)
def _at_true_time(x, P, clock, d, y, C):
    """Mean ``y`` (d,) and covariance ``C`` (d, d) of position (and velocity) at t − c, c = x[clock]."""
    c = x[clock]
    for i in range(3):
        y[i] = x[i] - c * x[i + 3] + 0.5 * c * c * x[i + 6]
        y[i + 3] = x[i + 3] - c * x[i + 6]
    for i in range(d):
        ti = -y[i + 3] if i < 3 else -x[i + 3]
        for j in range(i + 1):
            tj = -y[j + 3] if j < 3 else -x[j + 3]
            total = ti * tj * P[clock, clock]
            for a in range(3 if i < 3 else 2):
                fa = 1.0 if a == 0 else (-c if a == 1 else 0.5 * c * c)
                total += fa * tj * P[i + 3 * a, clock]
                for b in range(3 if j < 3 else 2):
                    fb = 1.0 if b == 0 else (-c if b == 1 else 0.5 * c * c)
                    total += fa * fb * P[i + 3 * a, j + 3 * b]
            for b in range(3 if j < 3 else 2):
                fb = 1.0 if b == 0 else (-c if b == 1 else 0.5 * c * c)
                total += ti * fb * P[clock, j + 3 * b]
            C[i, j] = total
            C[j, i] = total
