"""What instruments and the INS would say about a known trajectory, and which of it is a lie.

Everything is seeded through the ``np.random.Generator`` handed in. One sign for every clock:

    t_stamp = t_valid + clock_offset + jitter

so a positive offset means that the value is older than its stamp says; a latency is the same thing.
"""

from typing import NamedTuple

import numpy as np

from filters.models.rows import AZIMUTH, ROW, Sensor
from filters.models.theodolite import EARTH_RADIUS_M, REFRACTION
from filters.simulation.scenario import Truth, at, gauss_markov

LABELS = ("none", "isolated", "patch")
NONE, ISOLATED, PATCH = range(len(LABELS))
PATCH_KINDS = ("offset", "ramp", "frozen", "noise")
POLAR_CHANNELS = slice(0, 4)  # of rows.CHANNELS: range azimuth elevation range_rate
INS_CHANNELS = slice(4, 13)  # e n u ve vn vu ae an au
T0_NS = 1_767_225_600_000_000_000  # 2026-01-01, the default start of a simulated flight


class InstrumentErrors(NamedTuple):
    """What is wrong with an instrument beside its noise."""

    zero: tuple[float, float, float, float] = (0.0, 0.0, 0.0, 0.0)  # m, rad, rad, m/s: added to each channel
    clock_offset_s: float = 0.0
    jitter_s: float = 0.0  # 1-sigma
    gap_share: float = 0.0  # of the measurements, lost in dropouts
    gap_s: tuple[float, float] = (0.5, 3.0)  # shortest, longest dropout


class InsErrors(NamedTuple):
    """An autopilot's own solution: slow position error, good velocity, acceleration from attitude and IMU."""

    bias_m: float = 2.0  # 1-sigma of the Gauss-Markov position error
    tau_s: float = 90.0
    position_m: float = 0.2  # white
    velocity_mps: float = 0.1
    acceleration_mps2: float = 0.3
    latency_s: float = 0.12
    rate_hz: float = 10.0


NO_ERRORS = InstrumentErrors()
AUTOPILOT = InsErrors()


class Observation(NamedTuple):
    """m measurements of one source over c channels; NaN where it has no value."""

    t_ns: np.ndarray  # (m,) stamps
    channels: np.ndarray  # (c,) index into rows.CHANNELS
    values: np.ndarray  # (m, c) as measured: m, rad, m/s, m/s²
    clean: np.ndarray  # (m, c) true at the valid time: no noise, no error
    labels: np.ndarray  # (m, c) index into LABELS


def polar(p: np.ndarray, v: np.ndarray, refraction: str = "none") -> np.ndarray:
    """Range, azimuth, elevation, range rate (m, 4) of targets at ``p`` (m, 3), velocity ``v``, in sensor ENU.

    A target seen through the air stands higher than it is by k d / 2R, with d the horizontal distance and
    R the Earth's radius (Torge & Müller, Geodesy, 5.1.1).
    """
    horizontal = np.hypot(p[:, 0], p[:, 1])
    range_m = np.hypot(horizontal, p[:, 2])
    elevation = np.arctan2(p[:, 2], horizontal) + REFRACTION[refraction] * horizontal / (2 * EARTH_RADIUS_M)
    range_rate = np.einsum("ij,ij->i", p, v) / range_m
    return np.column_stack([range_m, np.arctan2(p[:, 0], p[:, 1]) % (2 * np.pi), elevation, range_rate])


def instrument(
    truth: Truth,
    sensor: Sensor,
    rate_hz: float,
    rng: np.random.Generator,
    errors: InstrumentErrors = NO_ERRORS,
    t0_ns: int = T0_NS,
) -> Observation:
    """What ``sensor`` measures of a flight; a channel whose sigma is NaN has no values."""
    t_s = _shutter(truth, rate_hz, rng)
    t_s = t_s[~gaps(t_s, errors.gap_share, errors.gap_s, rng)]
    p, v, _ = at(truth, t_s)
    clean = polar((p - sensor.offset_m) @ sensor.rotation.T, v @ sensor.rotation.T, sensor.refraction)
    clean[:, np.isnan(sensor.sigma[POLAR_CHANNELS])] = np.nan
    return measure(t_s, clean, sensor.sigma[POLAR_CHANNELS], rng, errors, t0_ns)


def measure(
    t_s: np.ndarray,
    clean: np.ndarray,
    sigma: np.ndarray,
    rng: np.random.Generator,
    errors: InstrumentErrors = NO_ERRORS,
    t0_ns: int = T0_NS,
) -> Observation:
    """Noise, zero errors and the clock on top of true ``clean`` (m, 4) at the valid times ``t_s`` (m,)."""
    values = clean + errors.zero + rng.normal(size=clean.shape) * sigma
    stamps = t_s + errors.clock_offset_s + rng.normal(0.0, errors.jitter_s, len(t_s))
    channels, labels = np.arange(13)[POLAR_CHANNELS], np.zeros(values.shape, np.int8)
    return Observation(t0_ns + _ns(stamps), channels, wrapped(values, channels), clean, labels)


def ins(
    truth: Truth, rng: np.random.Generator, errors: InsErrors = AUTOPILOT, t0_ns: int = T0_NS
) -> Observation:
    """What the autopilot says: nine channels in station ENU."""
    t_s = _shutter(truth, errors.rate_hz, rng)
    clean = np.hstack(at(truth, t_s))
    sigma = np.repeat([errors.position_m, errors.velocity_mps, errors.acceleration_mps2], 3)
    values = clean + rng.normal(size=clean.shape) * sigma
    values[:, :3] += gauss_markov(len(t_s), 1.0 / errors.rate_hz, errors.tau_s, errors.bias_m, rng)
    stamps = t0_ns + _ns(t_s + errors.latency_s)
    return Observation(stamps, np.arange(13)[INS_CHANNELS], values, clean, np.zeros(values.shape, np.int8))


def contaminate(
    seen: Observation,
    sigma: np.ndarray,
    rng: np.random.Generator,
    share: float,
    isolated_share: float = 0.63,
    run: tuple[int, int] = (3, 25),
    size: tuple[float, float] = (6.0, 100.0),
) -> Observation:
    """Make ``share`` of the channel values outliers: single ones, and runs in one channel or in all.

    ``sigma`` (c,) is the noise, ``size`` the error added in sigmas, log-uniform, either sign; a run keeps its
    sign and its size within ±20 %, never below the smallest. The default mix is that of the phased-array
    radar record in the screening paper: 4.1 % outliers, 63 % of them isolated, runs of 3 to 25.
    """
    values, labels = seen.values.copy(), seen.labels.copy()
    wanted = share * np.isfinite(values).sum()
    _add_runs(values, labels, sigma, rng, (1.0 - isolated_share) * wanted, run, size)
    _add_isolated(values, labels, sigma, rng, isolated_share * wanted, size)
    return seen._replace(values=wrapped(values, seen.channels), labels=labels)


def _add_runs(values, labels, sigma, rng, wanted, run, size):
    m, c = values.shape
    done = 0
    for _ in range(20 * m):  # a crowded record ends the search
        length = int(rng.integers(run[0], run[1] + 1))
        if done + length / 2 > wanted:
            return
        first = int(rng.integers(0, m - length + 1))
        columns = np.arange(c) if rng.random() < 0.5 else rng.integers(c, size=1)
        span = slice(first, first + length)
        if (labels[max(first - 1, 0) : first + length + 1, columns] != NONE).any():
            continue
        hit = np.ix_(np.arange(m)[span], columns)
        error = _sizes(rng, len(columns), size) * rng.uniform(0.8, 1.2, (length, len(columns)))
        values[hit] += np.sign(error) * np.maximum(np.abs(error), size[0]) * sigma[columns]
        labels[hit] = np.where(np.isfinite(values[hit]), PATCH, NONE)
        done += (labels[hit] == PATCH).sum()


def _add_isolated(values, labels, sigma, rng, wanted, size):
    cells = rng.permutation(np.argwhere(np.isfinite(values)))
    for row, channel in cells:
        if wanted < 0.5:
            return
        if (labels[max(row - 1, 0) : row + 2, channel] == NONE).all():
            values[row, channel] += _sizes(rng, None, size) * sigma[channel]
            labels[row, channel] = ISOLATED
            wanted -= 1


class LongPatch(NamedTuple):
    """Seconds of wrong values."""

    kind: str  # of PATCH_KINDS
    start_s: float  # since t0_ns
    duration_s: float
    channels: tuple[int, ...] | None = None  # columns; None: all
    size: float = 30.0  # sigmas


def patch(
    seen: Observation, sigma: np.ndarray, what: LongPatch, rng: np.random.Generator, t0_ns: int = T0_NS
) -> Observation:
    """One long patch in what was ``seen``; ``sigma`` (c,) is the noise. Raises ValueError for another kind.

    offset: constant error, both ends a jump. ramp: a tracker sliding off, zero to ``size``, back in a jump.
    frozen: the last good value again and again. noise: errors of 1-sigma ``size``.
    """
    kind, start_s, duration_s, channels, size = what
    if kind not in PATCH_KINDS:
        raise ValueError(f"patch kind {kind!r}: choose one of {', '.join(PATCH_KINDS)}")
    values, labels = seen.values.copy(), seen.labels.copy()
    since_s = (seen.t_ns - t0_ns) * 1e-9 - start_s
    rows = np.flatnonzero((since_s >= 0) & (since_s < duration_s))
    columns = np.arange(values.shape[1]) if channels is None else np.array(channels)
    hit = np.ix_(rows, columns)
    sign = rng.choice([-1.0, 1.0], len(columns))
    step = size * sign * sigma[columns]
    if kind == "offset":
        values[hit] += step
    elif kind == "ramp":
        values[hit] += step * since_s[rows, None] / duration_s
    elif kind == "frozen":
        values[hit] = values[max(rows[0] - 1, 0), columns]
    else:
        values[hit] += rng.normal(size=(len(rows), len(columns))) * step
    labels[hit] = np.where(np.isfinite(values[hit]), PATCH, NONE)
    return seen._replace(values=wrapped(values, seen.channels), labels=labels)


def rows(observations: list[Observation]) -> tuple[np.ndarray, np.ndarray]:
    """All sources as time-ordered (n,) ROW, sensor = place in the list, and (n,) labels; ids count from 0."""
    parts, labels = [], []
    for sensor, seen in enumerate(observations):
        at_row, at_column = np.nonzero(np.isfinite(seen.values))
        part = np.zeros(len(at_row), ROW)
        part["t_ns"], part["sensor"] = seen.t_ns[at_row], sensor
        part["channel"], part["value"] = seen.channels[at_column], seen.values[at_row, at_column]
        parts.append(part)
        labels.append(seen.labels[at_row, at_column])
    joined, labels = np.concatenate(parts), np.concatenate(labels)
    order = np.argsort(joined["t_ns"], kind="stable")
    joined = joined[order]
    joined["id"] = np.arange(len(joined))
    return joined, labels[order]


def gaps(
    t_s: np.ndarray, share: float, length_s: tuple[float, float], rng: np.random.Generator
) -> np.ndarray:
    """(m,) True where a measurement falls into a dropout; about ``share`` of them do."""
    lost = np.zeros(len(t_s), bool)
    while lost.sum() < share * len(t_s):
        begin = rng.uniform(t_s[0], t_s[-1])
        lost |= (t_s >= begin) & (t_s < begin + rng.uniform(*length_s))
    return lost


def wrapped(values: np.ndarray, channels: np.ndarray) -> np.ndarray:
    """Azimuths to [0, 2π), in place; the rest as it is."""
    values[:, channels == AZIMUTH] %= 2 * np.pi
    return values


def _shutter(truth: Truth, rate_hz: float, rng) -> np.ndarray:
    """Valid times: a steady rate with a phase of its own."""
    return np.arange(truth.t_s[0] + rng.uniform(0.0, 1.0 / rate_hz), truth.t_s[-1], 1.0 / rate_hz)


def _sizes(rng, shape, size) -> np.ndarray:
    return np.exp(rng.uniform(*np.log(size), shape)) * rng.choice([-1.0, 1.0], shape)


def _ns(t_s) -> np.ndarray:
    return np.round(np.asarray(t_s) * 1e9).astype(np.int64)
