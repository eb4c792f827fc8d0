"""Trackers sliding off: ramps from 0.05 to 20 sigma/s, ten seconds long, then back in a jump.

during   RMS error of the newest state while it lasts over that of the same estimator without the lying rows:
         median and worst over flights and seeds      worst_m  largest error while it lasts or a second after
smooth   the same ratio for the best estimate         back%    back within 1 s of the end: as near to the
         truth as the told one is on the whole, for a second, give or take its own distance from the truth
"""

import argparse
import itertools

import numpy as np

from bench.trials import common, run, scene, score
from bench.trials.flights import Flight
from bench.trials.world import simulate

RATES = (0.05, 0.2, 1.0, 5.0, 20.0)  # sigma/s
KINDS = ("one channel", "all channels", "two instruments", "in a turn")
SECONDS, BEGIN_S, LONG_S, AFTER_S = 45.0, 20.0, 10.0, 1.0
TITLES = ("runs", "during", "worst", "worst_m", "smooth", "worst", "back%", "refused%")


def options(parser: argparse.ArgumentParser) -> None:
    common.options(parser, __doc__, "0:3", ("normal", "aggressive"))
    parser.add_argument("--kind", nargs="+", default=list(KINDS), choices=list(KINDS))
    parser.add_argument("--rate", nargs="+", type=float, default=list(RATES))
    parser.add_argument("--sensors", nargs="+", default=list(scene.STANDARD))


def main(asked: argparse.Namespace) -> None:
    cases = list(itertools.product(asked.kind, asked.rate, asked.flight, asked.seeds))
    got = common.spread_out(one, asked, cases)
    print(f"{asked.method}: ramps of {LONG_S:g} s, {' '.join(asked.sensors)}")
    for key in (lambda c: f"{c[0]}, {c[1]:g} s/s", lambda c: "ALL"):
        print(common.plain_table(TITLES, lines(common.by_key(cases, got, key))))


def lines(groups: dict[str, list]) -> dict:
    """One line a group."""
    out = {}
    for name, many in groups.items():
        during, worst_m, smooth, back, refused = np.array(many, float).T
        out[name] = (
            len(many), np.median(during), during.max(), worst_m.max(), np.median(smooth), smooth.max(),
            100 * back.mean(), 100 * np.nanmean(refused),
        )  # fmt: skip
    return out


def begin_of(flight: Flight, kind: str) -> float:
    """When the ramp begins, s: in a turn where it pulls hardest."""
    truth = flight.truth
    if kind != "in a turn":
        return truth.t_s[0] + BEGIN_S
    there = (truth.t_s >= truth.t_s[0] + 10.0) & (truth.t_s < truth.t_s[-1] - LONG_S - 5.0)
    return float(truth.t_s[there][np.argmax(np.linalg.norm(truth.a[there], axis=1))])


def one(asked, case) -> tuple:
    """(ratio, worst m, ratio of the smoothed, back in time, share of the ramp's values refused)."""
    kind, rate, name, seed = case
    flight = common.flight(asked, name, seed, SECONDS)
    begin_s, rng = begin_of(flight, kind), scene.stream(seed, "ramp")
    ground = [sensor for sensor in asked.sensors if sensor != "ins"]
    hit = rng.permutation(ground)[: 2 if kind == "two instruments" else 1]

    def slide(sensor_name, said, sensor):
        if sensor_name not in hit:
            return said
        sigma = sensor.sigma[said.channels]
        there = np.flatnonzero(np.isfinite(sigma))
        columns = tuple(there if kind != "one channel" else rng.choice(there, 1))
        ramp = simulate.LongPatch("ramp", begin_s, LONG_S, columns, rate * LONG_S)
        return simulate.patch(said, sigma, ramp, rng, flight.t0_ns)

    seen = common.watched(flight, asked.sensors, seed, 0.0, slide)
    make = common.maker(asked)
    return compare(seen, run.tried(seen, make), run.tried(seen, make, told=True), begin_s)


def compare(seen: scene.Scene, ours: run.Run, told: run.Run, begin_s: float) -> tuple:
    """As `one`."""
    t_ns = score.grid(seen.flight, told.track)
    since_s = (t_ns - seen.flight.t0_ns) * 1e-9 - begin_s
    during = (since_s >= 0) & (since_s < LONG_S)
    near, theirs = (score.errors(seen.flight, x.track, t_ns, True)[0] for x in (ours, told))
    best, their_best = (score.errors(seen.flight, x.smoothed, t_ns, False)[0] for x in (ours, told))
    after = (since_s >= LONG_S + AFTER_S) & (since_s < LONG_S + 2 * AFTER_S)
    back = near[after].max() <= np.maximum(theirs[after], 3.0 * score.rms(theirs)).max()
    lying = np.isin(ours.verdicts["id"], seen.rows["id"][seen.labels != simulate.NONE])
    verdict = ours.verdicts["verdict"][lying]
    refused = np.isin(verdict, (2, 3)).mean() if len(verdict) else np.nan
    return (
        score.rms(near[during]) / score.rms(theirs[during]),
        near[(since_s >= 0) & (since_s < LONG_S + AFTER_S)].max(),
        score.rms(best[during]) / score.rms(their_best[during]),
        bool(back),
        float(refused),
    )
