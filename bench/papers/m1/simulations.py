"""The GA-BP-UKF paper's comparison: its filter, the network of each, and the baselines, over many flights."""

from collections.abc import Callable
from typing import Any, NamedTuple

import numpy as np

from bench.accuracy import FIRST_SEED
from bench.papers.m1 import baselines
from bench.papers.m1.simulated_flight import (
    FIRST_OUTLIER,
    JERK_PSD,
    SIGMA,
    STEP_S,
    STEPS,
    Method,
    SimulatedRun,
    any_path,
    errors,
    fly,
    m1_ukf,
)
from filters.correction import correction, train
from gcs.learning import training  # the command's split, gains and report
from gcs.learning.dataset import Flown

LEARN_SEED, LEARN_RUNS, GROUP = (
    7,
    300,
    15,
)  # flights to learn from; how many of them count as one in the split
PLAN = train.Plan(epochs=20)
TUNING_SEED = 500
JERK_PSDS = (1e-6, 1e-5, 1e-4, 1e-3, 1e-2, 1e-1, 1.0)  # the tuned filters choose from
STARTS_M = (10.0, 30.0, 50.0, 100.0)


class SimulationErrors(NamedTuple):
    """Position errors of r flights of n steps, m."""

    clean: np.ndarray  # (r, n, 3) simulation 1
    dirty: np.ndarray  # (r, n, 3) simulation 2: the same flights with outliers


def methods(runs: int, tuning: int, plan: train.Plan) -> dict[str, Method]:
    """What is compared; networks learn from ``runs`` flights in every direction, ``tuning`` tune the tuned.

    "full gain" adds the network's whole output, as the paper does; else each output counts as far as the
    check flights bear it, which may be not at all.
    """
    genetic = training.learn(lessons(m1_ukf, runs), plan)
    random = training.learn(lessons(baselines.ekf, runs), plan, genetic=False)
    return {
        "ga-bp-ukf": Method(m1_ukf, genetic, JERK_PSD),
        "ga-bp-ukf, full gain": Method(m1_ukf, genetic._replace(gain=np.ones(correction.CORE)), JERK_PSD),
        "ga-bp-ukf, no network": Method(m1_ukf, None, JERK_PSD),
        "bp-ekf": Method(baselines.ekf, random, JERK_PSD),
        "ekf": Method(baselines.ekf, None, JERK_PSD),
        "ekf, tuned": Method(baselines.ekf, None, tuned(baselines.ekf, tuning)),
        "classic ukf, tuned": Method(baselines.classic_ukf, None, tuned(baselines.classic_ukf, tuning)),
    }


def simulations(compared: dict[str, Method], runs: int) -> dict[str, SimulationErrors]:
    """Simulations 1 and 2 on ``runs`` flights that served neither learning nor tuning."""
    clean, dirty = (flights(runs, first_outlier=first) for first in (STEPS, FIRST_OUTLIER))
    return {
        name: SimulationErrors(errors(method, clean), errors(method, dirty))
        for name, method in compared.items()
    }


def flights(runs: int, first_seed: int = FIRST_SEED, **settings: Any) -> list[SimulatedRun]:
    """``runs`` of `simulated_flight.fly`."""
    return [fly(np.random.default_rng(first_seed + k), **settings) for k in range(runs)]


def figures(found: dict[str, SimulationErrors]) -> dict[str, dict]:
    """{method: {mae_m, median_m, rmse_m, rmse_outliers_m, rise}}, per axis.

    ``median_m`` is the mean absolute error as median over the flights, ``rise`` what outliers do to the RMSE.
    """
    out = {}
    for name, (clean, dirty) in found.items():
        per_run = np.abs(clean).mean(axis=(1, 2))
        rmse, rmse_outliers = (float(np.sqrt((one**2).mean())) for one in (clean, dirty))
        out[name] = {
            "mae_m": float(per_run.mean()),
            "median_m": float(np.median(per_run)),
            "rmse_m": rmse,
            "rmse_outliers_m": rmse_outliers,
            "rise": rmse_outliers / rmse,
        }
    return out


def start_table(runs: int) -> list[dict]:
    """Mean absolute error, m, of EKF and UKF without networks, by how well the start is known."""
    out = []
    for start_m in STARTS_M:
        flown = flights(runs, start_m=start_m)
        ekf, ukf = (
            float(np.abs(errors(Method(track, None, JERK_PSD), flown)).mean())
            for track in (baselines.ekf, m1_ukf)
        )
        out.append({"start_m": start_m, "ekf": ekf, "ukf": ukf, "ratio": ukf / ekf})
    return out


def lessons(track: Callable, runs: int) -> training.Split:
    """What ``track`` did in ``runs`` flights in every direction, beside what it should have done."""
    rng = np.random.default_rng(LEARN_SEED)
    learnt = []
    for _ in range(runs // GROUP):
        group = [fly(rng, any_path(rng)) for _ in range(GROUP)]
        done = [track(r.z, SIGMA, r.x, r.P, STEP_S, JERK_PSD) for r in group]
        x0, P0, x1, P1 = (np.concatenate(column) for column in zip(*done, strict=True))
        u, e = correction.samples(x0, P0, x1, P1, np.concatenate([r.truth for r in group]))
        learnt.append(Flown("", u, e, correction.sigmas_of(x0, P1)))
    return training.divide(learnt)


def tuned(track: Callable, runs: int) -> float:
    """The jerk PSD of JERK_PSDS with the smallest error over ``runs`` flights that are not in the tables."""
    flown = flights(runs, TUNING_SEED)
    return min(JERK_PSDS, key=lambda jerk_psd: np.abs(errors(Method(track, None, jerk_psd), flown)).mean())
