"""One flight of a case, once through every method: its figures."""

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from bench import score
from bench.scene import Case, SimulatedFlight, first_instrument, fly
from filters import methods as named
from filters.baselines import baselines
from filters.simulation import simulate
from filters.smoother.estimator import FixedLagSmoother

METHODS = tuple(named.METHODS)
LATE_S, ARRIVAL_S = 0.8, 0.1  # largest delay; arrivals are handed over so often


def measure(case: Case, seed: int, seconds: float, methods: Sequence[str]) -> dict[str, dict]:
    """Figures of one flight, by method. The oracle: the default over the good rows alone."""
    flight = fly(case, seed, seconds)
    told = named.make("default", flight.sensors)
    oracle = follow(told, flight.rows[flight.labels == simulate.NONE])
    return {method: _figures(case, flight, oracle, method, seed, seconds) for method in methods}


class MethodRun(NamedTuple):
    """What came out of an estimator."""

    track: np.ndarray  # (k,) TRACK
    left: np.ndarray  # (m,) TRACK, smoothed by the window
    smoothed: np.ndarray  # (k,) TRACK, best estimate
    verdicts: np.ndarray  # (n,) VERDICT, final
    report: dict


def follow(
    one: FixedLagSmoother | baselines.Baseline, rows: np.ndarray, ends: np.ndarray | None = None
) -> MethodRun:
    """Run ``rows`` through a fresh estimator, all at once or in the parts that stop at ``ends``."""
    steps = [one.step(part) for part in (np.split(rows, ends) if ends is not None else [rows])]
    steps.append(one.finish())
    track, left, verdicts = (
        np.concatenate(column) for column in zip(*(step[:3] for step in steps), strict=True)
    )
    return MethodRun(track, left, one.smooth(), verdicts[verdicts["final"]], one.report())


def _figures(
    case: Case, flight: SimulatedFlight, oracle: MethodRun, method: str, seed: int, seconds: float
) -> dict:
    run = follow(named.make(method, flight.sensors), flight.rows)
    t_ns = score.epochs(run.track, oracle.track, flight.truth)
    error_m = score.distance_m(run.track, flight.truth, t_ns)
    smoothed_m, oracle_m, oracle_smoothed_m = (
        score.rms(score.distance_m(track, flight.truth, t_ns))
        for track in (run.smoothed, oracle.track, oracle.smoothed)
    )
    figures = {
        "seed": seed,
        "rms_m": score.rms(error_m),
        "oracle_rms_m": oracle_m,
        "ratio": score.rms(error_m) / oracle_m,
        "smoothed": smoothed_m / oracle_smoothed_m,
        "largest_m": float(error_m.max()),
        "lost": score.lost(t_ns, error_m),
        "resets": int(run.track["reset_counter"][-1]),
        "seen": score.detection(flight, run.verdicts),
        "nis": score.nis(run.report),
        "nees": score.nees(run.track, flight.truth),
        "oracle_nees": float(np.mean(score.nees(oracle.track, flight.truth))) / 3.0,
        "patches": score.patches(flight, run.track, oracle.track),
    }
    if case.wrong != simulate.NO_ERRORS:
        straight = measure(case._replace(wrong=simulate.NO_ERRORS), seed, seconds, (method,))[method]
        figures["beside"] = figures["rms_m"] / straight["rms_m"]
        figures["recovered"] = score.recovered(run.report, first_instrument(case), case.wrong)
    if case.late_share:
        figures["late_m"] = _late_m(case, flight, run, method, seed)
    return figures


def _late_m(case: Case, flight: SimulatedFlight, run: MethodRun, method: str, seed: int) -> float:
    """Largest difference of the smoothed track when a share of the rows comes late."""
    rng = np.random.default_rng(seed)
    n = len(flight.rows)
    delay_s = np.where(rng.random(n) < case.late_share, rng.uniform(0.0, LATE_S, n), 0.0)
    arrival_s = (flight.rows["t_ns"] - simulate.T0_NS) * 1e-9 + delay_s
    order = np.argsort(arrival_s, kind="stable")
    ends = np.flatnonzero(np.diff(arrival_s[order] // ARRIVAL_S)) + 1
    late = follow(named.make(method, flight.sensors), flight.rows[order], ends)
    if len(late.left) != len(run.left):
        return float("inf")
    return float(np.abs(late.left["x"] - run.left["x"]).max())
