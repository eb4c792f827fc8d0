"""The default correction network: what training costs, what a step costs, what flights never seen gain."""

import time
from collections.abc import Callable
from pathlib import Path
from tempfile import TemporaryDirectory

import numpy as np

from bench.accuracy import FIRST_SEED
from filters.correction import correction, train
from filters.models.settings import Settings
from gcs.learning import dataset, network, training

CALLS, REPEATS = 500, 200


def measure(flights: int, unseen: int, say: Callable[[str], None]) -> dict:
    """Train as ``gcs train`` does on ``flights``; try it on ``unseen`` others, each with a range of its own.

    Returns {training_s, inference_us, compiled_us, installed, total as of `gcs.learning.training.total`}.
    """
    with TemporaryDirectory() as folder:
        begin_s = time.monotonic()
        installed = training.run(Path(folder), flights, [], train.Plan(), Settings(), 0, None, say)
        training_s = time.monotonic() - begin_s
        net = network.load(Path(folder) / "network.json")
    flown = [dataset.simulated(FIRST_SEED + k, Settings()) for k in range(unseen)]
    per_call_us, compiled_us = inference(net, flown[0].u)
    return {
        "training_s": training_s,
        "inference_us": per_call_us,
        "compiled_us": compiled_us,
        "installed": installed,
        "total": training.total([training.effect(net, one) for one in flown]),
    }


def inference(net: correction.Network, u: np.ndarray) -> tuple[float, float]:
    """µs of one correction called as the filter calls it, and of the network alone in a compiled loop."""
    one, P = correction.Correction(net), np.eye(correction.CORE)
    x0, x1 = np.arange(1.0, 10.0), np.arange(1.0, 10.0) + 0.1
    tiled = np.resize(u, (CALLS, correction.CORE))

    def calls():
        for _ in range(CALLS):
            one(x0, P, x1, P)

    return tuple(_best_s(work) / CALLS * 1e6 for work in (calls, lambda: correction.respond_all(net, tiled)))


def _best_s(work: Callable) -> float:
    """The least of REPEATS wall times: the one that the machine's other work disturbed least."""
    work()
    times_s = []
    for _ in range(REPEATS):
        begin_s = time.perf_counter()
        work()
        times_s.append(time.perf_counter() - begin_s)
    return min(times_s)
