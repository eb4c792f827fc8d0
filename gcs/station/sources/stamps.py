"""Stamps after the flight: who says what fits the flight only at another time.

A file has no arrivals, so its stamps are held against its values. The path that counts is that of the
source to which all others are nearest at their own times. Against it each other one has a `course`, the
offset of its clock from its first row to its last; an offset that is too small to show, but grows, is found
by its slope: `drifts`.

Who is right is a vote, second by second: more of the others agree than on any other offset, two at least.
So one source with a wrong clock is refused where two others see the aircraft; the aircraft is a source like
them. Seconds without a majority go with their neighbours; without one at any time nobody is refused here. A
hovering aircraft fits at any time, and then a wrong stamp does no harm.
"""

from collections import defaultdict
from collections.abc import Mapping
from itertools import pairwise, permutations
from typing import NamedTuple

import numpy as np

from gcs.contract.messages import Event
from gcs.station.sources import drifts
from gcs.station.sources.courses import FAR_M, Path, Pieces, S, Sightings, course, cut, misses_m, size_m

SAME_NS = S // 2  # two offsets that are one: also the least that is refused, what is less is estimated
SMOOTH = 0.75  # of how far all others are, where a path has no outliers of its own
RIGHT_PIECES = 20  # an operator is told that it is right again after so many
OFF = "its values fit the flight at another time: its clock is wrong"


class Findings(NamedTuple):
    """Whose stamps are wrong."""

    wrong: dict[str, np.ndarray]  # (m,) bool, the rows of each source
    events: list[Event]  # what an operator should know, in order of time


class ClockCourse(NamedTuple):
    """One source against the path that counts."""

    pieces: Pieces
    ahead_ns: np.ndarray  # (k,) int64: stamp minus time on the path
    known: np.ndarray  # (k,) bool: the path is

    def seconds(self) -> np.ndarray:
        """(k,) int64: the second of the flight in which each piece was measured, by its values."""
        return (self.pieces.t_ns - self.ahead_ns) // S


def check(sources: Mapping[str, Sightings]) -> Findings:
    """Hold every source against the others, and vote."""
    sources = {name: seen for name, seen in sources.items() if len(seen.t_ns)}
    pieces = {name: cut(seen.t_ns) for name, seen in sources.items()}
    paths = {name: path for name, seen in sources.items() if len((path := seen.path()).t_ns) > 1}
    if len(sources) < 2 or not paths:
        return Findings({name: np.zeros(len(seen.t_ns), bool) for name, seen in sources.items()}, [])
    middle = _middle(paths, sources, pieces)
    courses = {
        name: _course(paths[middle], seen, pieces[name], itself=name == middle)
        for name, seen in sources.items()
    }
    apart_ns = _vote(courses)
    drifted = _drifts(paths, sources, courses, apart_ns)
    wrong, events = {}, []
    for name, one in courses.items():
        off = (np.abs(apart_ns[name]) > SAME_NS) | drifted[name]
        events += _episodes(name, one, off, apart_ns[name])
        wide = off.copy()
        wide[1:] |= off[:-1]  # a jump falls into a piece of its own: its neighbours go too
        wide[:-1] |= off[1:]
        wrong[name] = wide[one.pieces.of_row]
    return Findings(wrong, sorted(events, key=lambda event: event.t_ns))


def _middle(paths: Mapping[str, Path], sources: Mapping[str, Sightings], pieces: Mapping[str, Pieces]) -> str:
    """The source to whose path all others are nearest at their own times; an aircraft's has no outliers."""
    apart_m = {}
    for name, path in paths.items():
        missed_m = [size_m(misses_m(path, sources[o], pieces[o])) for o in sources if o != name]
        mean_m = sum(float(np.fmin(one, 2 * FAR_M).mean()) for one in missed_m)
        apart_m[name] = mean_m * (1.0 if sources[name].polar else SMOOTH)
    return min(apart_m, key=lambda name: apart_m[name])


def _course(path: Path, seen: Sightings, pieces: Pieces, *, itself: bool) -> ClockCourse:
    """Of the path's own source it is zero."""
    ahead_ns = np.zeros(len(pieces.t_ns), np.int64) if itself else course(path, seen, pieces)
    missed_m = size_m(misses_m(path, seen, pieces, ahead_ns[pieces.of_row]))
    return ClockCourse(pieces, ahead_ns, np.isfinite(missed_m))


def _vote(courses: Mapping[str, ClockCourse]) -> dict[str, np.ndarray]:
    """(k,) float of each: how far its stamps are ahead of where most others agree, ns; 0 where none do."""
    votes: dict[int, dict[str, int]] = defaultdict(dict)
    for name, one in courses.items():
        for second, ahead in zip(
            one.seconds()[one.known].tolist(), one.ahead_ns[one.known].tolist(), strict=True
        ):
            votes[second][name] = ahead
    out = {}
    for name, one in courses.items():
        seconds = one.seconds()
        right = {
            second: _agreed([v for n, v in votes[second].items() if n != name])
            for second in set(seconds.tolist()) & votes.keys()
        }
        true_ns = np.array([right.get(second, np.nan) for second in seconds.tolist()])
        out[name] = one.ahead_ns - _nearest(true_ns)
    return out


def _agreed(said: list[int]) -> float:
    """The offset that more of the others agree on than on any other, and two at least; else NaN."""
    offsets = np.array(said)
    same = np.abs(offsets[:, None] - offsets) <= SAME_NS
    count = same.sum(axis=1)
    if count.max(initial=0) < 2:
        return np.nan
    group = same[np.argmax(count)]
    return float(np.median(offsets[group])) if count.max() > count[~group].max(initial=0) else np.nan


def _nearest(values: np.ndarray) -> np.ndarray:
    """(k,) with every NaN as the nearest of the others; all NaN stay."""
    known = np.flatnonzero(np.isfinite(values))
    if not len(known):
        return values
    at = np.arange(len(values))
    after = (
        np.clip(np.searchsorted(known, at), 1, len(known) - 1) if len(known) > 1 else np.zeros(len(at), int)
    )
    before = np.maximum(after - 1, 0)
    return values[known[np.where(at - known[before] <= known[after] - at, before, after)]]


def _drifts(
    paths: Mapping[str, Path],
    sources: Mapping[str, Sightings],
    courses: Mapping[str, ClockCourse],
    apart_ns: Mapping[str, np.ndarray],
) -> dict[str, np.ndarray]:
    """(k,) bool of each: the pieces in which its clock drifts; those that are far off are refused anyway.

    Not of the aircraft: its own errors are slow, which the estimator knows, and they look the same.
    """
    zero_ns = min(int(path.t_ns[0]) for path in paths.values())
    t_s = {name: (one.pieces.t_ns - one.ahead_ns - zero_ns) / S for name, one in courses.items()}
    begins_s = drifts.STRIDE_S * np.unique(np.concatenate(list(t_s.values())) // drifts.STRIDE_S)
    names, lines = list(courses), {}
    slope, sigma, least = np.full((3, len(names), len(names), len(begins_s)), np.nan)
    for (i, name), (j, other) in permutations(enumerate(names), 2):
        if other in paths:
            one = courses[name]
            near_ns = np.where(np.abs(apart_ns[name]) > SAME_NS, np.nan, one.ahead_ns)
            lines[i, j] = drifts.lines(paths[other], sources[name], one.pieces, near_ns, zero_ns, begins_s)
            wander_mps = drifts.WANDER_MPS if sources[name].polar and sources[other].polar else drifts.INS_MPS
            slope[i, j], sigma[i, j] = lines[i, j].slope, lines[i, j].sigma
            least[i, j] = drifts.RATE + wander_mps / np.maximum(lines[i, j].speed_mps, 1e-3)
    votes = np.array([1.0 if sources[name].polar else 0.5 for name in names])
    found = drifts.drifting(slope, sigma, least, votes)
    out = {}
    for i, (name, one) in enumerate(courses.items()):
        out[name] = np.zeros(len(one.ahead_ns), bool)
        if sources[name].polar and found[i].any():
            told = (sigma[i] + least[i])[:, found[i]]
            usual = np.median(np.nan_to_num(told, nan=np.inf), axis=1)
            for begin_s, end_s in drifts.spans(begins_s[found[i]], lines[i, int(np.argmin(usual))]):
                out[name] |= (t_s[name] > begin_s) & (t_s[name] < end_s)
    return out


def _episodes(name: str, one: ClockCourse, off: np.ndarray, apart_ns: np.ndarray) -> list[Event]:
    """When a source begins to be off, and when it is right again."""
    out: list[Event] = []
    lasting, seconds = off.copy(), one.seconds()
    for end, begin in pairwise(np.flatnonzero(off).tolist()):
        lasting[end:begin] |= begin - end < RIGHT_PIECES
    for k in np.flatnonzero(np.diff(lasting.astype(int), prepend=0)).tolist():
        t_ns = max([int(seconds[k]) * S, *(event.t_ns for event in out[-1:])])
        if lasting[k]:
            apart_s = np.nan_to_num(apart_ns[k]) / S
            far = f"{abs(apart_s):.1f} s {'ahead of' if apart_s > 0.0 else 'behind'}"
            told = (
                f"stamped {far} the flight"
                if abs(apart_s) > SAME_NS / S
                else "stamped by a clock that drifts"
            )
            out.append(
                Event(t_ns=t_ns, level="warning", text=f"{name} is {told}: refused; its values show it")
            )
        else:
            out.append(Event(t_ns=t_ns, level="info", text=f"{name} is stamped right again: taken"))
    return out
