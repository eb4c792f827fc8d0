"""Boats seen by a ferry's real radar and lidar: errors at every plot, beside a small filter."""

import argparse
from pathlib import Path

import numpy as np

from bench.trials import columns, flights, peers, run, score
from bench.trials.real import ferry

COLUMNS = (
    "rms", "median", "p95", "worst", "far_s", "beyond3", "nees", "rms_smooth", "worst_smooth",
    "beyond3_smooth", "resets", "cv", "cv_worst", "cv_smooth", "cv_resets", "plots", "refused", "misleading",
    "ambiguous", "level_h",
)  # fmt: skip
CV_PSD = 0.3  # m²/s³: boats


def options(parser: argparse.ArgumentParser) -> None:
    """All that can be asked."""
    parser.description = __doc__
    parser.add_argument("--data", type=Path, help="folder that holds autoferry/; else GCS_DATA")
    parser.add_argument("--method", default="default")
    parser.add_argument("--setting", nargs="*", default=[], metavar="NAME=VALUE", help="of the estimator")
    parser.add_argument("--sensors", nargs="+", default=list(ferry.EYES), help=", ".join(ferry.EYES))
    parser.add_argument("--estimate", nargs="*", default=[], help="bias, clock")


def main(asked: argparse.Namespace) -> None:
    data = flights.folder(asked.data)
    if data is None:
        raise SystemExit("name the folder with --data or GCS_DATA")
    settings = {name: float(x) for name, x in (s.split("=") for s in asked.setting)}
    told = run.known_height(ferry.HEIGHT_M, ferry.HEIGHT_SIGMA_M)
    results = {}
    for scenario in ferry.SCENARIOS:
        for boat in ferry.BOATS:
            figures = one(asked, data, scenario, boat, settings, told)
            results[f"scenario{scenario}-boat{boat}"] = [figures]
    how = "height told beforehand" if told else "elevation 0 with a wide sigma in place of a height"
    print(
        f"{asked.method}, {' '.join(asked.sensors)}, {how}; horizontal errors at the plots; cv: small filter"
    )
    print(columns.table(results, COLUMNS))


def one(asked, data: Path, scenario: int, boat: int, settings: dict, told: dict | None) -> dict:
    """Figures of one boat."""
    about = data, scenario, boat, tuple(asked.sensors)
    seen = ferry.load(*about, flat=told is not None, estimate=asked.estimate)
    ours = run.tried(seen, lambda s: run.make_estimator(asked.method, s, **(told or {}), **settings))
    figures = judged(seen, ours) | {"plots": float(len(np.unique(seen.rows["t_ns"])))}
    tall = ferry.load(*about)
    cv = run.tried(tall, lambda s: peers.make("cv", s, CV_PSD))
    theirs = judged(tall, cv)
    return figures | {f"cv{name}": theirs[x] for name, x in PEER.items()}


PEER = {"": "rms", "_worst": "worst", "_smooth": "rms_smooth", "_resets": "resets"}


def judged(seen, ours: run.Run) -> dict:
    """Figures at the plots, from some seconds after the first state on."""
    t_ns = np.unique(seen.rows["t_ns"])
    if len(ours.track):
        t_ns = t_ns[t_ns >= ours.track["t_ns"][0] + round(score.SETTLE_S * 1e9)]
    return score.figures(seen, ours, t_ns=t_ns, axes=2)
