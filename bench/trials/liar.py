"""One instrument that lies in all its channels, from its first row or from some time on, to the end.

offset      constant: 30 m, 1 deg, 5 m/s         ramp     1 sigma/s for ever
mirror      elevation the other way up           replay   its own values of some seconds ago
misleading  epochs wrong by 5 sigma and 10 m that are not called ambiguous, %; where the track has protection
            levels, epochs beyond them and not ambiguous count instead ('beyond%')
/told       RMS of the newest state over that of the same estimator without the liar: median and worst
"""

import argparse
import itertools

import numpy as np

from bench.trials import common, run, scene, score
from bench.trials.world import ELEVATION, ISOLATED, PATCH, simulate

LIES = ("offset", "ramp", "mirror", "replay")
SINCE_S = (0.0, 15.0)
SETS = {
    "standard": (("ins", "theo-a", "theo-b", "radar-a"), "theo-a"),
    "radar lies": (("ins", "theo-a", "theo-b", "radar-a"), "radar-a"),
    "no ins": (("theo-a", "theo-b", "radar-a"), "theo-b"),
    "ins+theo+radar": (("ins", "theo-a", "radar-a"), "theo-a"),
    "ins+theo": (("ins", "theo-a"), "theo-a"),
    "2 theo": (("theo-a", "theo-b"), "theo-b"),
}
OFFSET = (30.0, np.radians(1.0), np.radians(1.0), 5.0)
REPLAY_S, RAMP = 3.0, 1.0
SECONDS = 40.0
TITLES = (
    "runs",
    "mislead%",
    "worst%",
    "beyond%",
    "amb%",
    "/told",
    "worst",
    "worst_m",
    "lies-%",
    "good-%",
    "rst",
)


def options(parser: argparse.ArgumentParser) -> None:
    common.options(parser, __doc__, "0:3", ("normal",))
    parser.add_argument("--lie", nargs="+", default=list(LIES), choices=list(LIES))
    parser.add_argument("--set", nargs="+", default=list(SETS), choices=list(SETS))


def main(asked: argparse.Namespace) -> None:
    cases = list(itertools.product(asked.set, asked.lie, SINCE_S, asked.flight, asked.seeds))
    got = common.spread_out(one, asked, cases)
    print(f"{asked.method}: one liar; lies-%, good-%: instrument values refused")
    for key in (
        lambda c: f"{c[0]}, {c[1]}, " + ("from the first row" if c[2] == 0 else f"from {c[2]:g} s"),
        lambda c: "ALL",
    ):
        print(common.plain_table(TITLES, lines(common.by_key(cases, got, key))))


def lines(groups: dict[str, list]) -> dict:
    """One line a group."""
    out = {}
    for name, many in groups.items():
        misleading, beyond, doubt, ratio, worst_m, lies, good, resets = np.array(many, float).T
        out[name] = (
            len(many), 100 * misleading.mean(), 100 * misleading.max(), 100 * beyond.mean(),
            100 * doubt.mean(), np.median(ratio), ratio.max(), worst_m.max(), 100 * lies.mean(),
            100 * good.mean(), resets.max(),
        )  # fmt: skip
    return out


def one(asked, case) -> tuple:
    """(misleading, beyond protection, ambiguous: shares; ratio, worst m, lies and good refused, resets)."""
    which, lie, since_s, name, seed = case
    names, liar = SETS[which]
    flight = common.flight(asked, name, seed, SECONDS)
    since_ns = flight.t0_ns + round((flight.truth.t_s[0] + since_s) * 1e9)

    def twist(sensor_name, said, sensor):
        if sensor_name != liar:
            return said
        return common.lies(said, since_ns, lying(said, sensor, lie, since_ns))

    seen = common.watched(flight, names, seed, 0.0, twist)
    make = common.maker(asked)
    ours, told = run.tried(seen, make), run.tried(seen, make, told=True)
    nothing = (np.nan,) * 8
    return judged(seen, ours, told, since_ns) if len(ours.track) and len(told.track) else nothing


def lying(said: simulate.Observation, sensor, lie: str, since_ns: int) -> np.ndarray:
    """(m, c) what the instrument says in place of its values."""
    if lie == "offset":
        return said.values + np.array(OFFSET)
    if lie == "ramp":
        since_s = np.maximum(said.t_ns - since_ns, 0) * 1e-9
        return said.values + RAMP * since_s[:, None] * sensor.sigma[said.channels]
    if lie == "mirror":
        mirrored = said.values.copy()
        mirrored[:, said.channels == ELEVATION] *= -1.0
        return mirrored
    before = np.searchsorted(said.t_ns, said.t_ns - round(REPLAY_S * 1e9))
    return said.values[np.maximum(before, 0)]


def judged(seen: scene.Scene, ours: run.Run, told: run.Run, since_ns: int) -> tuple:
    """As `one`."""
    t_ns = score.grid(seen.flight, ours.track, 2.0)
    t_ns = t_ns[(t_ns >= since_ns) & (t_ns >= told.track["t_ns"][0] + 2_000_000_000)]
    judged_now = score.errors(seen.flight, ours.track, t_ns, True)
    theirs = score.errors(seen.flight, told.track, t_ns, True)[0]
    levels = score.protection(ours.track, *judged_now)
    labelled = seen.labels != simulate.NONE
    ground = np.array([s.kind != "ins" for s in seen.sensors])[seen.rows["sensor"]]
    refused = np.zeros(len(seen.rows), bool)
    refused[ours.verdicts["id"]] = np.isin(ours.verdicts["verdict"], (ISOLATED, PATCH))
    good = refused[ground & ~labelled]
    return (
        float(common.confident(seen, ours, t_ns).mean()),
        levels.get("misleading", np.nan),
        levels.get("ambiguous", np.nan),
        score.rms(judged_now[0]) / score.rms(theirs),
        judged_now[0].max(),
        refused[labelled].mean(),
        good.mean() if len(good) else np.nan,
        ours.track["reset_counter"].max(),
    )
