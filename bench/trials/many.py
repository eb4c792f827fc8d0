"""Flights times seeds: every combination once through an estimator, on a few processes."""

import multiprocessing
from collections.abc import Sequence
from functools import cache, partial
from pathlib import Path
from typing import NamedTuple

from bench.trials import flights, peers, run, scene, score
from bench.trials.world import simulate

DEVELOPMENT_SEED = 1
PSDS = (0.3, 1.0, 3.0, 10.0, 30.0, 100.0, 300.0, 1000.0, 3e3, 1e4)


class Trial(NamedTuple):
    """What is tried, but for flight and seed."""

    data: Path | None
    method: str = "default"
    sensors: tuple[str, ...] = scene.STANDARD
    wrong: scene.Wrong = scene.Wrong()
    estimate: tuple[str, ...] = ()
    seconds: float | None = flights.SPAN_S
    order: str = "time"
    peers: bool = True
    told: bool = True
    settings: tuple[tuple[str, float], ...] = ()


def all_of(trial: Trial, names: Sequence[str], seeds: Sequence[int], jobs: int) -> dict[str, list[dict]]:
    """Figures by flight, one dict per seed."""
    asked = [(name, seed) for name in names for seed in seeds]
    if jobs > 1:
        with multiprocessing.get_context("fork").Pool(jobs) as pool:
            got = pool.map(partial(_one, trial), asked, chunksize=1)
    else:
        got = [_one(trial, one) for one in asked]
    results: dict[str, list[dict]] = {name: [] for name in names}
    for (name, seed), figures in zip(asked, got, strict=True):
        results[name].append({"seed": seed} | figures)
    return results


def _one(trial: Trial, asked: tuple[str, int]) -> dict:
    return one(trial, *asked)


def one(trial: Trial, name: str, seed: int) -> dict:
    """Figures of one flight and one seed."""
    flight = flights.load(name, trial.data, seed, trial.seconds)
    seen = scene.watch(flight, trial.sensors, seed, trial.wrong, trial.estimate)
    make = partial(run.make_estimator, trial.method, **dict(trial.settings))
    ours, told = run.tried(seen, make, trial.order), None
    labelled = bool((seen.labels != simulate.NONE).any())
    if trial.told and labelled:
        told = run.tried(seen, make, trial.order, told=True)
    figures = score.figures(seen, ours, told)
    if told is not None:
        figures["told_cpu_s"] = told.cpu_s
    if trial.peers and trial.sensors != ("ins",):
        figures |= beside(seen, trial, name, figures["rms"])
    return figures


def beside(seen: scene.Scene, trial: Trial, name: str, rms_m: float) -> dict:
    """The small filters on the same rows."""
    key = trial._replace(method="", settings=(), told=False, wrong=scene.Wrong())
    ekf = run.tried(seen, lambda sensors: peers.make("jerk", sensors, tuned(key, name, "jerk")), told=True)
    cv = run.tried(seen, lambda sensors: peers.make("cv", sensors, tuned(key, name, "cv-all")))
    ekf_score, cv_score = score.figures(seen, ekf), score.figures(seen, cv)
    return {
        "ekf": ekf_score["rms"], "over_ekf": rms_m / ekf_score["rms"], "ekf_smooth": ekf_score["rms_smooth"],
        "cv": cv_score["rms"], "cv_smooth": cv_score["rms_smooth"], "cv_worst": cv_score["worst"],
    }  # fmt: skip


@cache
def tuned(trial: Trial, name: str, peer: str) -> float:
    """The noise density under which a development flight without outliers is likeliest."""
    flight = flights.load(name, trial.data, DEVELOPMENT_SEED, trial.seconds)
    seen = scene.watch(flight, trial.sensors, DEVELOPMENT_SEED)

    def likelihood(psd: float) -> float:
        return run.tried(seen, lambda sensors: peers.make(peer, sensors, psd)).report["log_likelihood"]

    return max(PSDS, key=likelihood)
