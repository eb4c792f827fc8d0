"""A flight of four sensors with outliers, and an estimator's run through it."""

import numpy as np

from filters import methods
from tests.filters.smoother.kit import small

SENSORS = small.four()


def run(rows, *, method="default", sensors=SENSORS, parts=None, settings=None, between=None):
    """(track, smoothed, all verdicts, estimator) of ``rows`` taken ``parts`` by parts.

    ``between`` is called with the estimator after each of them.
    """
    estimator, steps = methods.make(method, sensors, settings), []
    for part in parts or [rows]:
        steps.append(estimator.step(part))
        if between:
            between(estimator)
    steps.append(estimator.finish())
    return *(np.concatenate([s[k] for s in steps]) for k in range(3)), estimator


def finals(verdicts):
    final = verdicts[verdicts["final"]]
    return final[np.argsort(final["id"], kind="stable")]


def error_m(track):
    return np.linalg.norm(track["x"][:, :3] - small.truth(track["t_ns"] * 1e-9)[0], axis=1)


def contaminated(seconds=8.0, seed=0, share=0.03):
    """(rows, (k,) whether an outlier)."""
    rows = small.fly(SENSORS, seconds, seed=seed)
    rng = np.random.default_rng(seed + 100)
    sigma = np.array([SENSORS[r["sensor"]].sigma[r["channel"]] for r in rows])
    bad = rng.random(len(rows)) < share
    rows["value"][bad] += (sigma * rng.choice([-1, 1], len(rows)) * rng.uniform(15, 60, len(rows)))[bad]
    return rows, bad


def same(a, b):
    return all(
        np.array_equal(a[name], b[name], equal_nan=a[name].dtype.kind == "f") for name in a.dtype.names
    )
