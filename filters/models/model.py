"""The estimator's state for a given set of sensors, and what any row says about it, as arrays for numba."""

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from filters.models import ins, motion, theodolite
from filters.models.kernel import kernel
from filters.models.rows import AE, AZIMUTH, CHANNELS, ELEVATION, RANGE, RANGE_RATE, VE, E, Sensor
from filters.models.unscented import transform_position, transform_rate

SLOTS = (
    11  # the most state entries one row can depend on: position, velocity, acceleration, clock, zero error
)


MEAN, COV, SCRATCH = 6, 7, 21  # rows of the working space: see `_at_true_time`


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


def common_shift(model: Model, clocks: np.ndarray) -> np.ndarray:
    """(k,) what to take off all ``clocks`` (k, s), s: the weighted median, so most are right."""
    if not floating(model):
        return np.zeros(len(clocks))
    order = np.argsort(clocks, axis=1)
    weight = np.cumsum(1.0 / model.prior[model.clock_at][order], axis=1)
    middle = np.argmax(weight >= weight[:, -1:] / 2, axis=1)
    return np.take_along_axis(clocks, order, axis=1)[np.arange(len(clocks)), middle]


@kernel
def predict_row(model, sensor, channel, x, P, jerk_psd, out, k, work):
    """What the state says about one row: predicted value, and its variance without noise.

    ``jerk_psd``, of the motion now, is what a late INS cannot know of: velocity and acceleration have changed
    since. Into row ``k`` of ``out``: how many derivatives are not zero (``count``), which (``index``), what
    they are (``gain``), and the cross-covariance P h (``m``). ``work``: see `scratch`.
    """
    bias, clock = model.bias_at[sensor, channel], model.clock_at[sensor]
    if model.is_ins[sensor]:
        return _predict_ins(channel, x, P, jerk_psd, bias, clock, out.index, out.gain, out.count, out.m, k)
    index, gain, m, n = out.index, out.gain, out.m, x.size
    d = 6 if channel == RANGE_RATE else 3
    _at_true_time(x, P, clock, d, work)
    if d == 3:
        y = work[MEAN, 0], work[MEAN, 1], work[MEAN, 2]
        C = (
            work[COV, 0], work[COV + 1, 0], work[COV + 1, 1],
            work[COV + 2, 0], work[COV + 2, 1], work[COV + 2, 2],
        )  # fmt: skip
        value, variance, g = transform_position(
            channel, y, C, model.offset, model.rotation, model.bend, sensor
        )
        for j in range(n):
            m[k, j] = g[0] * work[0, j] + g[1] * work[1, j] + g[2] * work[2, j]
        for i in range(3):
            index[k, i], gain[k, i] = i, g[i]
    else:
        value, variance = transform_rate(
            work[MEAN], work[COV : COV + 6], model.offset, model.rotation, sensor, gain[k], work[COV + 6 :]
        )
        m[k] = 0.0
        for i in range(6):
            index[k, i] = i
            for j in range(n):
                m[k, j] += gain[k, i] * work[i, j]
    count = d if clock < 0 else _through_clock(x, clock, d, index, gain, k)
    if bias >= 0:
        index[k, count], gain[k, count] = bias, 1.0
        count += 1
        value += x[bias]
        variance += 2.0 * m[k, bias] + P[bias, bias]
        for j in range(n):
            m[k, j] += P[bias, j]
    out.count[k] = count
    return value, variance


@kernel
def _predict_ins(channel, x, P, jerk_psd, bias, clock, index, gain, count, m, k):
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
        jerk_psd = min(jerk_psd, motion.WILDEST)  # a jolt passes, and would silence the INS
        if channel >= AE:
            variance += jerk_psd * late
        else:
            value -= P[first + 3, clock]
            variance += _product(P, first, first, clock)
        if channel >= VE and channel < AE:
            variance += jerk_psd * late * late * late / 3.0
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
