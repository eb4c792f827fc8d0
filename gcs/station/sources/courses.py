"""The course of a clock, from what its source saw: by how much its stamps are ahead, from first row to last.

A feed is cut, in the order of its file, into pieces of half a second. Each is held against the path of
another source at a range of offsets: around its own time, and, where it fits at none of these, around any
time at which it does. A clock goes on as it was: from piece to piece it keeps its offset, or drifts by a
step at odds of ``STEP``, or jumps at odds of ``JUMP``, which five pieces that fit elsewhere outweigh. The
likeliest course (Viterbi 1967) is that of the whole file at once: a piece that fits nowhere, hovers or lies
beyond the end of the path has the offset of its neighbours.
"""

from typing import NamedTuple

import numpy as np

from gcs.contract.frames import polar_to_enu

S = 1_000_000_000
PIECE_NS = S // 2
SMOOTH_NS = S
PART = 10_000  # rows smoothed together
GAP_NS = 2 * S  # over a longer gap a path is not known
FAR_M = 10.0  # an autopilot's own position error and latency: no lie of a clock
FITS = 0.6  # of what is far: fits where it is nearer than this
FINE_NS, COARSE_NS = S // 20, S // 4  # along the path: 1.5 m at 30 m/s, then 8 m
NEAR_NS = 1 * S  # how far a piece is moved either way around an offset …
REACH_NS = 500 * S  # … and in search of one
WIDTH = 2 * NEAR_NS // FINE_NS + 1
BANDS = 40  # offsets of one clock that are tried: who has more is never right twice
PATH_M = 0.5  # 1 sigma of the reference, at least
OFF = 0.2  # log odds of each piece against a clock that is far off: of one who hovers nothing else tells
MOST = 8.0  # what one piece says at most, log odds
FIRST = 14.0  # log odds against a clock that is wrong at first: likelier than a jump while nothing is known
STEP, JUMP = 4.0, 20.0  # log odds against a change by FINE_NS, and against any other, from piece to piece


class Path(NamedTuple):
    """Where a source says the aircraft was."""

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
    """What one source saw, in the order of its file: an instrument from its place, an aircraft itself."""

    t_ns: np.ndarray  # (m,)
    values: np.ndarray  # (m, 3) range m, azimuth and elevation rad, or station ENU; NaN where there is none
    sigma: np.ndarray  # (3,) the same units, NaN where it has no such channel
    offset: np.ndarray = np.zeros(3)  # station ENU
    rotation: np.ndarray = np.eye(3)  # (3, 3) station ENU → its own
    polar: bool = True

    def path(self) -> Path:
        """The path by its own values, where they make a place; an instrument's is smoothed."""
        reach, azimuth, elevation = self.values.T
        seen = polar_to_enu(reach, azimuth, elevation, self.offset, self.rotation)
        place = seen if self.polar else self.values
        good = np.isfinite(place).all(axis=1)
        order = np.argsort(self.t_ns[good], kind="stable")
        t_ns, place = self.t_ns[good][order], place[good][order]
        return Path(t_ns, _smoothed(t_ns, place) if self.polar and len(t_ns) > 1 else place)

    def away_m(self, rows: np.ndarray, p: np.ndarray) -> np.ndarray:
        """(..., k, 3) what rows (k,) measured less what targets at ``p`` (..., k, 3) would show, m."""
        measured = self.values[rows]
        if not self.polar:
            return measured - p
        local = (p - self.offset) @ self.rotation.T
        distance = np.linalg.norm(local, axis=-1)
        level = np.linalg.norm(local[..., :2], axis=-1)
        turn = measured[:, 1] - np.arctan2(local[..., 0], local[..., 1])
        return np.stack(
            [
                measured[:, 0] - distance,
                level * ((turn + np.pi) % (2 * np.pi) - np.pi),
                distance * (measured[:, 2] - np.arctan2(local[..., 2], level)),
            ],
            axis=-1,
        )

    def noise_m(self, path: Path) -> np.ndarray:
        """(3,) 1 sigma of its channels at the usual distance, NaN where it has no such channel."""
        if not self.polar:
            return self.sigma
        distance = np.linalg.norm(path.p - self.offset, axis=-1)
        return self.sigma * [1.0, *np.full(2, np.median(distance))]


def _smoothed(t_ns: np.ndarray, p: np.ndarray) -> np.ndarray:
    """(n, 3) running medians of ``p`` (n, 3) over a second."""
    half = min(SMOOTH_NS // max(int(np.median(np.diff(t_ns))), 1) // 2, len(t_ns) // 2)
    wide = np.pad(p, ((half, half), (0, 0)), mode="reflect", reflect_type="odd")
    parts = (wide[k : k + PART + 2 * half] for k in range(0, len(p), PART))
    windows = (np.lib.stride_tricks.sliding_window_view(part, 2 * half + 1, axis=0) for part in parts)
    return np.concatenate([np.median(part, axis=-1) for part in windows])


class Pieces(NamedTuple):
    """A feed, cut."""

    of_row: np.ndarray  # (m,) which piece a row belongs to
    begins: np.ndarray  # (k,) first row of each
    t_ns: np.ndarray  # (k,) its stamp

    def medians(self, values: np.ndarray) -> np.ndarray:
        """(k, c) lower median of each piece of ``values`` (m, c), NaN where none is known."""
        out = np.full((len(self.begins), values.shape[1]), np.nan)
        for column, into in zip(values.T, out.T, strict=True):
            order = np.lexsort((column, self.of_row))  # NaN comes last
            known = np.add.reduceat(np.isfinite(column).astype(int), self.begins)
            into[:] = column[order][self.begins + np.maximum(known - 1, 0) // 2]
            into[known == 0] = np.nan
        return out


def cut(t_ns: np.ndarray) -> Pieces:
    """Rows (m,), m > 0, in the order of their file."""
    of_row = np.concatenate([[0], np.cumsum(np.diff(t_ns // PIECE_NS) != 0)])
    begins = np.flatnonzero(np.diff(of_row, prepend=-1))
    return Pieces(of_row, begins, t_ns[begins])


def misses_m(path: Path, seen: Sightings, pieces: Pieces, ahead_ns: int | np.ndarray = 0) -> np.ndarray:
    """(k, 3) how far each piece is from the path, by channel; NaN: not known.

    With stamps so much ahead, all by the same or each of (m,) by its own.
    """
    rows = np.arange(len(seen.t_ns))
    return pieces.medians(seen.away_m(rows, path.at(seen.t_ns - ahead_ns)))


def size_m(away_m: np.ndarray) -> np.ndarray:
    """(...) distance from channels (..., 3), NaN where none is known."""
    squares = np.where(np.isfinite(away_m).any(axis=-1), np.nansum(away_m**2, axis=-1), np.nan)
    return np.sqrt(squares)


def course(path: Path, seen: Sightings, pieces: Pieces) -> np.ndarray:
    """(k,) int64, ns: stamp minus time on the path, of each piece."""
    offsets, squares, nearest_m = _around(path, seen, pieces, 0)
    far_m = far(path, seen)
    for k in range(len(pieces.begins)):
        if nearest_m[k] <= far_m or len(offsets) > BANDS * WIDTH:
            continue
        own = np.arange(pieces.begins[k], np.append(pieces.begins, len(seen.t_ns))[k + 1])
        found = _elsewhere(path, seen, own[np.isfinite(seen.values[own]).any(axis=1)], FITS * far_m)
        if found is not None:
            there = _around(path, seen, pieces, found)
            fresh = ~np.isin(there[0], offsets)
            offsets, squares = np.append(offsets, there[0][fresh]), np.hstack([squares, there[1][:, fresh]])
            nearest_m = np.fmin(nearest_m, there[2])
    order = np.argsort(offsets)
    return offsets[order][_likeliest(squares[:, order], offsets[order])]


def far(path: Path, seen: Sightings) -> float:
    """How far from the path, m, no honest piece is."""
    return FAR_M + 3.0 * float(np.sqrt(np.nansum(seen.noise_m(path) ** 2)))


def _around(path: Path, seen: Sightings, pieces: Pieces, ahead_ns: int) -> tuple[np.ndarray, ...]:
    """Offsets (b,) around one, how badly each piece fits at them (k, b), and how near it comes, m (k,)."""
    offsets = ahead_ns + np.arange(-NEAR_NS, NEAR_NS + 1, FINE_NS)
    variance = seen.noise_m(path) ** 2 / np.bincount(pieces.of_row)[:, None] + PATH_M**2
    away_m = np.stack([misses_m(path, seen, pieces, ahead) for ahead in offsets.tolist()], axis=1)
    known = np.isfinite(away_m).sum(axis=2)
    squares = np.nansum(away_m**2 / variance[:, None], axis=2) / np.maximum(known, 1)
    nearest_m = np.where(known > 0, np.sqrt(np.nansum(away_m**2, axis=2)), np.inf).min(axis=1)
    return offsets, np.where(known > 0, squares, np.nan), nearest_m


def _elsewhere(path: Path, seen: Sightings, rows: np.ndarray, near_m: float) -> int | None:
    """At which offset, however large, the rows of a piece fit best; None: nowhere within ``near_m``."""
    ahead_ns = np.arange(-REACH_NS, REACH_NS + 1, COARSE_NS)
    times = seen.t_ns[rows] - ahead_ns[:, None]
    ahead_ns = ahead_ns[((times >= path.t_ns[0]) & (times <= path.t_ns[-1])).all(axis=1)]
    if not len(ahead_ns) or not len(rows):
        return None
    away_m = seen.away_m(rows, path.at(seen.t_ns[rows] - ahead_ns[:, None]))
    missed_m = np.median(np.nan_to_num(size_m(away_m), nan=np.inf), axis=1)
    best = int(np.argmin(missed_m))
    return int(ahead_ns[best]) if missed_m[best] < near_m else None


def _costs(squares: np.ndarray, offsets: np.ndarray) -> np.ndarray:
    """(k, b) negative log likelihoods of squared misses (k, b), in units of what is usual; a Cauchy's tails.

    An offset at which nothing is known of a piece is as likely as one beside its best at random: no reason to
    leave it for one who stands still, who fits at all of them.
    """
    known = np.isfinite(squares)
    best = np.argmin(np.where(known, squares, np.inf), axis=1)
    least = squares[np.arange(len(squares)), best]
    usual = max(float(np.median(least[np.isfinite(least)])) if known.any() else 1.0, 1.0)
    costs = np.minimum(np.log1p(0.5 * np.where(known, squares, 0.0) / usual), MOST)
    beside = known & (np.abs(offsets - offsets[best][:, None]) <= NEAR_NS)
    mean = costs.sum(axis=1, where=beside) / np.maximum(beside.sum(axis=1), 1)
    return np.where(known, costs, mean[:, None]) + np.where(np.abs(offsets) > NEAR_NS // 2, OFF, 0.0)


def _likeliest(squares: np.ndarray, offsets: np.ndarray) -> np.ndarray:
    """(k,) index into ``offsets`` (b,), ascending: the likeliest course through squared misses (k, b)."""
    costs, known = _costs(squares, offsets), np.isfinite(squares)
    steps = np.where(np.diff(offsets) == FINE_NS, STEP, JUMP)
    total = np.minimum(STEP * np.abs(offsets) / FINE_NS, FIRST) + costs[0]
    came = np.zeros(costs.shape, np.int32)
    own = np.arange(len(offsets))
    for k in range(1, len(costs)):
        best, total_before = int(np.argmin(total)), total
        came[k], total = own, total_before.copy()
        for way, there in ((1, slice(1, None)), (-1, slice(None, -1))):
            other = total_before[:-1] + steps if way == 1 else total_before[1:] + steps
            better = other < total[there]
            total[there] = np.where(better, other, total[there])
            came[k][there] = np.where(better, own[there] - way, came[k][there])
        jumped = known[k] & (total_before[best] + JUMP < total)  # only to where it fits
        came[k][jumped] = best
        total = np.where(jumped, total_before[best] + JUMP, total) + costs[k]
    out = np.empty(len(costs), np.int64)
    out[-1] = int(np.argmin(total))
    for k in range(len(costs) - 1, 0, -1):
        out[k - 1] = came[k, out[k]]
    return out
