"""Wind: the paper's simulation and its navigation, and a recorded flight with known wind.

Assumed where the paper is silent: 400 steps; measurement noise with memory ψ = 0.5 and increments of
variance 2 (as a pure random walk, ψ = 1, it would hide the level of the wind from every filter: see
``filters.wind.arf``); a tenth of the measurements outliers of 15 to 40 m/s, half of them in runs of 3 to 10.
"""

from pathlib import Path
from typing import NamedTuple

import numpy as np

from bench.accuracy import FIRST_SEED
from bridges.tlog import tlog
from filters.wind import arf
from filters.wind import wind as winds

STEPS, SETTLE = 400, 20  # the first are the filters' own start
MEAN_WALK_VAR, EXCITATION_VAR = 0.01, 1.0  # Σ_vm, Σ
INTENSITY, SCALE_LENGTH, STEP_LENGTH = 1.75, 100.0, 20.0  # σ m/s, L, h
MEAN_START, GUST_START = 10.0, 0.0  # m/s
NOISE_VAR, NOISE_MEMORY = 2.0, 0.5
OUTLIERS, SIZE_MPS, RUN = 0.10, (15.0, 40.0), (3, 10)
IN_RUNS = 0.5  # of the outliers
MODEL = arf.Wind1D(noise_var=NOISE_VAR, noise_memory=NOISE_MEMORY)
FIX_EVERY_S, FIX_SIGMA_M = 1.0, 2.0
LOST_S, LOSS_EVERY_S = 60.0, 30.0
FLYING_M = 60.0  # the simulator's wind is full above this height


class WindScene(NamedTuple):
    """One wind component: truth and what is measured, (n,) m/s."""

    truth: np.ndarray
    measured: np.ndarray
    outlier: np.ndarray


class AirSamples(NamedTuple):
    """n samples of a flight, boot time; truth for scoring only."""

    t_ns: np.ndarray
    tas_mps: np.ndarray
    attitude: np.ndarray  # (n, 3) rad
    velocity: np.ndarray  # (n, 3) ENU, as the autopilot reports it
    position: np.ndarray  # (n, 2) truth, east and north, m
    height_m: np.ndarray  # truth, above the start


class Loss(NamedTuple):
    """End of one minute without any position."""

    with_wind_m: float
    without_wind_m: float
    nees: float  # over its degrees of freedom: 1 where the covariance is honest


def scene(seed: int, outliers: float = 0.0, memory: float = NOISE_MEMORY) -> WindScene:
    """The paper's wind: mean a random walk, turbulence first-order Markov, and coloured noise."""
    rng = np.random.default_rng(seed)
    mean = MEAN_START + np.cumsum(rng.normal(0.0, np.sqrt(MEAN_WALK_VAR), STEPS))
    decay = np.exp(-STEP_LENGTH / SCALE_LENGTH)
    kicks = INTENSITY * np.sqrt(1.0 - decay**2) * rng.normal(0.0, np.sqrt(EXCITATION_VAR), STEPS)
    truth = mean + _markov(decay, kicks, GUST_START)
    measured = truth + _markov(memory, rng.normal(0.0, np.sqrt(NOISE_VAR), STEPS), 0.0)
    outlier = np.zeros(STEPS, bool)
    while outlier.sum() < outliers * STEPS:
        length = int(rng.integers(RUN[0], RUN[1] + 1)) if outlier.sum() < IN_RUNS * outliers * STEPS else 1
        begin = int(rng.integers(SETTLE, STEPS - length))
        if not outlier[begin - 1 : begin + length + 1].any():
            size = rng.uniform(*SIZE_MPS) * rng.choice([-1.0, 1.0])
            measured[begin : begin + length] += size * rng.uniform(0.8, 1.2, length)
            outlier[begin : begin + length] = True
    return WindScene(truth, measured, outlier)


def table(seeds: int) -> dict[str, np.ndarray]:
    """{method: (seeds, 2) RMSE in m/s of each wind, without outliers and with}."""
    out = {method: np.empty((seeds, 2)) for method in arf.METHODS}
    for k in range(seeds):
        for column, share in enumerate((0.0, OUTLIERS)):
            made = scene(FIRST_SEED + k, share)
            for method in arf.METHODS:
                error = arf.estimate(made.measured, method, MODEL).x - made.truth
                out[method][k, column] = np.sqrt(np.mean(error[SETTLE:] ** 2))
    return out


def navigation(seeds: int) -> tuple[float, float]:
    """RMS position error in the plane, m, of `navigate`: without, with the wind's correction."""
    errors = np.array([navigate(FIRST_SEED + k, OUTLIERS) for k in range(seeds)])
    without, corrected = np.sqrt((errors**2).sum(axis=2).mean(axis=(0, 2)))
    return float(without), float(corrected)


def navigate(seed: int, outliers: float) -> np.ndarray:
    """(2, 2, n) position errors, m, by air data between fixes a second apart: without, with; east and north.

    At each fix the position has an error of its own; ``l`` seconds later, l uniform up to the next fix, the
    uncorrected position is off by wind · l, the corrected one by what the estimate lacks.
    """
    rng = np.random.default_rng(seed)
    later_s = rng.uniform(0.0, FIX_EVERY_S, STEPS)
    without, corrected = [], []
    for component in (scene(2 * seed, outliers), scene(2 * seed + 1, outliers)):
        fix = rng.normal(0.0, FIX_SIGMA_M, STEPS)
        estimated = arf.estimate(component.measured, "arf", MODEL).x
        without.append(fix - component.truth * later_s)
        corrected.append(fix + (estimated - component.truth) * later_s)
    return np.array([without, corrected])


def flight(log_path: Path, truth_path: Path) -> AirSamples:
    """A recorded flight's air data, each VFR_HUD at the time of the ATTITUDE before it."""
    log = tlog.read(log_path)
    vehicle = tlog.choose(log, tlog.vehicles(log))
    attitude, hud = log.messages("ATTITUDE", vehicle), log.messages("VFR_HUD", vehicle)
    ground = log.messages("GLOBAL_POSITION_INT", vehicle)
    attitude_s, ground_s = (m["time_boot_ms"] * 1e-3 for m in (attitude, ground))
    before = np.maximum(np.searchsorted(attitude["frame_no"], hud["frame_no"]) - 1, 0)
    t_s = attitude_s[before]

    def at(times, *columns):
        return np.stack([np.interp(t_s, times, column) for column in columns], axis=1)

    truth = np.genfromtxt(truth_path, delimiter=",", names=True)
    position = at(truth["TimeUS"] * 1e-6, truth["pe_m"], truth["pn_m"], -truth["pd_m"])
    return AirSamples(
        np.round(t_s * 1e9).astype(np.int64),
        winds.true_airspeed(hud["airspeed"].astype(float), hud["alt"].astype(float)),
        at(attitude_s, *(np.unwrap(attitude[name]) for name in ("roll", "pitch", "yaw"))),
        at(ground_s, ground["vy"] * 1e-2, ground["vx"] * 1e-2, ground["vz"] * -1e-2),
        position[:, :2],
        position[:, 2],
    )


def follow(air: AirSamples, *, coordinated: bool = True) -> list[winds.MeanWind]:
    """The wind at every sample, from those up to then."""
    estimator = winds.WindEstimator(coordinated=coordinated)
    return [estimator.step(*sample) for sample in zip(*air[:4], strict=True)]


def losses(air: AirSamples, *, coordinated: bool = True) -> list[Loss]:
    """Dead reckoning over every lost minute that begins and ends in flight."""
    estimator = winds.WindEstimator(coordinated=coordinated)
    out, next_ns = [], air.t_ns[0]
    for k, sample in enumerate(zip(*air[:4], strict=True)):
        estimator.step(*sample)
        end = int(np.searchsorted(air.t_ns, air.t_ns[k] + round(LOST_S * 1e9)))
        if air.t_ns[k] < next_ns or end >= len(air.t_ns):
            continue
        if min(air.height_m[k], air.height_m[end]) > FLYING_M and estimator.wind.observable:
            next_ns = air.t_ns[k] + round(LOSS_EVERY_S * 1e9)
            out.append(_lose(air, estimator, k, end))
    return out


def _lose(air: AirSamples, estimator: winds.WindEstimator, begin: int, end: int) -> Loss:
    reckoning = estimator.carry(air.t_ns[begin], air.position[begin], np.eye(2))
    still_air = air.position[begin].copy()
    for k in range(begin + 1, end + 1):
        position, covariance = reckoning.step(air.t_ns[k], air.tas_mps[k], air.attitude[k])
        level = air.tas_mps[k] * np.cos(air.attitude[k, 1]) * (air.t_ns[k] - air.t_ns[k - 1]) * 1e-9
        still_air += level * np.array([np.sin(air.attitude[k, 2]), np.cos(air.attitude[k, 2])])
    error = position - air.position[end]
    nees = float(error @ np.linalg.solve(covariance, error)) / 2.0
    return Loss(float(np.hypot(*error)), float(np.hypot(*(still_air - air.position[end]))), nees)


def _markov(decay: float, kicks: np.ndarray, start: float) -> np.ndarray:
    """x(k+1) = decay x(k) + kick(k+1)."""
    out = np.empty(len(kicks))
    out[0] = start
    for k in range(1, len(kicks)):
        out[k] = decay * out[k - 1] + kicks[k]
    return out
