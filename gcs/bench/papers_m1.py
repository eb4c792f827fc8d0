"""The GA-BP-UKF paper's two simulations, beside its baselines.

The paper gives the flight and the range noise. It leaves open how well the start is known, the angles' noise
and the filter's process noise; what is taken here stands in the constants. `start_table` shows what hangs on
it.
"""

from collections.abc import Callable
from typing import NamedTuple

import numpy as np

from filters import correction, estimator, m1, model, train, window
from filters.rows import CHANNELS, Sensor
from gcs import train as training  # the command's split, gains and report
from gcs.bench import baselines_m1 as baselines
from gcs.bench.baselines_m1 import Filtered
from gcs.training import Flown

STEP_S, STEPS = 1.0, 60
PATH = np.array([300.0, 346.0, 200.0, 40.0, 20.0, 10.0, 1.3, 1.7, 1.3])  # the paper's start: m, m/s, m/s²
SIGMA = np.array(
    [np.sqrt(10.0), np.radians(0.003), np.radians(0.003)]
)  # variance 10 m² the paper's; a theodolite
START_M = (
    40.0  # 1-sigma per axis of the first position; velocity a fifth, acceleration a fiftieth of it per s, s²
)
JERK_PSD = 1e-4  # m²/s⁵: the acceleration may wander by 0.08 m/s² in 60 s
JERK_PSDS = (1e-6, 1e-5, 1e-4, 1e-3, 1e-2, 1e-1, 1.0)  # the tuned filters choose from
OUTLIER_SHARE, OUTLIER_SIGMAS = 0.05, (6.0, 100.0)  # of the ranges; log-uniform, either sign
FIRST_OUTLIER = 10  # step; earlier, with one instrument and an unknown start, nothing could tell
RUNS = 200
LEARN_RUNS, GROUP = 300, 15  # flights to learn from, and how many of them count as one in the split
PLAN = train.Plan(epochs=20)
TUNING_SEED, TUNING_RUNS = 5000, 20
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
    """A flight at constant acceleration from ``path`` (9,), seen once a second; outliers from a step on."""
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
    p = away * np.sin(bearing), away * np.cos(bearing), rng.uniform(100.0, 400.0)
    v = speed * np.sin(course), speed * np.cos(course), rng.uniform(0.0, 15.0)
    a = pull * np.sin(course), pull * np.cos(course), rng.uniform(0.0, 1.5)
    return np.concatenate([p, v, a])


def m1_ukf(z, sigma, x, P, step_s, jerk_psd, soft=m1.C, hard=m1.NOTHING) -> Filtered:
    """The paper's unscented filter with its outlier handling; arguments as `baselines.ekf`."""
    noise = np.full(len(CHANNELS), np.nan)
    noise[:3] = sigma
    about = model.build([Sensor("theodolite", "theodolite", noise)], jerk_psd, 1.0, 1.0)
    n = len(z)
    rows = estimator.room(3 * n)
    rows.t[:], rows.channel[:] = (
        np.repeat(np.arange(1, n + 1) * round(step_s * 1e9), 3),
        np.tile([0, 1, 2], n),
    )
    rows.value[:] = z.ravel()
    out, scratch, work = baselines.room(n), window.trace(3, 9, 1), window.scratch(9)
    alone = np.zeros(1, bool)
    run, t_ns, x, P = np.zeros((1, len(CHANNELS), 2)), 0, x.copy(), P.copy()
    for k in range(n):
        span = (3 * k, 3 * k + 3)
        m1.admit(
            about, rows, *span, x, P, t_ns, jerk_psd, about.variance, run, soft, hard, False, scratch, work
        )
        columns = (rows.sensor, rows.channel, rows.weight, rows.off, rows.verdict, rows.reason)
        m1.label(*columns, *span, run, alone)
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


def errors(method: Callable, runs: list[Run], jerk_psd: float, net: correction.Network | None = None):
    """(r, n, 3) position errors of ``method`` in ``runs``, m, station ENU."""
    done = (method(r.z, SIGMA, r.x, r.P, STEP_S, jerk_psd) for r in runs)
    return np.array([(corrected(net, d) - r.truth)[:, :3] for d, r in zip(done, runs, strict=True)])


def tuned(method: Callable, start_m: float = START_M) -> float:
    """The jerk PSD of JERK_PSDS with the smallest error over flights that are not in the tables."""
    runs = [fly(np.random.default_rng(TUNING_SEED + k), start_m=start_m) for k in range(TUNING_RUNS)]
    return min(JERK_PSDS, key=lambda jerk_psd: np.abs(errors(method, runs, jerk_psd)).mean())


def simulations(runs: int = RUNS, start_m: float = START_M, plan: train.Plan = PLAN) -> dict:
    """Simulations 1 and 2: {method: {mae_m, median_m, rmse_m, rmse_outliers_m, jerk_psd}}.

    ``mae_m`` is the mean absolute error per axis, ``median_m`` the same as median over the runs.
    """
    methods = {
        "ga-bp-ukf": (m1_ukf, training.learn(lessons(m1_ukf, start_m), plan), JERK_PSD),
        "the same, no network": (m1_ukf, None, JERK_PSD),
        "bp-ekf": (
            baselines.ekf,
            training.learn(lessons(baselines.ekf, start_m), plan, genetic=False),
            JERK_PSD,
        ),
        "ekf": (baselines.ekf, None, JERK_PSD),
        "ekf, tuned": (baselines.ekf, None, tuned(baselines.ekf, start_m)),
        "classic ukf, tuned": (baselines.classic_ukf, None, tuned(baselines.classic_ukf, start_m)),
    }
    clean = [fly(np.random.default_rng(k), start_m=start_m) for k in range(runs)]
    dirty = [fly(np.random.default_rng(k), start_m=start_m, first_outlier=FIRST_OUTLIER) for k in range(runs)]
    out = {}
    for name, (method, net, jerk_psd) in methods.items():
        without, with_outliers = (errors(method, flown, jerk_psd, net) for flown in (clean, dirty))
        per_run = np.abs(without).mean(axis=(1, 2))
        out[name] = {
            "mae_m": float(per_run.mean()),
            "median_m": float(np.median(per_run)),
            "rmse_m": float(np.sqrt((without**2).mean())),
            "rmse_outliers_m": float(np.sqrt((with_outliers**2).mean())),
            "jerk_psd": jerk_psd,
        }
    return out


def start_table(runs: int = RUNS, starts_m=(10.0, 30.0, 50.0, 100.0)) -> list[dict]:
    """Mean absolute error, m, of EKF and UKF without networks, by how well the start is known."""
    out = []
    for start_m in starts_m:
        flown = [fly(np.random.default_rng(k), start_m=start_m) for k in range(runs)]
        ekf, ukf = (float(np.abs(errors(m, flown, JERK_PSD)).mean()) for m in (baselines.ekf, m1_ukf))
        out.append({"start_m": start_m, "ekf": ekf, "ukf": ukf, "ratio": ukf / ekf})
    return out
