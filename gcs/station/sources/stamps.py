"""Stamps after the flight: who says what fits the flight only at another time.

A file has no arrivals, so its stamps are held against its values. Each feed is cut, in the order of its file,
into pieces of half a second. A piece that misses the aircraft's own path by more than ``FAR_M`` and its noise
is moved along the path; where five in a row fit at the same other time, the feed's clock is off by that.
An offset lasts until a piece fits better without it. A piece that fits nowhere is no matter of clocks:
the estimator judges it.

Who is right is a vote, second by second: the aircraft and each feed that fits its path say zero, the others
say their offset, and more votes than any other offset has win. So one feed with a wrong clock is refused
where another one sees the aircraft, and the aircraft where several feeds agree against it. Without a majority
nobody is refused here. A hovering aircraft fits at any time, and then a wrong stamp does no harm.
"""

from collections import defaultdict
from collections.abc import Mapping
from itertools import pairwise
from typing import NamedTuple

import numpy as np

from gcs.contract.messages import Event

S = 1_000_000_000
PIECE_NS = S // 2
FAR_M = 10.0  # an autopilot's own position error and latency: no lie of a clock
FITS = 0.6  # of what is far: fits where it is nearer than this
STEP_NS, FINE_NS = S // 4, S // 20  # along the path: 8 m at 30 m/s, then 1.5 m
REACH_NS = 500 * S  # how far it is moved either way
SAME_NS = S // 2  # two offsets that are one: also the least that is refused, what is less is estimated
RUN = 5  # pieces
GAP_NS = 2 * S  # over a longer gap the path is not known
DRIFT, DRIFT_PIECES = 0.003, 40  # a clock's rate, and how long it must show, 20 s; INS errors pretend less
RIGHT_PIECES = 20  # an operator is told that it is right again after so many
DRIFTED_NS = S // 10  # 1 sigma of the usual prior of a clock offset
OFF = "its values fit the flight at another time: its clock is wrong"


class OwnPath(NamedTuple):
    """Where the aircraft says it was."""

    t_ns: np.ndarray  # (n,) ascending
    p: np.ndarray  # (n, 3) station ENU, m

    def at(self, t_ns: np.ndarray) -> np.ndarray:
        """(..., 3) at any times (...); NaN where nothing is known within a gap."""
        after = np.clip(np.searchsorted(self.t_ns, t_ns), 1, len(self.t_ns) - 1)
        begin, end = self.t_ns[after - 1], self.t_ns[after]
        part = (t_ns - begin) / np.maximum(end - begin, 1)
        known = (t_ns >= self.t_ns[0]) & (t_ns <= self.t_ns[-1]) & (end - begin <= GAP_NS)
        p = self.p[after - 1] + part[..., None] * (self.p[after] - self.p[after - 1])
        return np.where(known[..., None], p, np.nan)


class Sightings(NamedTuple):
    """What one instrument saw, in the order of its file."""

    t_ns: np.ndarray  # (m,)
    values: np.ndarray  # (m, 3) range m, azimuth and elevation rad; NaN where there is none
    sigma: np.ndarray  # (3,) the same units, NaN where it has no such channel
    offset: np.ndarray  # (3,) station ENU
    rotation: np.ndarray  # (3, 3) station ENU → its own

    def misses_m(self, rows: np.ndarray, p: np.ndarray) -> np.ndarray:
        """(..., k) distance of rows (k,) from targets at ``p`` (..., k, 3), in the channels they have."""
        local = (p - self.offset) @ self.rotation.T
        distance = np.linalg.norm(local, axis=-1)
        level = np.linalg.norm(local[..., :2], axis=-1)
        measured = self.values[rows]
        turn = measured[:, 1] - np.arctan2(local[..., 0], local[..., 1])
        away = [
            measured[:, 0] - distance,
            level * ((turn + np.pi) % (2 * np.pi) - np.pi),
            distance * (measured[:, 2] - np.arctan2(local[..., 2], level)),
        ]
        apart = np.stack(away, axis=-1)
        return np.where(np.isfinite(apart).any(axis=-1), np.sqrt(np.nansum(apart**2, axis=-1)), np.nan)


class Fits(NamedTuple):
    """How the pieces of one feed fit the path."""

    piece: np.ndarray  # (m,) which piece a row belongs to
    t_ns: np.ndarray  # (k,) stamp of the first row of each piece
    ahead_ns: np.ndarray  # (k,) float: stamp minus time on the path; NaN: fits nowhere, or is not known

    def second(self) -> np.ndarray:
        """(k,) int64: the second of the flight in which each piece was measured, by its values."""
        return (self.t_ns - np.nan_to_num(self.ahead_ns).astype(np.int64)) // S


class Findings(NamedTuple):
    """Whose stamps are wrong."""

    feeds: dict[str, np.ndarray]  # (m,) bool, the rows of each
    ins: np.ndarray  # (s,) int64, the seconds in which those of the aircraft are
    events: list[Event]  # what an operator should know, in order of time


def check(path: OwnPath, feeds: Mapping[str, Sightings]) -> Findings:
    """Hold every feed against the aircraft's path, and vote."""
    if len(path.t_ns) < 2:
        return Findings({}, np.empty(0, np.int64), [])
    fits = {name: _fit(path, seen) for name, seen in feeds.items() if len(seen.t_ns)}
    right = _vote(fits)
    wrong: dict[str, np.ndarray] = {}
    events: list[Event] = []
    for name, one in fits.items():
        true_ns = np.array([right.get(second, np.nan) for second in one.second().tolist()])
        apart_ns = one.ahead_ns - true_ns
        off = _begun_before(one.t_ns, apart_ns, np.abs(apart_ns) > SAME_NS)  # not where one is NaN
        events += _episodes(name, one, off, apart_ns)
        wide = off.copy()
        wide[1:] |= off[:-1]  # a jump falls into a piece of its own: its neighbours go too
        wide[:-1] |= off[1:]
        wrong[name] = wide[one.piece]
    moved = np.array([second for second, ahead in right.items() if abs(ahead) > SAME_NS], np.int64)
    if len(moved):
        text = "ins is stamped wrong: the instruments agree on another time; refused where they do"
        events.append(Event(t_ns=int(moved.min()) * S, level="warning", text=text))
    return Findings(wrong, moved, sorted(events, key=lambda event: event.t_ns))


def _fit(path: OwnPath, seen: Sightings) -> Fits:
    """Every piece of a feed at its own time, and those that are far off at the time where they fit."""
    t_ns, rows = seen.t_ns, np.arange(len(seen.t_ns))
    piece = np.concatenate([[0], np.cumsum(np.diff(t_ns // PIECE_NS) != 0)])
    begins = np.flatnonzero(np.diff(piece, prepend=-1))
    there = path.at(t_ns)
    distance = np.nanmedian(np.linalg.norm(there - seen.offset, axis=-1)) if np.isfinite(there).any() else 0.0
    noise_m = np.sqrt(np.nansum((seen.sigma * [1.0, distance, distance]) ** 2))
    far_m = FAR_M + 3.0 * noise_m
    missed = _medians(seen.misses_m(rows, there), begins)
    ahead = np.where(missed <= far_m, 0.0, np.nan)
    last_ns = 0.0
    for k, begin in enumerate(begins.tolist()):
        if last_ns == 0.0 and not missed[k] > far_m:
            continue
        own = rows[begin : begins[k + 1] if k + 1 < len(begins) else None]
        near = last_ns + np.arange(-STEP_NS, STEP_NS + 1, FINE_NS)
        found, away_m = _moved(path, seen, own, near) if last_ns else (np.nan, np.inf)
        if away_m > min(FITS * far_m, missed[k] + noise_m if np.isfinite(missed[k]) else np.inf):
            found = np.nan  # it does not go on as it was
        if np.isnan(found) and missed[k] > far_m:
            found, away_m = _moved(path, seen, own, np.arange(-REACH_NS, REACH_NS + 1, STEP_NS))
            found = found if away_m < FITS * far_m else np.nan
        last_ns = 0.0 if np.isnan(found) else found
        if last_ns or missed[k] > far_m:
            ahead[k] = found
    return Fits(piece, t_ns[begins], _in_runs(ahead, np.isfinite(missed)))


def _moved(path: OwnPath, seen: Sightings, rows: np.ndarray, ahead_ns: np.ndarray) -> tuple[float, float]:
    """(offset, its miss in m): which of the offsets (a,) lets the rows fit best; NaN, inf where none can."""
    stamps = seen.t_ns[rows][None, :] - ahead_ns[:, None].astype(np.int64)
    known = ((stamps >= path.t_ns[0]) & (stamps <= path.t_ns[-1])).all(axis=1)
    if not known.any():
        return np.nan, np.inf
    misses = seen.misses_m(rows, path.at(stamps[known]))
    away = np.median(np.where(np.isnan(misses), np.inf, misses), axis=1)
    best = int(np.argmin(away))
    return float(ahead_ns[known][best]), float(away[best])


def _medians(values: np.ndarray, begins: np.ndarray) -> np.ndarray:
    """(k,) median of each part of (m,), NaN where none is known."""
    parts = (part[np.isfinite(part)] for part in np.split(values, begins[1:]))
    return np.array([np.median(part) if len(part) else np.nan for part in parts])


def _in_runs(ahead: np.ndarray, known: np.ndarray) -> np.ndarray:
    """Offsets (k,) that ``RUN`` neighbours share where the path is ``known``; NaN for those of fewer."""
    with np.errstate(invalid="ignore"):
        linked = np.abs(np.diff(ahead)) <= SAME_NS
    number = np.concatenate([[0], np.cumsum(~linked)])
    alone = np.bincount(number, known)[number] < RUN
    return np.where(alone & (ahead != 0.0), np.nan, ahead)


def _vote(fits: Mapping[str, Fits]) -> dict[int, float]:
    """By second of the flight: by how much the aircraft's own stamps are behind, where most agree."""
    votes: dict[int, dict[str, float]] = defaultdict(dict)
    for name, one in fits.items():
        for second, ahead in zip(one.second().tolist(), one.ahead_ns.tolist(), strict=True):
            if ahead == ahead:
                votes[second][name] = ahead
    right = {}
    for second, said in votes.items():
        offsets = np.array([0.0, *said.values()])  # the aircraft agrees with itself
        count = (np.abs(offsets[:, None] - offsets) <= SAME_NS).sum(axis=1)
        winner = offsets[np.argmax(count)]
        others = np.abs(offsets - winner) > SAME_NS
        if count.max() > count[others].max(initial=0):
            right[second] = float(winner)
    return right


def _begun_before(t_ns: np.ndarray, apart_ns: np.ndarray, off: np.ndarray) -> np.ndarray:
    """(k,) ``off``, and the pieces in which a clock that drifts was on its way there or back.

    An offset shows from about ``SAME_NS`` on. One that then goes on growing along a line was there before:
    from where the line is at ``DRIFTED_NS``.
    """
    out = off.copy()
    kept = np.flatnonzero(off)
    breaks = np.flatnonzero((np.diff(kept) > RUN) | (np.abs(np.diff(apart_ns[kept])) > SAME_NS)) + 1
    for own in np.split(kept, breaks):
        if len(own) < DRIFT_PIECES:
            continue
        since_ns = (t_ns - t_ns[own[0]]).astype(float)
        slope, start_ns = np.polyfit(since_ns[own], apart_ns[own], 1)
        line_ns = start_ns + slope * since_ns
        for edge, before in ((own[0], slice(own[0])), (own[-1], slice(own[-1] + 1, None))):
            if abs(slope) > DRIFT and abs(line_ns[edge]) < 2 * SAME_NS:
                out[before] |= (line_ns[before] * line_ns[edge] > 0) & (np.abs(line_ns[before]) > DRIFTED_NS)
    return out


def _episodes(name: str, one: Fits, off: np.ndarray, apart_ns: np.ndarray) -> list[Event]:
    """When a feed begins to be off, and when it is right again."""
    out: list[Event] = []
    lasting = off.copy()
    for end, begin in pairwise(np.flatnonzero(off).tolist()):
        lasting[end:begin] |= begin - end < RIGHT_PIECES
    for k in np.flatnonzero(np.diff(lasting.astype(int), prepend=0)).tolist():
        t_ns = max([int(one.second()[k]) * S, *(event.t_ns for event in out[-1:])])
        if lasting[k]:
            apart_s = np.nan_to_num(apart_ns[k]) / S
            far = f"{abs(apart_s):.1f} s {'ahead of' if apart_s > 0.0 else 'behind'}" if apart_s else "off"
            text = f"{name} is stamped {far} the flight: refused; its values show it"
            out.append(Event(t_ns=t_ns, level="warning", text=text))
        else:
            out.append(Event(t_ns=t_ns, level="info", text=f"{name} is stamped right again: taken"))
    return out
