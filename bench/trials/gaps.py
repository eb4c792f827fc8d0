"""One radar, a straight flight, no outliers; nothing for a while, then as before.

Per gap and scan: error of the newest state at the plots after the gap over the RMS error before it, the RMS
over distances, speeds and seeds; the worst single plot of them (from the third on); values of the first ten
plots refused, %. Below each line the same of a small filter: constant velocity, anew after 10 s of silence.
"""

import argparse
import itertools
import multiprocessing
from functools import partial

import numpy as np

from bench.trials import columns, common, courses, peers, run, scene, score
from bench.trials.world import ISOLATED, PATCH

GAPS_S = (8.0, 15.0, 30.0, 60.0, 120.0)
DISTANCES_M, SPEEDS_MPS = (2e3, 10e3, 50e3), (20.0, 60.0, 250.0)
SCANS = {
    "10hz": courses.Scan(0.1, 5.0, 0.05, 0.05),
    "1.3s": courses.Scan(1.3, 10.0, 0.1, 0.2),
    "4s": courses.Scan(4.0, 30.0, 0.1, 0.3),
}
BEFORE, FASTEST_BEFORE_S = 40, 30.0  # plots before the gap, and at least so many seconds
PLOTS = 10  # after the gap
PEER_PSD, PEER_SPEED_MPS = 0.5, 200.0


def options(parser: argparse.ArgumentParser) -> None:
    """All that can be asked."""
    parser.description, parser.formatter_class = __doc__, argparse.RawDescriptionHelpFormatter
    parser.add_argument("--method", default="default")
    parser.add_argument("--setting", nargs="*", default=[], metavar="NAME=VALUE", help="of the estimator")
    common.seeds_option(parser, "0:2")
    parser.add_argument("--scan", nargs="+", default=list(SCANS), choices=list(SCANS))
    parser.add_argument("--gap", nargs="+", type=float, default=list(GAPS_S))
    parser.add_argument("--full", action="store_true", help="a line for every distance and speed")
    parser.add_argument("--jobs", type=int, default=2)


def main(asked: argparse.Namespace) -> None:
    cases = list(itertools.product(asked.scan, asked.gap, DISTANCES_M, SPEEDS_MPS, asked.seeds))
    with multiprocessing.get_context("fork").Pool(asked.jobs) as pool:
        got = pool.map(partial(one, asked), cases, chunksize=4)
    groups: dict[str, list] = {}
    for (scan, gap_s, distance_m, speed_mps, _), (ours, theirs) in zip(cases, got, strict=True):
        name = f"{scan} gap {gap_s:g} s"
        if asked.full:
            name += f" {distance_m / 1e3:g} km {speed_mps:g} m/s"
        groups.setdefault(name, []).append(ours)
        groups.setdefault(f"{name}  (peer)", []).append(theirs)
    results = {name: [summary(many)] for name, many in groups.items()}
    print(f"{asked.method}: error at plots after the gap over the RMS before it")
    wanted = (*(f"plot{k}" for k in range(1, PLOTS + 1)), "worst", "refused", "resets", "level_m")
    print(columns.table(results, wanted))


def summary(many: list[dict]) -> dict:
    """RMS over the cases of a group, and the worst."""
    ratios = np.array([one["ratios"] for one in many])
    out = {f"plot{k + 1}": float(np.sqrt(np.mean(ratios[:, k] ** 2))) for k in range(PLOTS)}
    out["worst"] = float(ratios[:, 2:].max())
    for name in ("refused", "level_m", "resets"):
        out[name] = float(np.mean([one[name] for one in many]))
    return out


def one(asked, case) -> tuple[dict, dict]:
    """The estimator and the small filter over one gap."""
    scan, gap_s, distance_m, speed_mps, seed = case
    every_s = SCANS[scan].every_s
    before_s = max(FASTEST_BEFORE_S, BEFORE * every_s)
    end_s = before_s + gap_s + (PLOTS + 2) * every_s
    truth = courses.straight(distance_m, speed_mps, before_s + gap_s, end_s, np.random.default_rng(seed))
    seen = courses.watched(f"gap{gap_s}-{distance_m}-{speed_mps}", truth, SCANS[scan], seed)
    since_s = (seen.rows["t_ns"] - seen.flight.t0_ns) * 1e-9
    kept = (since_s < before_s) | (since_s >= before_s + gap_s)
    seen = seen._replace(
        rows=seen.rows[kept], labels=seen.labels[kept], off_sigma=seen.off_sigma[kept],
        arrival_ns=seen.arrival_ns[kept],
    )  # fmt: skip
    settings = {name: float(x) for name, x in (s.split("=") for s in asked.setting)}
    makers = (
        lambda sensors: run.make_estimator(asked.method, sensors, **settings),
        lambda sensors: peers.make("cv", sensors, PEER_PSD, speed_mps=PEER_SPEED_MPS),
    )
    return tuple(after(seen, run.tried(seen, make), before_s, gap_s) for make in makers)


def after(seen: scene.Scene, ran: run.Run, before_s: float, gap_s: float) -> dict:
    """``ratios`` (PLOTS,), level before m, share of the values refused after."""
    t_ns = np.unique(seen.rows["t_ns"])
    since_s = (t_ns - seen.flight.t0_ns) * 1e-9
    if not len(ran.track):
        return {"ratios": [np.inf] * PLOTS, "level_m": np.inf, "refused": 1.0, "resets": 0}
    error_m = score.errors(seen.flight, ran.track, t_ns, True)[0]
    level_m = score.rms(error_m[(since_s > before_s / 2) & (since_s < before_s)])
    first = int(np.argmax(since_s >= before_s + gap_s))
    late = t_ns[first : first + PLOTS]
    ids = seen.rows["id"][(seen.rows["t_ns"] >= late[0]) & (seen.rows["t_ns"] <= late[-1])]
    about = np.isin(ran.verdicts["id"], ids)
    refused = np.isin(ran.verdicts["verdict"][about], (ISOLATED, PATCH)).mean() if about.any() else 1.0
    return {
        "ratios": error_m[first : first + PLOTS] / level_m, "level_m": level_m, "refused": float(refused),
        "resets": int(ran.track["reset_counter"].max()),
    }  # fmt: skip
