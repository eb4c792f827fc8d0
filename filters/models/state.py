"""The estimator's state for a given set of sensors, and what any row says about it, as arrays for numba."""

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from filters.models import ins, motion, theodolite
from filters.models.kernel import kernel
from filters.models.rows import AE, AZIMUTH, CHANNELS, ELEVATION, RANGE, RANGE_RATE, VE, E, Sensor
from filters.models.unscented import (
    difference,
    is_wide,
    linear_position,
    transform_position,
    transform_rate,
)

SLOTS = (
    11  # the most state entries one row can depend on: position, velocity, acceleration, clock, zero error
)
MEAN, COV, SCRATCH = 6, 7, 21  # rows of the working space: see `_at_true_time`
HEIGHT_TAU_S = 10.0  # correlation time of a height that is told beforehand
CLOCK_TAU_S = 2e5  # a clock with a prior of 0.1 s wanders by 0.3 ms √s: 5 ms in four minutes


class Model(NamedTuple):
    """s sensors, n states. Indices into the state are −1 where the sensor has no such error."""

    is_ins: np.ndarray  # (s,) bool
    variance: np.ndarray  # (s, 13) of the noise per channel, NaN where the sensor has none
    offset: np.ndarray  # (s, 3) station ENU, m
    rotation: np.ndarray  # (s, 3, 3) station ENU → sensor ENU
    bend: np.ndarray  # (s,) refraction, rad per metre
    bias_at: np.ndarray  # (s, 13) state index of the channel's systematic error
    clock_at: np.ndarray  # (s,) state index of clock offset or latency, s: value valid at stamp − offset
    rate: np.ndarray  # (n,) 1/τ of each Gauss-Markov state, 0 for constants, 1/s
    prior: np.ndarray  # (n,) variance of each systematic error, and of a height, told beforehand; else 0
    slow_of: np.ndarray  # (n − 9,) sensor, of the systematic errors that are its slow errors; else −1


def build(
    sensors: Sequence[Sensor], bias_sigma_m: float = ins.BIAS_SIGMA_M, bias_tau_s: float = ins.BIAS_TAU_S
) -> Model:
    """The state is p, v, a, then per sensor its errors by channel and its clock, in the sensors' order.

    An instrument's errors are slow, or its zero errors where these are asked for, then slowly changing ones.
    Its clock is asked for, too; an INS has always its latency. ``bias_sigma_m`` and ``bias_tau_s`` are of the
    INS position error.
    """
    bias_at = np.full((len(sensors), len(CHANNELS)), -1)
    clock_at = np.full(len(sensors), -1)
    rate, prior, slow_of = [0.0] * motion.CORE, [0.0] * motion.CORE, []
    for s, sensor in enumerate(sensors):
        inertial = sensor.kind == "ins"
        if inertial:
            errors = {E + axis: (bias_sigma_m**2, bias_tau_s) for axis in range(3)}
            errors |= {VE + axis: (ins.DRIFT_SIGMA_MPS**2, ins.DRIFT_TAU_S) for axis in range(3)}
        else:
            errors = _slow_errors(sensor)
        for channel, (variance, tau_s) in errors.items():
            if np.isfinite(sensor.sigma[channel]):
                bias_at[s, channel] = len(prior)
                prior.append(variance)
                rate.append(1.0 / tau_s)
                slow_of.append(-1 if inertial or "bias" in sensor.estimate else s)
        if inertial or "clock" in sensor.estimate:
            clock_at[s] = len(prior)
            usual_s = ins.LATENCY_SIGMA_S if inertial else theodolite.CLOCK_SIGMA_S
            prior.append((sensor.clock_sigma_s or usual_s) ** 2)
            rate.append(1.0 / CLOCK_TAU_S)
            slow_of.append(-1)
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
        slow_of=np.array(slow_of, np.int64),
    )


def with_height(model: Model, sigma_m: float) -> Model:
    """The ``model`` of a target whose height is told beforehand, to ``sigma_m``.

    It is a Gauss-Markov process: were it a constant, ranges in a turn would tell it, ever better and wrong.
    `predict` lets it go as such a process does, and never further than it was told.
    """
    rate, prior = model.rate.copy(), model.prior.copy()
    rate[2], prior[2] = 1.0 / HEIGHT_TAU_S, sigma_m**2
    return model._replace(rate=rate, prior=prior)


def _slow_errors(sensor: Sensor) -> dict[int, tuple[float, float]]:
    """Variance and correlation time of an instrument's errors by channel; zero errors in them if asked."""
    zeros = sensor.zero_sigma or theodolite.ZERO_SIGMA if "bias" in sensor.estimate else (0.0, 0.0, 0.0)
    out = {}
    for channel, zero in zip((RANGE, AZIMUTH, ELEVATION), zeros, strict=True):
        slow = (sensor.slow * sensor.sigma[channel]) ** 2
        variance = zero**2 + slow
        if variance > 0.0:
            out[channel] = variance, theodolite.SLOW_TAU_S * variance / slow if slow else np.inf
    return out


def scratch(n: int) -> np.ndarray:
    """Working space for one row and ``n`` states, and of the passes over many."""
    return np.zeros((SCRATCH, n))


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


def common_shift(model: Model, clocks: np.ndarray, heard: np.ndarray) -> np.ndarray:
    """(k,) what to take off all ``clocks`` (k, s), s: the weighted median, so most are right.

    Only sensors ``heard`` (s,) of in this flight have a say.
    """
    if not floating(model) or not heard.any():
        return np.zeros(len(clocks))
    clocks, prior = clocks[:, heard], model.prior[model.clock_at[heard]]
    order = np.argsort(clocks, axis=1)
    weight = np.cumsum(1.0 / prior[order], axis=1)
    middle = np.argmax(weight >= weight[:, -1:] / 2, axis=1)
    return np.take_along_axis(clocks, order, axis=1)[np.arange(len(clocks)), middle]


@kernel
def predict_row(model, rows, i, x, P, psd, out, k, work):
    """What the state says about row ``i``: innovation (angles the short way), and its variance without noise.

    ``psd`` (≥ 4,), of the motion now, is what a late INS cannot know of: velocity and acceleration have
    changed since. Into row ``k`` of ``out``: how many derivatives are not zero (``count``), which
    (``index``), what they are (``gain``), and the cross-covariance P h (``m``). ``work``: see `scratch`.
    """
    sensor, channel = rows.sensor[i], rows.channel[i]
    bias, clock = model.bias_at[sensor, channel], model.clock_at[sensor]
    index, gain, m, n = out.index, out.gain, out.m, x.size
    if model.is_ins[sensor]:
        value, variance = _predict_ins(channel, x, P, psd, bias, clock, index, gain, out.count, m, k)
        return rows.value[i] - value, variance
    d = 6 if channel == RANGE_RATE else 3
    _at_true_time(x, P, clock, d, work)
    if d == 3:
        y = work[MEAN, 0], work[MEAN, 1], work[MEAN, 2]
        C = (
            work[COV, 0], work[COV + 1, 0], work[COV + 1, 1],
            work[COV + 2, 0], work[COV + 2, 1], work[COV + 2, 2],
        )  # fmt: skip
        if not is_wide(channel, y, C, rows.place, i, model.offset, sensor):
            value, variance, g = transform_position(
                channel, y, C, model.offset, model.rotation, model.bend, sensor
            )
            v = difference(channel, rows.value[i], value)
        else:
            v, variance, g = linear_position(
                channel, rows.value[i], y, C, rows.place, i, model.offset, model.rotation, model.bend, sensor
            )
        for j in range(n):
            m[k, j] = g[0] * work[0, j] + g[1] * work[1, j] + g[2] * work[2, j]
        for j in range(3):
            index[k, j], gain[k, j] = j, g[j]
    else:
        value, variance = transform_rate(
            work[MEAN], work[COV : COV + 6], model.offset, model.rotation, sensor, gain[k], work[COV + 6 :]
        )
        v = rows.value[i] - value
        m[k] = 0.0
        for p in range(6):
            index[k, p] = p
            for j in range(n):
                m[k, j] += gain[k, p] * work[p, j]
    count = d if clock < 0 else _through_clock(x, clock, d, index, gain, k)
    if bias >= 0:
        index[k, count], gain[k, count] = bias, 1.0
        count += 1
        v -= x[bias]
        variance += 2.0 * m[k, bias] + P[bias, bias]
        for j in range(n):
            m[k, j] += P[bias, j]
    out.count[k] = count
    return v, max(variance, 0.0)  # rounding may take it below, where the covariance is huge


@kernel
def _predict_ins(channel, x, P, psd, bias, clock, index, gain, count, m, k):
    value, count[k] = ins.observe(channel, x, bias, clock, index, gain, k)
    first, n = index[k, 0], x.size
    for j in range(n):
        m[k, j] = P[first, j]
    for i in range(1, count[k]):
        a, g = index[k, i], gain[k, i]
        for j in range(n):
            m[k, j] += g * P[a, j]
    variance = 0.0
    for i in range(count[k]):
        variance += gain[k, i] * m[k, index[k, i]]
    if clock >= 0:
        late = abs(x[clock])
        jerk, push = (psd[1], psd[3]) if first % 3 == 2 else (psd[0], psd[2])
        if channel >= AE:
            variance += jerk * late
        else:
            value -= P[first + 3, clock]
            variance += _product(P, first, first, clock)
        if channel >= VE and channel < AE:
            variance += jerk * late * late * late / 3.0 + push * late
    return value, variance


@kernel
def _at_true_time(x, P, clock, d, work):
    """Position (and velocity) at an instrument's true time t − c: y = p − v c + ½ a c², v − a c.

    Into ``work``: mean y (d,) at MEAN, covariance (d, d) at COV, covariance of y with the state (d, n) at 0.
    The products of the uncertain v and c count too: E vc = v c + P_vc, var vc = linear part
    + P_vv P_cc + P_vc².
    """
    n = x.size
    if clock < 0:
        for k in range(d):
            work[MEAN, k] = x[k]
            for j in range(n):
                work[k, j] = P[k, j]
            for j in range(k + 1):
                work[COV + k, j] = P[k, j]
        return
    c = x[clock]
    half = 0.5 * c * c
    for k in range(3):
        a = x[k + 6]
        rate = x[k + 3] - c * a
        work[MEAN, k] = x[k] - c * rate - half * a - P[k + 3, clock] + 0.5 * a * P[clock, clock]
        for j in range(n):
            work[k, j] = P[k, j] - c * P[k + 3, j] + half * P[k + 6, j] - rate * P[clock, j]
    for k in range(3, d):
        rate = x[k + 3]
        work[MEAN, k] = x[k] - c * rate - P[k + 3, clock]
        for j in range(n):
            work[k, j] = P[k, j] - c * P[k + 3, j] - rate * P[clock, j]
    for k in range(d):
        for i in range(k + 1):
            rate, curved = x[i + 3], 0.0
            if i < 3:
                rate, curved = x[i + 3] - c * x[i + 6], half * work[k, i + 6]
            work[COV + k, i] = (
                work[k, i] - c * work[k, i + 3] + curved - rate * work[k, clock] + _product(P, k, i, clock)
            )


@kernel
def _product(P, i, k, clock):
    """What the linear part leaves out of the covariance of c·(rate of state i) and c·(rate of state k)."""
    return P[i + 3, k + 3] * P[clock, clock] + P[i + 3, clock] * P[k + 3, clock]


@kernel
def _through_clock(x, clock, d, index, gain, k):
    """Adds the derivatives by velocity, acceleration and clock to those by position (and velocity)."""
    c, slope = x[clock], 0.0
    for i in range(3):
        g, rate = gain[k, i], gain[k, i + 3] if d == 6 else 0.0
        index[k, i + 3], gain[k, i + 3] = i + 3, rate - c * g
        index[k, i + 6], gain[k, i + 6] = i + 6, 0.5 * c * c * g - c * rate
        slope -= g * (x[i + 3] - c * x[i + 6]) + rate * x[i + 6]
    index[k, 9], gain[k, 9] = clock, slope
    return 10
