"""``python -m bench accuracy``: many seeds of every case, each against the oracle."""

import time
from collections.abc import Sequence
from concurrent.futures import ProcessPoolExecutor
from functools import partial
from pathlib import Path

import numpy as np

from bench import table
from bench.cases import CASES
from bench.measure import METHODS, measure
from bench.scene import Case
from filters.models.settings import Settings
from gcs.contract.messages import InputError
from gcs.outputs.console import say

FIRST_SEED = 10_000  # those below serve for tuning


def run(
    seeds: int = 50,
    first_seed: int = FIRST_SEED,
    seconds: float = 60.0,
    names: Sequence[str] = (),
    methods: Sequence[str] = ("default",),
    processes: int = 2,
    out: Path | None = None,
) -> dict:
    """Fly every case, or those called ``names``; prints a table and returns what it writes to the file."""
    known = {case.name: case for case in CASES}
    for name in names:
        if name not in known:
            raise InputError(f"bench case {name!r}: choose one of {'; '.join(known)}")
    for name in methods:
        if name not in METHODS:
            raise InputError(f"bench method {name!r}: choose one of {', '.join(METHODS)}")
    begin_s, results = time.monotonic(), []
    with ProcessPoolExecutor(processes) as pool:
        for case in (known[name] for name in names or known):
            say(f"{time.monotonic() - begin_s:5.0f} s  {case.name}")
            work = partial(measure, case, seconds=seconds, methods=tuple(methods))
            runs = list(pool.map(work, range(first_seed, first_seed + seeds)))
            results += [summary(case, method, [r[method] for r in runs]) for method in methods]
    found = {
        "seeds": seeds,
        "first_seed": first_seed,
        "seconds": seconds,
        "settings": {k: None if value != value else value for k, value in Settings()._asdict().items()},
        "wall_s": time.monotonic() - begin_s,
        "cases": results,
    }
    table.show(*table.accuracy(results))
    say(f"written: {table.write(found, out, 'accuracy')}")
    return found


def summary(case: Case, method: str, runs: list[dict]) -> dict:
    """Median and worst over the seeds, with the seed of the worst."""
    found = {name: np.sum([r["seen"][name] for r in runs], axis=0) for name in ("isolated", "patch", "false")}
    nees = np.mean([r.pop("nees") for r in runs], axis=0) / 3.0
    half = 1.96 * np.sqrt(2.0 / (3.0 * len(runs)))
    inside = [good for r in runs for _, good in r["nis"].values()]
    figures = {
        **_spread("ratio", [r["ratio"] for r in runs]),
        **_spread("smoothed", [r["smoothed"] for r in runs]),
        "rms_m": float(np.median([r["rms_m"] for r in runs])),
        "oracle_rms_m": float(np.median([r["oracle_rms_m"] for r in runs])),
        "lost": sum(r["lost"] for r in runs),
        "found_isolated": _share(*found["isolated"]),
        "found_patch": _share(*found["patch"]),
        "false_per_10000": 1e4 * _share(*found["false"]),
        "nees_mean": float(nees.mean()),
        "oracle_nees": float(np.mean([r["oracle_nees"] for r in runs])),
        "nees_in_band": float(np.mean(np.abs(nees - 1.0) <= half)),
        "nis_in_band": float(np.mean(inside)),
    }
    patches = [p for r in runs for p in r["patches"]]
    if patches:
        figures |= _spread("during", [p["during"] for p in patches])
        back_s = _spread("back", [p["back_s"] for p in patches])
        figures |= {f"{name}_s": value for name, value in back_s.items()}
    if "beside" in runs[0]:
        figures |= _spread("beside", [r["beside"] for r in runs])
        figures["within_3"] = float(np.mean([max(r["recovered"].values()) <= 3.0 for r in runs]))
    if "late_m" in runs[0]:
        figures["late_m"] = max(r["late_m"] for r in runs)
    worst = max(runs, key=lambda r: r["ratio"])["seed"]
    return {
        "case": case.name, "row": case.row, "method": method, "limits": dict(case.limits),
        "figures": figures, "worst_seed": worst, "runs": runs,
    }  # fmt: skip


def _spread(name: str, values: list[float]) -> dict[str, float]:
    return {f"{name}_median": float(np.median(values)), f"{name}_worst": float(np.max(values))}


def _share(part: int, whole: int) -> float | None:
    return float(part / whole) if whole else None
