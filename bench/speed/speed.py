"""``python -m bench speed``: one update beside other filters, one measurement live, one hour of flight."""

import time
from pathlib import Path

import numpy as np

from bench import table
from bench.scene import RATE_HZ, Case, SimulatedFlight, fly, sensor
from bench.speed.peers import PEERS, Task
from filters import methods
from filters.simulation import scenario, simulate
from gcs.outputs.console import say

SEED = 10_000
INS_RATE_HZ = 35.0  # as a telemetry link gives it, beside three instruments at RATE_HZ
BATCH_S = 1.0  # of data in one step of a replay
LIMITS = {"C++, Eigen": 1.0, "filterpy": 300.0, "live_us": 200.0, "hour_s": 60.0}


def run(seconds: float = 3600.0, repeats: int = 7, shots: int = 400, out: Path | None = None) -> dict:
    """Measure; ``seconds`` is the replayed flight, ``repeats`` how often peers take turns on ``shots``."""
    updates = compare(task(shots), repeats)
    measured = live(fly(Case("speed", 9, share=0.041, ins_rate_hz=INS_RATE_HZ), SEED, 60.0))
    whole_s = replay(fly(Case("speed", 9, share=0.041), SEED, seconds))
    found = {
        "update": updates,
        "live": measured,
        "replay": {"flight_s": seconds, "took_s": whole_s, "per_hour_s": whole_s * 3600.0 / seconds},
    }
    table.show(*table.speed(found, LIMITS))
    say(f"written: {table.write(found, out, 'speed')}")
    return found


def task(shots: int) -> Task:
    """Shots of one theodolite, in a flight; the start is off by about its own uncertainty."""
    rng = np.random.default_rng(SEED)
    watcher = sensor("theo-a")
    truth = scenario.flight(shots / RATE_HZ + 1.0, 100.0, "normal", rng)
    seen = simulate.instrument(truth, watcher, RATE_HZ, rng)
    t_s = (seen.t_ns - seen.t_ns[0]) * 1e-9
    first = scenario.at(truth, (seen.t_ns[:1] - simulate.T0_NS) * 1e-9)
    sigma = np.repeat([5.0, 2.0, 1.0], 3)
    x = np.hstack(first).ravel() + sigma * rng.normal(size=9)
    return Task(watcher, x, np.diag(sigma**2), t_s[:shots], seen.values[:shots, :3])


def compare(work: Task, repeats: int) -> dict[str, dict]:
    """Every peer in turn, ``repeats`` times; the ratio is the median of those within one turn."""
    turns = [{name: peer(work) for name, peer in PEERS.items()} for _ in range(repeats + 1)][1:]
    out = {}
    for name in PEERS:
        if turns[0][name] is None:
            out[name] = None
            continue
        ratio = [turn[name].ns / turn["ours, numba"].ns for turn in turns]
        apart = np.linalg.norm(turns[0][name].x[:3] - turns[0]["ours, numba"].x[:3])
        out[name] = {
            "us": float(np.median([turn[name].ns for turn in turns])) / 1e3,
            "times_ours": float(np.median(ratio)),
            "times_ours_range": [float(min(ratio)), float(max(ratio))],
            "apart_m": float(apart),
        }
    return out


def live(flight: SimulatedFlight) -> dict[str, float]:
    """Every measurement in a step of its own, as a station gets them: microseconds, Python included.

    ``mean_us`` is all work; a state waits for the step, ``state_…``; with the rest after it: ``both_…``.
    """
    one = methods.make("default", flight.sensors)
    one.warm_up()
    t_ns = flight.rows["t_ns"]
    ends = np.flatnonzero(np.diff(t_ns)) + 1
    took = []
    for part, next_ns in zip(np.split(flight.rows, ends)[:-1], t_ns[ends].tolist(), strict=True):
        begin_s = time.perf_counter()
        one.step(part)
        told_s = time.perf_counter()
        one.rest(next_ns)
        took.append((told_s - begin_s, time.perf_counter() - begin_s))
    state, both = 1e6 * np.array(took[len(took) // 10 :]).T
    return {
        "mean_us": float(np.mean(both)), "state_mean_us": float(np.mean(state)),
        "state_median_us": float(np.median(state)), "state_p99_us": float(np.percentile(state, 99)),
        "both_p99_us": float(np.percentile(both, 99)), "both_max_us": float(np.max(both)),
    }  # fmt: skip


def replay(flight: SimulatedFlight) -> float:
    """Seconds for the whole flight, in batches, and its best estimate."""
    one = methods.make("default", flight.sensors)
    one.warm_up()
    t_s = (flight.rows["t_ns"] - simulate.T0_NS) * 1e-9
    parts = np.split(flight.rows, np.flatnonzero(np.diff(t_s // BATCH_S)) + 1)
    begin_s = time.perf_counter()
    for part in parts:
        one.step(part)
    one.finish()
    one.smooth()
    return time.perf_counter() - begin_s
