"""A quadrotor seen by two real angle stations, also in turns by one of them alone: see sweeps.py.

left    mean distance between motion capture and the vehicle's own position, m
"""

import argparse
from pathlib import Path

import numpy as np

from bench.trials import columns, peers, run, score
from bench.trials.real import sweeps

COLUMNS = (
    "left", "rms", "p95", "worst", "beyond3", "beyond5", "sure5", "ambiguous", "nees", "rms_smooth",
    "worst_smooth", "beyond3_smooth", "nees_smooth", "resets", "refused", "cv", "start_s", "cpu_s",
)  # fmt: skip
CV_PSD, CV_SPEED_MPS = 5.0, 3.0  # m²/s³, m/s: a quadrotor in a room


def options(parser: argparse.ArgumentParser) -> None:
    """All that can be asked."""
    parser.description, parser.formatter_class = __doc__, argparse.RawDescriptionHelpFormatter
    parser.add_argument("--data", type=Path, required=True, help="folder that holds lh1_*/")
    parser.add_argument("--run", nargs="+", help="FOLDER/NUMBER; else all")
    parser.add_argument("--sigma-mrad", type=float, default=4.0, help="1-sigma of every angle")
    parser.add_argument("--spell", type=float, default=0.0, help="seconds in ten by one station alone")
    parser.add_argument("--method", default="default")


def main(asked: argparse.Namespace) -> None:
    results = {name: [one(asked, name)] for name in asked.run or sweeps.runs(asked.data)}
    print(f"{asked.method}, {asked.sigma_mrad:g} mrad, {asked.spell:g} s in 10 by one station alone")
    print(columns.table(results, COLUMNS))


def one(asked: argparse.Namespace, name: str) -> dict:
    """Figures of one run."""
    seen = sweeps.load(asked.data, name, asked.sigma_mrad * 1e-3, asked.spell)
    ours = run.tried(seen.scene, lambda s: run.make_estimator(asked.method, s))
    figures = judged(seen, ours) | {"left": seen.left_m}
    theirs = run.tried(seen.scene, lambda s: peers.make("cv", s, CV_PSD, speed_mps=CV_SPEED_MPS))
    return figures | {"cv": judged(seen, theirs)["rms"]}


def judged(seen: sweeps.Seen, ran: run.Run) -> dict:
    """Figures at the rows that have a state, some seconds after the first one on."""
    t_ns = seen.judged_ns[np.isin(seen.judged_ns, ran.track["t_ns"])]
    if not len(t_ns):
        return score.NONE_YET
    t_ns = t_ns[t_ns >= t_ns[0] + round(score.SETTLE_S * 1e9)]
    return score.figures(seen.scene, ran, t_ns=t_ns)
