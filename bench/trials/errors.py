"""Systematic errors injected into one instrument: 5 m, 0.05 deg, 0.05 deg, 120 ms; are they recovered?

Per error: distance of the estimate from the injected value in its own sigmas, median and worst over flights
and seeds; share within 3; the estimate's sigma over the injected value. Then RMS over that of the same flight
without them. Instruments to be estimated: the crooked one, or all.
"""

import argparse
import itertools

import numpy as np

from bench.trials import common, flights, run, scene, score

INJECTED = {"range": 5.0, "azimuth": np.radians(0.05), "elevation": np.radians(0.05), "clock": 0.12}
CROOKED = "theo-a"
SECONDS = 120.0


def options(parser: argparse.ArgumentParser) -> None:
    common.options(parser, __doc__, "0:3", ("normal", "aggressive"))
    parser.add_argument("--share", type=float, default=0.0, help="of the values, outliers")
    parser.add_argument("--sensors", nargs="+", default=list(scene.STANDARD))
    parser.add_argument("--crooked", default=CROOKED)
    parser.add_argument("--estimate", choices=["one", "all"], default="one")


def main(asked: argparse.Namespace) -> None:
    cases = list(itertools.product(asked.flight, asked.seeds))
    got = common.spread_out(one, asked, cases)
    print(f"{asked.method}: {asked.crooked} of {' '.join(asked.sensors)}, estimated: {asked.estimate}")
    titles = ("runs", "median", "worst", "within3%", "sigma/val", "beside", "worst", "rmsS/")
    lines = {}
    for name in INJECTED:
        groups = common.by_key(cases, got, lambda c, name=name: f"{c[0]}, {name}")
        for key, many in groups.items():
            off, sigma = np.array([one_[0].get(name, (np.nan, np.nan)) for one_ in many]).T
            beside, smooth = np.array([one_[1:] for one_ in many]).T
            lines[key] = (
                len(many), np.median(off), off.max(), 100 * (off <= 3).mean(),
                np.median(sigma) / INJECTED[name], np.median(beside), beside.max(), np.median(smooth),
            )  # fmt: skip
    print(common.plain_table(titles, dict(sorted(lines.items()))))


def one(asked, case) -> tuple:
    """(error → (sigmas off, sigma), RMS beside the straight flight's, the same smoothed)."""
    name, seed = case
    flight = common.flight(asked, name, seed, SECONDS)
    zero = (INJECTED["range"], INJECTED["azimuth"], INJECTED["elevation"], 0.0)
    wrong = scene.Wrong(asked.share, zero, INJECTED["clock"], (asked.crooked,))
    straight = wrong._replace(crooked=())
    figures, reports = [], []
    for case_ in (wrong, straight):
        seen = watch(asked, flight, seed, case_)
        ran = run.tried(seen, common.maker(asked))
        figures.append(score.figures(seen, ran))
        reports.append(ran.report)
    said = reports[0]["sensors"].get(asked.crooked, {}).get("errors", {})
    found = {
        error: (abs(said[error]["value"] - true) / said[error]["sigma"], said[error]["sigma"])
        for error, true in INJECTED.items()
        if error in said
    }
    return found, *(figures[0][x] / figures[1][x] for x in ("rms", "rms_smooth"))


def watch(asked, flight: flights.Flight, seed: int, wrong: scene.Wrong) -> scene.Scene:
    """The scene, with the errors of one instrument or of all to be estimated."""
    both = ("bias", "clock")
    seen = scene.watch(flight, asked.sensors, seed, wrong)
    sensors = [
        s._replace(estimate=both)
        if (s.kind != "ins" and asked.estimate == "all") or s.name == asked.crooked
        else s
        for s in seen.sensors
    ]
    return seen._replace(sensors=sensors)
