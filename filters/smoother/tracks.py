"""Tracks as they are published: by the time most clocks agree on, and over the whole flight."""

from collections.abc import Iterable, Iterator

import numpy as np

from filters.models import motion
from filters.models.state import Model
from filters.smoother import passes
from filters.smoother.buffer import MeasurementBuffer, Outcome, Rows, epochs
from filters.smoother.hypothesis import Moment, Workspace
from filters.smoother.proposals import TOGETHER_NS, places

HALF_QUALITY_M = 10.0  # position 1-sigma at which quality is 50
DOUBTFUL = 20  # the best quality while two hypotheses are nearly as likely
ROUNDING = 1e-9  # of the largest variance that is known: so much a variance of zero may be below it
KNOWN_M, KNOWN_SHARE = 50.0, 0.05  # position 1-sigma, or its share of the distance, of a state that is known


def polished(track: np.ndarray, shift_s: np.ndarray, variance: float) -> np.ndarray:
    """The ``track`` (k,) TRACK moved by ``shift_s`` (k,), with its quality; in place.

    ``variance``, s², of a shift of all clocks together: no row shows it, and the target has moved meanwhile.
    """
    x = shifted(track["x"], shift_s)
    widened(track["P"], x, variance)
    sigma_m = np.sqrt(np.maximum(np.trace(track["P"][:, :3, :3], axis1=1, axis2=2), 0.0))
    track["quality"] = np.where(np.isfinite(sigma_m), np.round(100.0 / (1.0 + sigma_m / HALF_QUALITY_M)), -1)
    return doubted(track)


def doubted(track: np.ndarray) -> np.ndarray:
    """The ``track`` (k,) TRACK with no better quality than DOUBTFUL where it is ambiguous; in place."""
    track["quality"] = np.where(track["ambiguous"], np.minimum(track["quality"], DOUBTFUL), track["quality"])
    return track


def shifted(x: np.ndarray, shift_s: np.ndarray) -> np.ndarray:
    """States ``x`` (k, ≥9) as they were ``shift_s`` (k,) before, by their own motion; in place."""
    if not shift_s.any():
        return x
    shift = shift_s[:, None]
    x[:, :3] -= shift * x[:, 3:6] - 0.5 * shift**2 * x[:, 6:9]
    x[:, 3:6] -= shift * x[:, 6:9]
    return x


def widened(P: np.ndarray, x: np.ndarray, variance: float) -> np.ndarray:
    """``P`` (k, ≥6, ≥6) of states ``x`` (k, ≥9) whose time has ``variance``, s²; in place."""
    if variance > 0.0:
        P[:, :6, :6] += variance * x[:, 3:9, None] * x[:, None, 3:9]
    return P


def known(model: Model, x: np.ndarray, P: np.ndarray, factor: float = 1.0) -> np.ndarray:
    """(k,) bool, whether each state ``x`` (k, ≥6), ``P`` (k, ≥6, ≥6) is known well enough to be published.

    Position within KNOWN_M or KNOWN_SHARE of the distance to the nearest instrument, and velocity within the
    same for a second; all that times ``factor``. A variance that rounding has made negative says nothing.
    """
    distance = np.zeros(len(x))
    if (~model.is_ins).any():
        gap = x[:, None, :3] - model.offset[~model.is_ins]
        distance = np.linalg.norm(gap, axis=2).min(axis=1)
    limit = factor * np.maximum(KNOWN_M, KNOWN_SHARE * distance)
    variance = np.diagonal(P, axis1=1, axis2=2)[:, :6].copy()
    variance[variance[:, 5] == 0.0, 2] = 0.0  # a height told beforehand is as good as it was told
    return (variance.max(axis=1) < limit**2) & (variance.min(axis=1) > -ROUNDING * limit**2)


def smooth(
    space: Workspace,
    buffer: MeasurementBuffer,
    begins: Iterable[tuple[int, Moment, bool]],
    densities: np.ndarray,
    height_m: float,
) -> Iterator[tuple[np.ndarray, ...]]:
    """Times (k,), states (k, n) and covariances (k, n, n) of a flight's epochs, part by part, the last first.

    ``begins``, the last first: row, `Moment` to go forward from there, whether it knows nothing of the rows
    before; of several for one row the first counts. ``height_m`` that is known beforehand, or NaN.
    Full covariances of a whole flight would not fit into memory: hence the parts.
    """
    model, n, end = space.model, len(space.model.prior), buffer.size
    r, N = np.zeros(n), np.zeros((n, n))
    unused = passes.scores()
    for begin, at, fresh in begins:
        if begin >= end:
            continue
        rows, own = recalled(model, buffer, begin, end, height_m)
        keep = end - begin
        out = passes.trace(keep, n, keep)
        x, P = at.x.copy(), at.P.copy()
        passes.forward(model, rows, own, densities, x, P, at.t_ns, keep, out, space.work)
        passes.backward(model, rows, own, densities, keep, out, r, N, unused, space.work)
        motion.pull_back(r, N, (rows.t[0] - at.t_ns) * 1e-9, model.rate)
        if fresh:
            r[:], N[:] = 0.0, 0.0
        first = epochs(rows.t)
        yield rows.t[first], out.x[first], out.P[first]
        end = begin


def recalled(
    model: Model, buffer: MeasurementBuffer, begin: int, end: int, height_m: float
) -> tuple[Rows, Outcome]:
    """Decided rows ``begin`` to ``end`` with their places, for which rows of shortly before are read, too."""
    back, since_ns = 0, buffer.recall(begin, begin + 1)[0].t[0] - TOGETHER_NS
    while True:
        back = min(begin, 2 * back + 32)
        rows, own = buffer.recall(begin - back, end)
        if back == begin or rows.t[0] < since_ns:
            places(rows, model.offset, model.rotation, model.is_ins, height_m, back)
            return Rows(*(column[back:] for column in rows)), Outcome(*(column[back:] for column in own))
