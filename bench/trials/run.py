"""Rows through an estimator as they would come, a quarter of a second at a time."""

import contextlib
import time
from collections.abc import Callable
from typing import NamedTuple

import numpy as np

from bench.trials import peers
from bench.trials.scene import Scene
from bench.trials.world import TRACK, VERDICT, methods, simulate
from filters.models.rows import joined
from filters.models.settings import Settings

BATCH_S = 0.25


class Run(NamedTuple):
    """What came out of an estimator."""

    track: np.ndarray  # (k,) TRACK, causal
    smoothed: np.ndarray  # (m,) TRACK, best estimate
    verdicts: np.ndarray  # (v,) VERDICT, the last one on each row
    report: dict
    cpu_s: float


def make_estimator(name: str, sensors, **settings):
    """An estimator by name: the project's own, those of the literature, and the peers of ``peers``."""
    if name in peers.PEERS:
        return peers.make(name, sensors)
    return methods.make(name, sensors, Settings(**settings))


def known_height(mean_m: float, sigma_m: float) -> dict[str, float] | None:
    """Settings that tell an estimator a target's height beforehand; None where it cannot be told."""
    fields = Settings._fields
    told = {"height_m": mean_m, "height_sigma_m": sigma_m}
    return told if set(told) <= set(fields) else None


def follow(one, rows: np.ndarray, clock_ns: np.ndarray, batch_s: float = BATCH_S) -> Run:
    """Run ``rows`` (n,) ROW through a fresh estimator in the order of ``clock_ns``, in batches."""
    with contextlib.suppress(AttributeError):  # some estimators cannot warm up on lines of sight alone
        one.warm_up()
    order = np.argsort(clock_ns, kind="stable")
    rows, clock_ns = rows[order], clock_ns[order]
    ends = np.flatnonzero(np.diff(clock_ns // round(batch_s * 1e9))) + 1
    began = time.process_time()
    steps = [one.step(part) for part in np.split(rows, ends)]
    steps.append(one.finish())
    smoothed = one.smooth()
    cpu_s = time.process_time() - began
    tracks, _, verdicts, *_ = zip(*steps, strict=True)
    return Run(joined(tracks, TRACK), smoothed, _last(joined(verdicts, VERDICT)), one.report(), cpu_s)


def tried(scene: Scene, make: Callable, order: str = "time", told: bool = False) -> Run:
    """A scene through ``make(sensors)``; ``told``: labelled rows left out. ``order``: time, receipt."""
    kept = scene.labels == simulate.NONE if told else np.ones(len(scene.rows), bool)
    clock_ns = scene.rows["t_ns"] if order == "time" else scene.arrival_ns
    return follow(make(scene.sensors), scene.rows[kept], clock_ns[kept])


def _last(verdicts: np.ndarray) -> np.ndarray:
    """Of several verdicts on a row the last one."""
    _, first = np.unique(verdicts["id"][::-1], return_index=True)
    return verdicts[::-1][first]
