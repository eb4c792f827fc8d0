"""The GA-BP-UKF paper's two simulations: the flight, what is measured, and the paper's filter.

The paper gives the flight and the range noise. It leaves open how well the start is known, the angles' noise
and the filter's process noise; what is taken here stands in the constants, chosen on seeds below
``accuracy.FIRST_SEED``.
"""

from collections.abc import Callable
from typing import NamedTuple

import numpy as np

from bench.papers.m1 import baselines
from bench.papers.m1.baselines import Filtered
from filters.baselines.baselines import columns
from filters.correction import correction
from filters.methods import METHODS
from filters.models import state
from filters.models.motion import CORE
from filters.models.rows import CHANNELS, ROW, Sensor
from filters.smoother import buffer, gated, passes, status

STEP_S, STEPS = 1.0, 60
PATH = np.array([300.0, 346.0, 200.0, 40.0, 20.0, 10.0, 1.3, 1.7, 1.3])  # the paper's start: m, m/s, m/s²
RANGE_SIGMA_M, ANGLE_SIGMA = np.sqrt(10.0), np.radians(0.003)  # the paper's variance of 10 m²; a theodolite
SIGMA = np.array([RANGE_SIGMA_M, ANGLE_SIGMA, ANGLE_SIGMA])
# 1-sigma per axis of the first position; velocity a fifth, acceleration a fiftieth of it per s, s²
START_M = 40.0
JERK_PSD = 1e-4  # m²/s⁵: the acceleration may wander by 0.08 m/s² in 60 s
OUTLIER_SHARE, OUTLIER_SIGMAS = 0.05, (6.0, 100.0)  # of the ranges; log-uniform, either sign
NEVER_NS = np.iinfo(np.int64).max
FIRST_OUTLIER = 10  # step; earlier, with one instrument and an unknown start, nothing could tell


class Method(NamedTuple):
    """A trajectory filter as it is compared."""

    track: Callable  # as `baselines.ekf`
    net: correction.Network | None
    jerk_psd: float  # m²/s⁵


class SimulatedRun(NamedTuple):
    """One simulated flight."""

    truth: np.ndarray  # (n, 9)
    z: np.ndarray  # (n, 3) measured
    x: np.ndarray  # (9,) where a filter believes to begin
    P: np.ndarray  # (9, 9)


def fly(
    rng: np.random.Generator, path: np.ndarray = PATH, start_m: float = START_M, first_outlier: int = STEPS
) -> SimulatedRun:
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
    return SimulatedRun(truth, z, x, np.diag(spread**2))


def any_path(rng: np.random.Generator) -> np.ndarray:
    """A flight like the paper's in some other direction: what networks learn from."""
    bearing, course = rng.uniform(0.0, 2 * np.pi, 2)
    away, speed, pull = rng.uniform(300.0, 800.0), rng.uniform(20.0, 60.0), rng.uniform(0.0, 3.0)
    p = away * np.sin(bearing), away * np.cos(bearing), rng.uniform(100.0, 400.0)
    v = speed * np.sin(course), speed * np.cos(course), rng.uniform(0.0, 15.0)
    a = pull * np.sin(course), pull * np.cos(course), rng.uniform(0.0, 1.5)
    return np.concatenate([p, v, a])


def m1_ukf(
    z: np.ndarray,
    sigma: np.ndarray,
    x: np.ndarray,
    P: np.ndarray,
    step_s: float,
    jerk_psd: float,
) -> Filtered:
    """The paper's unscented filter with its outlier handling; arguments as `baselines.ekf`."""
    noise = np.full(len(CHANNELS), np.nan)
    noise[:3] = sigma
    about = state.build([Sensor("theodolite", "theodolite", noise, slow=0.0)])
    n = len(z)
    measured = np.zeros(3 * n, ROW)
    measured["t_ns"] = np.repeat(np.arange(1, n + 1) * round(step_s * 1e9), 3)
    measured["channel"], measured["value"] = np.tile([0, 1, 2], n), z.ravel()
    rows, own, told = columns(about, measured), buffer.outcome(3 * n), gated.epoch_states(n, CORE)
    gated.admit(
        about, rows, own, 0, np.zeros((1, len(CHANNELS))), baselines.white_jerk(jerk_psd), x.copy(), P.copy(),
        0, status.fresh_memory(1), -1, METHODS["ga-bp-ukf"], 0.0, NEVER_NS, passes.trace(1, CORE, 1), told,
        state.scratch(CORE),
    )  # fmt: skip
    return Filtered(told.before_x, told.before_P, told.x, told.P)


def corrected(net: correction.Network | None, done: Filtered) -> np.ndarray:
    """(n, 9) the updated states, with the network's correction where there is one."""
    out = done.x1.copy()
    if net:
        for k in range(len(out)):
            correction.correct(net, done.x0[k], done.P0[k], done.x1[k], done.P1[k], out[k])
    return out


def errors(method: Method, runs: list[SimulatedRun]) -> np.ndarray:
    """(r, n, 3) position errors of ``method`` in ``runs``, m, station ENU."""
    done = (method.track(r.z, SIGMA, r.x, r.P, STEP_S, method.jerk_psd) for r in runs)
    return np.array([(corrected(method.net, d) - r.truth)[:, :3] for d, r in zip(done, runs, strict=True)])
