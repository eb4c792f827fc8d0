"""Many starts: on the ground, in flight, in a turn; by every subset of instruments; with outliers.

right%     starts whose error stays within the subset's limit from 3 s after the first sufficient data on
           (in 9 of 10 epochs, to 12 s)          begun%  that have a state by then
t_right    median time from sufficient data until it is right for good, s
conf%      starts with a state wrong by 5 sigma and by 10 m that does not call itself ambiguous, at any time
conf_ep%   such epochs, from 3 s on              amb%    epochs called ambiguous, from 3 s on
"""

import argparse
import itertools

import numpy as np

from bench.trials import common, flights, run, scene, score
from bench.trials.world import AZIMUTH, ELEVATION, RANGE, E, N, U

PLACES = ("ground", "flight", "turn")
SHARES = (0.0, 0.04, 0.15, 0.3)
SUBSETS = {  # instruments, largest error in m that is right, axes that count
    "ins": (("ins",), 10.0, 3),
    "theo": (("theo-a",), 6.0, 3),
    "2 passive": (("passive-a", "passive-b"), 3.0, 3),
    "radar": (("radar-a",), 12.0, 3),
    "ins+passive": (("ins", "passive-a"), 10.0, 3),
    "radar 2d": (("radar2d-a",), 15.0, 2),
    "all": (scene.STANDARD, 3.0, 3),
}
HEIGHT_SIGMA_M = 60.0  # what is known of the height beforehand, where nobody sees it
SECONDS, WITHIN_S, BEFORE_S = 12.0, 3.0, 1.0


def options(parser: argparse.ArgumentParser) -> None:
    common.options(parser, __doc__, "0:6", ("normal", "aggressive"))
    parser.add_argument("--place", nargs="+", default=list(PLACES), choices=list(PLACES))
    parser.add_argument("--subset", nargs="+", default=list(SUBSETS), choices=list(SUBSETS))
    parser.add_argument("--share", nargs="+", type=float, default=list(SHARES))


def main(asked: argparse.Namespace) -> None:
    cases = list(itertools.product(asked.subset, asked.share, asked.place, asked.flight, asked.seeds))
    cases = [c for c in cases if c[2] != "ground" or c[3] == asked.flight[0] or c[3] in flights.RECORDED]
    got = common.spread_out(one, asked, cases)
    print(f"{asked.method}: starts, {len(cases)} of them")
    for key in (lambda c: f"{c[0]}, {100 * c[1]:g} %", lambda c: f"{c[2]}", lambda c: "ALL"):
        print(common.plain_table(TITLES, lines(common.by_key(cases, got, key))), "\n")


TITLES = ("starts", "right%", "begun%", "t_right", "conf%", "conf_ep%", "amb%")


def lines(groups: dict[str, list]) -> dict:
    """One line a group."""
    out = {}
    for name, many in groups.items():
        right, begun, when, ever, epochs, doubt = np.array(many, float).T
        when = np.median(when[np.isfinite(when)]) if np.isfinite(when).any() else np.nan
        out[name] = (
            len(many), 100 * right.mean(), 100 * begun.mean(), when, 100 * ever.mean(),
            100 * np.nanmean(epochs) if np.isfinite(epochs).any() else np.nan,
            100 * np.nanmean(doubt) if np.isfinite(doubt).any() else np.nan,
        )  # fmt: skip
    return out


def moment(asked, place: str, name: str, seed: int) -> flights.Flight:
    """Some seconds of a flight, the start where it is asked for."""
    if place == "ground" and name in flights.LEVELS:
        return common.parked(seed, SECONDS)
    if name in flights.LEVELS:
        whole = flights.simulated(name, seed, 80.0)
    else:
        whole = flights.load(name, flights.folder(asked.data), seed, None)
    truth, rng = whole.truth, scene.stream(seed, f"start-{name}-{place}")
    low_s, high_s = flights.aloft_s(truth) + 1.0, common.landed_s(truth) - SECONDS
    if name in flights.LEVELS:
        low_s, high_s = 2.0, truth.t_s[-1] - SECONDS
    begin_s = rng.uniform(low_s, high_s)
    if place == "ground":
        begin_s = rng.uniform(0.0, max(0.1, low_s - 4.0))
    elif place == "turn":
        near = np.flatnonzero((truth.t_s >= low_s) & (truth.t_s < high_s))
        hard = near[
            np.linalg.norm(truth.a[near], axis=1) >= np.percentile(np.linalg.norm(truth.a[near], axis=1), 90)
        ]
        begin_s = truth.t_s[rng.choice(hard)] - BEFORE_S / 2
    return flights.cut(whole, max(begin_s, 0.0), SECONDS)


def one(asked, case) -> tuple:
    """(right, begun in time, time to right s, ever confidently wrong, share of epochs so, ambiguous)."""
    subset, share, place, name, seed = case
    names, limit_m, axes = SUBSETS[subset]
    seen = common.watched(moment(asked, place, name, seed), names, seed, share)
    if names == ("ins",):
        seen = scene.soiled(seen, share, scene.stream(seed, "soiled"))
    told = {}
    if axes == 2:
        height_m = float(seen.flight.truth.p[:, 2].mean()) + scene.stream(seed, "height").normal(
            0.0, HEIGHT_SIGMA_M
        )
        told = run.known_height(height_m, HEIGHT_SIGMA_M)
        if told is None:
            seen, told = guessed_elevation(seen, height_m), {}
    ran = run.tried(seen, common.maker(asked, **told))
    enough_ns = sufficient(seen)
    begun = len(ran.track) > 0 and ran.track["t_ns"][0] <= enough_ns + WITHIN_S * 1e9
    if not len(ran.track):
        return False, False, np.nan, False, np.nan, np.nan
    t_ns = np.arange(max(int(ran.track["t_ns"][0]), enough_ns), seen.rows["t_ns"][-1], 50_000_000)
    settled = t_ns >= enough_ns + WITHIN_S * 1e9
    error_m, _, _, k = score.errors(seen.flight, ran.track, t_ns, True, axes)
    wrong = common.confident(seen, ran, t_ns, axes)
    right = begun and settled.any() and float(np.mean(error_m[settled] <= limit_m)) >= 0.9
    bad = np.flatnonzero(error_m > limit_m)
    last_ns = t_ns[bad[-1]] if len(bad) else t_ns[0]
    doubt = np.nan
    if "ambiguous" in ran.track.dtype.names and settled.any():
        doubt = float((ran.track["ambiguous"][k][settled] > 0).mean())
    share_wrong = float(wrong[settled].mean()) if settled.any() else np.nan
    return (
        right,
        begun,
        (last_ns - enough_ns) * 1e-9 if right else np.nan,
        bool(wrong.any()),
        share_wrong,
        doubt,
    )


def sufficient(seen: scene.Scene) -> int:
    """UTC ns of the first instant at which the rows so far allow a place, were none of them an outlier."""
    first = {}
    for row in seen.rows[:2000]:
        first.setdefault((int(row["sensor"]), int(row["channel"])), int(row["t_ns"]))
    late = np.iinfo(np.int64).max
    ready, lines_of_sight = [], []
    for s, sensor in enumerate(seen.sensors):
        has = {c: first.get((s, c), late) for c in (RANGE, AZIMUTH, ELEVATION, E, N, U)}
        if sensor.kind == "ins":
            ready.append(max(has[c] for c in (E, N, U)))
            continue
        if np.isfinite(sensor.sigma[RANGE]):
            ready.append(max(has[RANGE], has[AZIMUTH]))
        else:
            lines_of_sight.append(max(has[AZIMUTH], has[ELEVATION]))
    if len(lines_of_sight) >= 2:
        ready.append(sorted(lines_of_sight)[1])
    return min(ready)


def guessed_elevation(seen: scene.Scene, height_m: float) -> scene.Scene:
    """For an estimator that cannot be told a height: an elevation with each plot, as wide as that is."""
    sensor, rows = seen.sensors[0], seen.rows
    plots = rows[rows["channel"] == RANGE]
    extra = plots.copy()
    up_m = height_m - sensor.offset_m[2]
    extra["channel"], extra["value"] = ELEVATION, np.arcsin(np.clip(up_m / np.abs(plots["value"]), -1.0, 1.0))
    sigma = sensor.sigma.copy()
    sigma[ELEVATION] = HEIGHT_SIGMA_M / np.median(plots["value"])
    joined = np.concatenate([rows, extra])
    order = np.argsort(joined["t_ns"], kind="stable")
    joined = joined[order]
    joined["id"], n = np.arange(len(joined)), len(joined)
    return scene.Scene(
        seen.flight, [sensor._replace(sigma=sigma)], joined, np.zeros(n, np.int8), np.zeros(n), joined["t_ns"]
    )
