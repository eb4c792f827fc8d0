"""One radar: air traffic at 4 s a scan with a coarse elevation, and drones at 1.3 s with gaps to minutes.

Errors at the plots that have a state, beside a small filter and the same estimator told the labels.
Outliers: for traffic mixed, for drones mostly in patches.

known   plots with a state of their own, %      sure5   beyond 5 sigma and not ambiguous, %
"""

import argparse
import multiprocessing
from functools import partial

import numpy as np

from bench.trials import columns, common, courses, peers, run, score
from bench.trials.world import simulate

COLUMNS = (
    "known", "rms", "median", "p95", "worst", "flat", "flat_p95", "beyond3", "beyond5", "sure5", "ambiguous",
    "nees", "rms_smooth", "beyond3_smooth", "told", "resets", "found", "false", "cv", "cv_worst", "silent_s",
    "cpu_s",
)  # fmt: skip
TRAFFIC = courses.Scan(4.0, 50.0, 0.1, 1.0)
DRONES = courses.Scan(1.3, 10.0, 0.2, 0.4)
PATCHY = {"isolated_share": 0.15, "run": (3, 25)}
CASES = {
    "traffic 0 %": (courses.traffic, TRAFFIC, 900.0, simulate.NO_ERRORS, {}, 300.0),
    "traffic 4 %": (courses.traffic, TRAFFIC, 900.0, simulate.NO_ERRORS, {"share": 0.04}, 300.0),
    "traffic 15 %": (courses.traffic, TRAFFIC, 900.0, simulate.NO_ERRORS, {"share": 0.15}, 300.0),
    "drone 0 %": (courses.drone, DRONES, 900.0, simulate.NO_ERRORS, {}, 100.0),
    "drone gaps": (
        courses.drone,
        DRONES,
        900.0,
        simulate.InstrumentErrors(gap_share=0.3, gap_s=(5.0, 150.0)),
        {},
        100.0,
    ),
}
for share in (0.04, 0.1, 0.23):
    gappy = simulate.InstrumentErrors(gap_share=0.3, gap_s=(5.0, 150.0))
    CASES[f"drone gaps {100 * share:g} %"] = (
        courses.drone, DRONES, 900.0, gappy, {"share": share, **PATCHY}, 100.0,
    )  # fmt: skip


def options(parser: argparse.ArgumentParser) -> None:
    """All that can be asked."""
    parser.description, parser.formatter_class = __doc__, argparse.RawDescriptionHelpFormatter
    parser.add_argument("--method", default="default")
    parser.add_argument("--setting", nargs="*", default=[], metavar="NAME=VALUE", help="of the estimator")
    common.seeds_option(parser, "0:4")
    parser.add_argument("--case", nargs="+", default=list(CASES), choices=list(CASES), metavar="CASE")
    parser.add_argument("--jobs", type=int, default=2)


def main(asked: argparse.Namespace) -> None:
    cases = [(name, seed) for name in asked.case for seed in asked.seeds]
    with multiprocessing.get_context("fork").Pool(asked.jobs) as pool:
        got = pool.map(partial(one, asked), cases, chunksize=1)
    results: dict[str, list[dict]] = {name: [] for name in asked.case}
    for (name, _), figures in zip(cases, got, strict=True):
        results[name].append(figures)
    print(f"{asked.method}: one radar, errors at the plots; flat: horizontal RMS; cv: small filter")
    print(columns.table(results, COLUMNS))


def one(asked, case) -> dict:
    """Figures of one flight."""
    name, seed = case
    fly, scan, seconds, errors, lies, psd = CASES[name]
    seen = courses.watched(name, fly(seconds, np.random.default_rng(seed)), scan, seed, errors, **lies)
    settings = {key: float(x) for key, x in (s.split("=") for s in asked.setting)}

    def make(sensors):
        return run.make_estimator(asked.method, sensors, **settings)

    out = at_plots(seen, run.tried(seen, make))
    out["told"] = at_plots(seen, run.tried(seen, make, told=True))["rms"] if lies else np.nan
    theirs = at_plots(seen, run.tried(seen, lambda sensors: peers.make("cv", sensors, psd, speed_mps=200.0)))
    return out | {"cv": theirs["rms"], "cv_worst": theirs["worst"]}


def at_plots(seen, ran: run.Run) -> dict:
    """Figures at the plots some seconds after the first state on, of those that have one."""
    t_ns = np.unique(seen.rows["t_ns"])
    if len(ran.track):
        t_ns = t_ns[t_ns >= ran.track["t_ns"][0] + round(5 * score.SETTLE_S * 1e9)]
    here = np.isin(t_ns, ran.track["t_ns"])
    if not here.any():
        return score.NONE_YET | {"known": 0.0}
    t_ns = t_ns[here]
    flat_m = score.errors(seen.flight, ran.track, t_ns, True, 2)[0]
    return score.figures(seen, ran, t_ns=t_ns) | {
        "known": float(here.mean()),
        "flat": score.rms(flat_m),
        "flat_p95": float(np.percentile(flat_m, 95)),
    }
