"""Small flights for the estimator's tests."""

import numpy as np

from filters.methods import make
from filters.models.rows import ROW, Sensor
from filters.models.settings import Settings
from filters.simulation import scenario, simulate

SITES = {"theo-a": (800.0, 0.0, 0.0), "theo-b": (0.0, 900.0, 10.0), "radar": (-700.0, -500.0, 0.0)}
SIGMA = {"theo-a": (1.0, 5e-5, 5e-5), "theo-b": (1.0, 5e-5, 5e-5), "radar": (5.0, 1e-3, 1e-3, 0.3)}


def sensors(names=("ins", *SITES), estimate=(), slow=1.0) -> list[Sensor]:
    out = []
    for name in names:
        sigma = np.full(13, np.nan)
        if name == "ins":
            sigma[4:] = np.repeat([0.2, 0.1, 0.3], 3)
            out.append(Sensor(name, "ins", sigma, estimate=estimate))
        else:
            sigma[: len(SIGMA[name])] = SIGMA[name]
            kind = "radar" if name == "radar" else "theodolite"
            out.append(Sensor(name, kind, sigma, np.array(SITES[name]), estimate=estimate, slow=slow))
    return out


def scene(
    seed,
    share=0.0,
    seconds=40.0,
    level="aggressive",
    names=("ins", *SITES),
    estimate=(),
    errors=None,
    patch=None,
    start=(0.0, 0.0, 120.0),
):
    """(truth, sensors, rows (k,) ROW in order of time, labels (k,)).

    ``patch`` is (kind, sensor's name, start s, duration s, size in sigmas).
    """
    rng = np.random.default_rng(seed)
    truth = scenario.flight(seconds, 100.0, level, rng, start)
    used, rows, labels = sensors(names, estimate), [], []
    for s, sensor in enumerate(used):
        if sensor.kind == "ins":
            seen = simulate.ins(truth, rng, simulate.InsErrors(latency_s=0.0))
        else:
            seen = simulate.instrument(
                truth, sensor, 20.0, rng, (errors or {}).get(sensor.name, simulate.NO_ERRORS)
            )
            if patch and patch[1] == sensor.name:
                kind, _, begin, length, size = patch
                sigma = sensor.sigma[seen.channels]
                there = tuple(np.flatnonzero(np.isfinite(sigma)))
                seen = simulate.patch(
                    seen, np.nan_to_num(sigma), simulate.LongPatch(kind, begin, length, there, size), rng
                )
            if share:
                seen = simulate.contaminate(seen, sensor.sigma[seen.channels], rng, share)
        block = np.zeros(seen.values.size, ROW)
        block["t_ns"], block["sensor"] = np.repeat(seen.t_ns, seen.values.shape[1]), s
        block["channel"], block["value"] = np.tile(seen.channels, len(seen.t_ns)), seen.values.ravel()
        there = np.isfinite(block["value"])
        rows.append(block[there])
        labels.append(seen.labels.ravel()[there])
    rows, labels = np.concatenate(rows), np.concatenate(labels)
    order = np.lexsort((rows["channel"], rows["sensor"], rows["t_ns"]))
    rows, labels = rows[order], labels[order]
    rows["id"] = np.arange(len(rows))
    return truth, used, rows, labels


def run(estimator, rows, batch=None):
    """(track, smoothed, final verdicts in order of id) of all rows, ``batch`` at a time."""
    parts = [rows] if batch is None else [rows[i : i + batch] for i in range(0, len(rows), batch)]
    steps = [estimator.step(part) for part in parts] + [estimator.finish()]
    verdicts = np.concatenate([step.verdicts for step in steps])
    final = verdicts[verdicts["final"]]
    return (
        np.concatenate([step.track for step in steps]),
        np.concatenate([step.smoothed for step in steps]),
        final[np.argsort(final["id"], kind="stable")],
    )


def error_m(track, truth, skip_s=5.0):
    """(k,) distance from the truth after the first ``skip_s`` seconds."""
    t = (track["t_ns"] - simulate.T0_NS) * 1e-9
    there = (t > skip_s) & (t <= truth.t_s[-1])
    return np.linalg.norm(track["x"][there, :3] - scenario.at(truth, t[there])[0], axis=1)


def oracle(used, rows, labels, **settings):
    """The same estimator told which values are outliers: (estimator, its track)."""
    estimator = make("ukf", used, Settings(**settings))
    return estimator, run(estimator, rows[labels == 0])[0]
