"""Clocks that drift, from what their sources saw: offsets of some hundredths of a second that grow.

Over ``SPAN_S`` what a piece misses a path by is a constant, its zero error, plus the path's motion times an
offset that is a line in time; least squares tells its slope with 1 sigma, whatever the zero errors are. A
crystal keeps to 0.0001. Who drifts is a vote, line by line, in which an aircraft's word counts half: its
own errors are slow.

From when to when: a clock is right, then on a line, then right again; the changes are where that fits best.
"""

from collections.abc import Iterator
from typing import NamedTuple

import numpy as np

from gcs.station.sources.courses import (
    COARSE_NS,
    FITS,
    PATH_M,
    PIECE_NS,
    Path,
    Pieces,
    S,
    Sightings,
    far,
    misses_m,
    size_m,
)

RATE = 0.004  # of a clock that drifts: forty times what a crystal does
SPAN_S, STRIDE_S = 20, 2  # of a line, and from one to the next
FEWEST = 20  # pieces of one line
CLEAR = 6.0  # sigmas that a slope is off zero: neighbours err alike
WANDER_MPS = 0.05  # how fast errors change: a zero error of 1 m, 500 m away at 25 m/s; on top of ``RATE`` …
INS_MPS = 0.08  # … and an aircraft's: 2.5 m in 90 s
SLOW_MPS = 8.0  # 0.1 s is less than a metre then, and noise looks like motion
ZERO_M = 3.0  # 1 sigma of what a zero error may be, where the motion does not show it
EDGE_S = 3 * SPAN_S  # a drift begins and ends so near to the ends of where its lines show it
CHANGE = 15.0  # log odds against a change of slope …
KINK_S = 0.02  # … with so much of 1 sigma at least: what an offset is off by is alike in neighbours
TURNS = 4  # of re-weighting
OUTLIER_S = 0.1  # off its neighbours by more, a piece counts little


class ClockLines(NamedTuple):
    """One source against one path: offsets by piece, and their slope from time to time."""

    t_s: np.ndarray  # (k,) since the flight's first second, on the path
    offset_s: np.ndarray  # (k,) stamp minus time on the path, NaN where it is not known
    weight: np.ndarray  # (k,) 1 / variance
    slope: np.ndarray  # (w,) of the lines over SPAN_S, NaN where there is none
    sigma: np.ndarray  # (w,)
    speed_mps: np.ndarray  # (w,) of the aircraft, as far as the channels show it


def lines(
    path: Path, seen: Sightings, pieces: Pieces, course_ns: np.ndarray, zero_ns: int, begins_s: np.ndarray
) -> ClockLines:
    """Lines from each of ``begins_s`` (w,) on, in s since ``zero_ns``.

    ``course_ns`` (k,): where each piece is nearest to the path; NaN: leave it out.
    """
    wanted, course_ns = np.isfinite(course_ns), np.nan_to_num(course_ns).astype(np.int64)
    own_ns = course_ns[pieces.of_row]
    away_m, before, after = (misses_m(path, seen, pieces, own_ns + by) for by in (0, COARSE_NS, -COARSE_NS))
    motion = (after - before) / (2 * COARSE_NS / S)
    t_s = (pieces.t_ns - course_ns - zero_ns) / S
    sigma_m = np.sqrt(seen.noise_m(path) ** 2 / np.bincount(pieces.of_row)[:, None] + PATH_M**2)
    known = np.isfinite(away_m) & np.isfinite(motion) & np.isfinite(sigma_m)
    known &= (wanted & (size_m(away_m) < FITS * far(path, seen)))[:, None]
    y = np.where(known, away_m + motion * (course_ns / S)[:, None], 0.0) / sigma_m
    motion, one = np.where(known, motion, 0.0) / sigma_m, known / sigma_m
    y, motion, one = (np.nan_to_num(part) for part in (y, motion, one))
    told = np.full((len(begins_s), 6), np.nan)
    for w, begin_s in enumerate(begins_s.tolist()):
        inside = np.flatnonzero((t_s >= begin_s) & (t_s < begin_s + SPAN_S) & known.any(axis=1))
        if len(inside) >= FEWEST:
            told[w] = _line(y[inside], motion[inside], one[inside], t_s[inside])
    told[told[:, 5] < SLOW_MPS] = np.nan
    zeros = np.nan_to_num(np.nanmedian(told[:, :3], axis=0)) if np.isfinite(told).any() else np.zeros(3)
    weight = (motion**2).sum(axis=1)
    with np.errstate(invalid="ignore", divide="ignore"):
        offset_s = (motion * (y - one * zeros)).sum(axis=1) / weight
    return ClockLines(t_s, offset_s, weight, *told[:, 3:].T)


def _line(y: np.ndarray, motion: np.ndarray, one: np.ndarray, t_s: np.ndarray) -> np.ndarray:
    """(6,) zero errors of three channels, slope of the offset, its sigma, speed; from (k, 3) in sigmas."""
    middle = t_s - t_s.mean()
    X = np.zeros((*y.shape, 5))
    for channel in range(3):
        X[:, channel, channel] = one[:, channel]
    X[..., 3], X[..., 4] = motion, motion * middle[:, None]
    prior = np.diag([*np.full(3, 1.0 / ZERO_M**2), 1e-9, 1e-9])
    weight, scale = np.ones(len(y)), 1.0
    for _ in range(TURNS):  # pieces that are far off count less: an outlier's, a run's
        N = np.einsum("kci,kcj,k->ij", X, X, weight) + prior
        x = np.linalg.solve(N, np.einsum("kci,kc,k->i", X, y, weight))
        off = np.sqrt(((y - X @ x) ** 2).mean(axis=1))
        scale = max(float(np.median(off)), 0.3)
        weight = 1.0 / (1.0 + (off / (2.0 * scale)) ** 2) ** 2
    speed = np.median(np.sqrt((motion**2).sum(axis=1) / (one**2).sum(axis=1)))
    return np.array([*x[:3], x[4], scale * np.sqrt(np.linalg.inv(N)[4, 4]), speed])


def drifting(slope: np.ndarray, sigma: np.ndarray, least: np.ndarray, votes: np.ndarray) -> np.ndarray:
    """(s, w) bool: on which of w lines each of s sources drifts.

    ``slope``, its ``sigma`` and the ``least`` that is a drift (s, s, w) are of a source against another's
    path, NaN where there is none; ``votes`` (s,) is what each one's word is worth. A source drifts where it
    is clearly apart from one with which more agree than with itself, two at least.
    """
    with np.errstate(invalid="ignore"):
        apart = (np.abs(slope) > least) & (np.abs(slope) > CLEAR * sigma)
        agree = ~apart & (sigma < RATE)
    agree = (agree | agree.transpose(1, 0, 2)) & ~apart & ~apart.transpose(1, 0, 2)
    backing = votes[:, None] + np.einsum("ijw,j->iw", agree, votes)
    return (apart & (backing > np.maximum(backing[:, None], 1.0))).any(axis=1)


def spans(begins_s: np.ndarray, sharp: ClockLines) -> Iterator[tuple[float, float]]:
    """(begin, end) in s of each drift, from lines that show it (w,); ``sharp``: those that tell best when."""
    for own_s in np.split(begins_s, np.flatnonzero(np.diff(begins_s) > SPAN_S) + 1):
        if len(own_s):
            begin_s, end_s = own_s[0] - SPAN_S, own_s[-1] + 2 * SPAN_S
            inside = np.isfinite(sharp.offset_s) & (sharp.t_s >= begin_s) & (sharp.t_s < end_s)
            first_s, last_s = _changes(sharp.t_s[inside], sharp.offset_s[inside], sharp.weight[inside])
            if first_s == first_s:
                yield max(first_s, float(begin_s)), min(last_s, float(end_s))


def _changes(t_s: np.ndarray, off_s: np.ndarray, weight: np.ndarray) -> tuple[float, float]:
    """Between which times offsets (k,) are a line, constant before and after; to the ends if no change shows.

    What is not known between a constant and the line counts as the line's. NaN if it is no drift.
    """
    order = np.argsort(t_s)
    t_s, off_s, weight = t_s[order], off_s[order], weight[order]
    weight = weight / (1.0 + (np.abs(off_s - _running_median(off_s)) / OUTLIER_S) ** 2) ** 2
    moments = np.cumsum([weight * a for a in (np.ones(len(t_s)), t_s, t_s**2, off_s, t_s * off_s)], axis=1)
    sums = np.concatenate([np.zeros((5, 1)), moments], axis=1)
    places, edge = np.arange(len(t_s) + 1), EDGE_S * S // PIECE_NS
    first, last = places[: edge + 1, None], places[None, -edge - 1 :]
    left = float(weight @ off_s**2) - _explained(sums[:, first])
    left = (
        left
        - _explained(sums[:, last] - sums[:, first], line=True)
        - _explained(sums[:, -1:, None] - sums[:, last])
    )
    left[last - first < FEWEST] = np.inf
    noise = max(
        KINK_S**2 * float(weight.mean()), float(np.median(weight * (off_s - _running_median(off_s)) ** 2))
    )
    left += CHANGE * noise * ((first > 0).astype(int) + (last < len(t_s)))
    at = np.unravel_index(int(np.argmin(left)), left.shape)
    begin, end = int(first[at[0], 0]), int(last[0, at[1]])
    w, a, b, c, d = sums[:, end] - sums[:, begin]
    if abs(w * d - a * c) < RATE * (w * b - a * a):
        return np.nan, np.nan
    return (float(t_s[begin - 1]) if begin else -np.inf), (float(t_s[end]) if end < len(t_s) else np.inf)


def _explained(sums: np.ndarray, *, line: bool = False) -> np.ndarray:
    """(...) how much of the weighted squares a constant, or a line, takes away; ``sums`` (5, ...)."""
    w, a, b, c, d = sums
    w = np.maximum(w, 1e-12)
    constant = c * c / w
    if not line:
        return constant
    return constant + np.square(d - a * c / w) / np.maximum(b - a * a / w, 1e-12)


def _running_median(values: np.ndarray) -> np.ndarray:
    """(k,) of nine neighbours each."""
    wide = np.pad(values, 4, mode="edge")
    return np.median(np.lib.stride_tricks.sliding_window_view(wide, 9), axis=1)
