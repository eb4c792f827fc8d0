"""The GA-BP-UKF paper's simulations and its smoothness figure, beside the baselines.

The paper gives the flight and the range noise. It leaves open how well the start is known, the angles' noise and the
filter's process noise; what is taken here stands in the constants, and `start_table` shows what hangs on it.
"""

from collections.abc import Callable
from typing import NamedTuple

import numpy as np

from filters import correction, estimator, m1, model, scenario, simulate, train, window
from filters.rows import CHANNELS, Sensor
from gcs import train as training  # the command's split, gains and report
from gcs.bench import baselines_m1 as baselines
from gcs.bench.baselines_m1 import Filtered
from gcs.training import Flown

STEP_S, STEPS = 1.0, 60
PATH = np.array([300.0, 346.0, 200.0, 40.0, 20.0, 10.0, 1.3, 1.7, 1.3])  # the paper's start: m, m/s, m/s²
SIGMA = np.array([np.sqrt(10.0), np.radians(0.003), np.radians(0.003)])  # variance 10 m² the paper's; a theodolite
START_M = 40.0  # 1-sigma per axis of the first position; velocity a fifth, acceleration a fiftieth of it per s, s²
JERK_PSD = 1e-4  # m²/s⁵: the acceleration may wander by 0.08 m/s² in 60 s
JERK_PSDS = (1e-6, 1e-5, 1e-4, 1e-3, 1e-2, 1e-1, 1.0)  # the tuned filters choose from
OUTLIER_SHARE, OUTLIER_SIGMAS = 0.05, (6.0, 100.0)  # of the ranges; log-uniform, either sign
FIRST_OUTLIER = 10  # step; earlier, with one instrument and an unknown start, nothing could tell
RUNS = 200
LEARN_RUNS, GROUP = 300, 15  # flights to learn from, and how many of them count as one in the split
PLAN = train.Plan(epochs=20)
THEODOLITE_HZ, THEODOLITE_SIGMA = 20.0, np.array([1.0, np.radians(0.003), np.radians(0.003)])
STEP_20_S = 1.0 / THEODOLITE_HZ
ACCEL_PSD = 25.0  # m²/s³: 5 m/s² held for a second, an ordinary turn
ALPHA = 0.3  # of the α-β filter
SETTLE_S = 2.0  # not scored
LOST_M = 10.0
DEG = 180.0 / np.pi
PAPER = {"bp-ekf": (31.5347, 12.1745, 18.8466, 9.7875), "ga-bp-ukf": (9.0323, 9.6778, 11.9063, 6.5939)}


class Run(NamedTuple):
    """One simulated flight."""

    truth: np.ndarray  # (n, 9)
    z: np.ndarray  # (n, 3) measured
    x: np.ndarray  # (9,) where a filter believes to begin
    P: np.ndarray  # (9, 9)


def fly(
    rng: np.random.Generator, path: np.ndarray = PATH, start_m: float = START_M, first_outlier: int = STEPS
) -> Run:
    """A flight at constant acceleration from ``path`` (9,), once a second; outliers from ``first_outlier`` on."""
    t = STEP_S * np.arange(1, STEPS + 1)[:, None]
    p, v, a = path[:3], path[3:6], path[6:]
    truth = np.hstack([p + t * v + t**2 * a / 2, v + t * a, np.tile(a, (STEPS, 1))])
    spread = np.repeat(start_m * np.array([1.0, 0.2, 0.02]), 3)
    x = path + rng.normal(size=9) * spread
    z = baselines.observe(truth[:, :3]) + rng.normal(size=(STEPS, 3)) * SIGMA
    hit = (rng.random(STEPS) < OUTLIER_SHARE) & (np.arange(STEPS) >= first_outlier)
    size = np.exp(rng.uniform(*np.log(OUTLIER_SIGMAS), STEPS)) * rng.choice([-1.0, 1.0], STEPS)
    z[:, 0] += hit * size * SIGMA[0]
    return Run(truth, z, x, np.diag(spread**2))


def any_path(rng: np.random.Generator) -> np.ndarray:
    """A flight like the paper's in some other direction: what networks learn from."""
    bearing, course = rng.uniform(0.0, 2 * np.pi, 2)
    away, speed, pull = rng.uniform(300.0, 800.0), rng.uniform(20.0, 60.0), rng.uniform(0.0, 3.0)
    return np.array(
        [away * np.sin(bearing), away * np.cos(bearing), rng.uniform(100.0, 400.0)]
        + [speed * np.sin(course), speed * np.cos(course), rng.uniform(0.0, 15.0)]
        + [pull * np.sin(course), pull * np.cos(course), rng.uniform(0.0, 1.5)]
    )


def m1_ukf(z, sigma, x, P, step_s, jerk_psd, soft=m1.C, hard=m1.NOTHING) -> Filtered:
    """The paper's unscented filter with its outlier handling; arguments as `baselines.ekf`."""
    noise = np.full(len(CHANNELS), np.nan)
    noise[:3] = sigma
    about = model.build([Sensor("theodolite", "theodolite", noise)], jerk_psd, 1.0, 1.0)
    n = len(z)
    rows = estimator.room(3 * n)
    rows.t[:], rows.channel[:] = np.repeat(np.arange(1, n + 1) * round(step_s * 1e9), 3), np.tile([0, 1, 2], n)
    rows.value[:] = z.ravel()
    out, scratch, work = baselines.room(n), window.trace(3, 9, 1), window.scratch(9)
    run, t_ns, x, P = np.zeros((1, len(CHANNELS), 2)), 0, x.copy(), P.copy()
    for k in range(n):
        span = (3 * k, 3 * k + 3)
        m1.admit(about, rows, *span, x, P, t_ns, run, soft, hard, False, scratch, work)
        m1.label(rows.sensor, rows.channel, rows.weight, rows.off, rows.verdict, rows.reason, *span, run)
        t_ns = rows.t[3 * k]
        out.x0[k], out.P0[k], out.x1[k], out.P1[k] = scratch.x[0], scratch.P[0], x, P
    return out


def lessons(method: Callable, start_m: float = START_M, runs: int = LEARN_RUNS) -> training.Split:
    """What ``method`` did in ``runs`` flights in every direction, beside what it should have done."""
    rng = np.random.default_rng(7)
    flights = []
    for _ in range(runs // GROUP):
        group = [fly(rng, any_path(rng), start_m) for _ in range(GROUP)]
        done = [method(r.z, SIGMA, r.x, r.P, STEP_S, JERK_PSD) for r in group]
        x0, P0, x1, P1 = (np.concatenate(column) for column in zip(*done, strict=True))
        u, e = correction.samples(x0, P0, x1, P1, np.concatenate([r.truth for r in group]))
        flights.append(Flown("", u, e, correction.sigmas_of(x0, P1)))
    return training.divide(flights)


def learn(split: training.Split, plan: train.Plan, genetic: bool) -> correction.Network:
    """The network that ``split`` teaches, from a genetic start or a random one."""
    fit, check = training.pool(split.fit), training.pool(split.check)
    if genetic:
        starts = train.genetic_start(*fit, plan, plan.seed).best[None]
    else:
        starts = train.random_starts(1, plan.hidden, np.random.default_rng(plan.seed))
    return training.assemble(train.backpropagate(starts, fit, check, plan).weights[0], plan, split)


def starts(count: int = 20, plan: train.Plan = PLAN) -> dict:
    """Genetic starts against random ones on what an EKF leaves to learn; see `gcs.train.starts`."""
    return training.starts(lessons(baselines.ekf), plan, count)


def corrected(net: correction.Network | None, done: Filtered) -> np.ndarray:
    """(n, 9) the updated states, with the network's correction where there is one."""
    out = done.x1.copy()
    if net:
        for k in range(len(out)):
            correction.correct(net, done.x0[k], done.P0[k], done.x1[k], done.P1[k], out[k])
    return out


def tuned(method: Callable, start_m: float = START_M) -> float:
    """The jerk PSD of JERK_PSDS with the smallest error over 20 flights that are not in the tables."""
    runs = [fly(np.random.default_rng(5000 + k), start_m=start_m) for k in range(20)]
    errors = [
        np.mean([np.abs(method(r.z, SIGMA, r.x, r.P, STEP_S, q).x1 - r.truth)[:, :3].mean() for r in runs])
        for q in JERK_PSDS
    ]
    return JERK_PSDS[int(np.argmin(errors))]


def simulations(runs: int = RUNS, start_m: float = START_M, plan: train.Plan = PLAN) -> dict:
    """Simulations 1 and 2: {method: {mae_m, rmse_m, rmse_outliers_m}}, mean absolute and RMS position error per axis."""
    methods = {
        "ga-bp-ukf": (m1_ukf, learn(lessons(m1_ukf, start_m), plan, True), JERK_PSD),
        "the same, no network": (m1_ukf, None, JERK_PSD),
        "bp-ekf": (baselines.ekf, learn(lessons(baselines.ekf, start_m), plan, False), JERK_PSD),
        "ekf": (baselines.ekf, None, JERK_PSD),
        "ekf, tuned": (baselines.ekf, None, tuned(baselines.ekf, start_m)),
        "classic ukf, tuned": (baselines.classic_ukf, None, tuned(baselines.classic_ukf, start_m)),
    }
    clean = [fly(np.random.default_rng(k), start_m=start_m) for k in range(runs)]
    dirty = [fly(np.random.default_rng(k), start_m=start_m, first_outlier=FIRST_OUTLIER) for k in range(runs)]
    out = {}
    for name, (method, net, jerk_psd) in methods.items():
        errors = [
            np.array([
                (corrected(net, method(r.z, SIGMA, r.x, r.P, STEP_S, jerk_psd)) - r.truth)[:, :3] for r in flown
            ])
            for flown in (clean, dirty)
        ]  # fmt: skip
        per_run = np.abs(errors[0]).mean(axis=(1, 2))
        out[name] = {
            "mae_m": float(per_run.mean()),
            "median_m": float(np.median(per_run)),
            "rmse_m": float(np.sqrt((errors[0] ** 2).mean())),
            "rmse_outliers_m": float(np.sqrt((errors[1] ** 2).mean())),
            "jerk_psd": jerk_psd,
        }
    return out


def start_table(runs: int = RUNS, starts_m=(10.0, 30.0, 50.0, 100.0)) -> list[dict]:
    """Mean absolute error, m, of EKF and UKF without networks, by how well the start is known."""
    out = []
    for start_m in starts_m:
        flown = [fly(np.random.default_rng(k), start_m=start_m) for k in range(runs)]
        mae = {
            name: float(np.mean([
                np.abs(method(r.z, SIGMA, r.x, r.P, STEP_S, JERK_PSD).x1 - r.truth)[:, :3].mean() for r in flown
            ]))
            for name, method in (("ekf", baselines.ekf), ("ukf", m1_ukf))
        }  # fmt: skip
        out.append({"start_m": start_m} | mae | {"ratio": mae["ukf"] / mae["ekf"]})
    return out


def smoothness(level: str, seeds: int = 20) -> dict:
    """Mean gradient of the filtered range, azimuth, elevation beside their true RMS error, medians over seeds.

    One theodolite (range 1 m, angles 0.003°, 20 Hz, 4.1 % outliers, isolated and in runs) and the INS see a minute of a
    flight of one of ``scenario.LEVELS``. {method: (6,) as `_score`, "lost": flights with 10 m of range error or more}.
    The gradient of the truth is the figure a perfect filter would have. The wavelet sees the whole record, so what
    compares with it is the smoothed track.
    """
    found = {}
    for seed in range(seeds):
        rng = np.random.default_rng(8000 + seed)
        truth = scenario.flight(60.0, 100.0, level, rng)
        noise = np.full(len(CHANNELS), np.nan)
        noise[:3] = THEODOLITE_SIGMA
        theodolite = Sensor("theodolite", "theodolite", noise, np.array([600.0, -400.0, 0.0]))
        inertial = Sensor("ins", "ins", np.r_[np.full(4, np.nan), np.repeat([0.3, 0.2, 1.5], 3)])
        seen = simulate.instrument(truth, theodolite, THEODOLITE_HZ, rng)
        seen = simulate.contaminate(seen, noise[seen.channels], rng, 0.041)
        rows, _ = simulate.rows([seen, simulate.ins(truth, rng, simulate.InsErrors(latency_s=0.0))])
        values = {"truth": seen.clean[:, :3], "raw": seen.values[:, :3]}
        values["adaptive kalman + wavelet"] = _by_channel(seen, _adaptive_wavelet)
        values["alpha-beta"] = _by_channel(seen, lambda z, sigma, psd: baselines.alpha_beta(z, STEP_20_S, ALPHA))
        for method in ("ga-bp-ukf", "default"):
            runner = estimator.make(method, [theodolite, inertial])
            values[method] = _polar(runner.step(rows).track, theodolite, seen)
            runner.finish()
            values[f"{method}, smoothed"] = _polar(runner.smooth(), theodolite, seen)
        settled = slice(round(SETTLE_S * THEODOLITE_HZ), -1)
        for name, channels in values.items():
            found.setdefault(name, []).append(_score(channels[settled], seen.clean[settled, :3]))
    return {
        name: {"median": np.median(scores, axis=0).tolist(), "lost": int((np.array(scores)[:, 3] >= LOST_M).sum())}
        for name, scores in found.items()
    }


def _score(values: np.ndarray, clean: np.ndarray) -> list[float]:
    """Mean gradient of range m, azimuth, elevation deg, then their RMS errors."""
    step = baselines.difference(values[1:], values[:-1])
    error = baselines.difference(values, clean)
    both = np.concatenate([np.abs(step).mean(axis=0), np.sqrt((error**2).mean(axis=0))])
    return (both * np.array([1.0, DEG, DEG, 1.0, DEG, DEG])).tolist()


def _by_channel(seen: simulate.Observation, method: Callable) -> np.ndarray:
    """Each channel by itself, azimuth unwrapped; ``method`` (z, sigma, acceleration PSD in the channel's unit)."""
    z = seen.values[:, :3].copy()
    z[:, 1] = np.unwrap(z[:, 1])
    away_m = np.median(z[:, 0])
    psd = ACCEL_PSD / np.array([1.0, away_m**2, away_m**2])
    return np.column_stack([method(z[:, k], THEODOLITE_SIGMA[k], psd[k]) for k in range(3)])


def _adaptive_wavelet(z, sigma, psd):
    return baselines.adaptive_wavelet(z, sigma, STEP_20_S, psd)


def _polar(track: np.ndarray, sensor: Sensor, seen: simulate.Observation) -> np.ndarray:
    """(m, 3) range, azimuth, elevation of (k,) TRACK at the times of ``seen``."""
    at = np.searchsorted(track["t_ns"], seen.t_ns).clip(max=len(track) - 1)
    return baselines.observe((track["x"][at, :3] - sensor.offset_m) @ sensor.rotation.T)
