"""Tracks as they are published: by the time most clocks agree on, and over the whole flight."""

import math
from collections.abc import Iterable, Iterator

import numpy as np

from filters.models import motion
from filters.models.kernel import exact, kernel
from filters.models.state import Model
from filters.models.theodolite import TOGETHER_NS, places
from filters.smoother import passes
from filters.smoother.buffer import MeasurementBuffer, Outcome, Rows, epochs
from filters.smoother.hypothesis import Moment, Workspace

HALF_QUALITY_M = 10.0  # position 1-sigma at which quality is 50
DOUBTFUL = 20  # the best quality while two hypotheses are nearly as likely
ROUNDING = 1e-9  # of the largest variance that is known: so much a variance of zero may be below it
KNOWN_M, KNOWN_SHARE = 50.0, 0.05  # position 1-sigma, or its share of the distance, of a state that is known


def polished(track: np.ndarray, shift_s: np.ndarray, variance: float) -> np.ndarray:
    """The ``track`` (k,) TRACK moved by ``shift_s`` (k,), with its quality; in place.

    ``variance``, s², of a shift of all clocks together: no row shows it, and the target has moved meanwhile.
    """
    x, P = np.ascontiguousarray(track["x"]), np.ascontiguousarray(track["P"])
    by_own_clocks(x, P, shift_s, variance)
    track["x"], track["P"] = x, P
    quality = np.empty(len(track))
    _qualities(P, quality)
    track["quality"] = quality
    return doubted(track)


def doubted(track: np.ndarray) -> np.ndarray:
    """The ``track`` (k,) TRACK with no better quality than DOUBTFUL where it is ambiguous; in place."""
    ambiguous = track["ambiguous"]
    if ambiguous.any():
        track["quality"][ambiguous] = np.minimum(track["quality"][ambiguous], DOUBTFUL)
    return track


@kernel
def _qualities(P, quality):
    """``quality`` (k,) of states of covariance ``P`` (k, ≥3, ≥3)."""
    for k in range(len(P)):
        total = P[k, 0, 0] + P[k, 1, 1] + P[k, 2, 2]
        sigma_m = math.sqrt(total) if total > 0.0 else 0.0
        quality[k] = np.rint(100.0 / (1.0 + sigma_m / HALF_QUALITY_M)) if total < math.inf else -1.0


@exact
def by_own_clocks(x, P, shift_s, variance):
    """States ``x`` (k, ≥9), ``P`` (k, ≥6, ≥6) as they were ``shift_s`` (k,) before, by their own motion.

    In place. Their time has ``variance``, s².
    """
    for k in range(len(x)):
        shift = shift_s[k]
        for i in range(3):
            x[k, i] -= shift * x[k, i + 3] - 0.5 * shift * shift * x[k, i + 6]
            x[k, i + 3] -= shift * x[k, i + 6]
        if variance > 0.0:
            for i in range(6):
                for j in range(6):
                    P[k, i, j] += variance * x[k, i + 3] * x[k, j + 3]


def known(model: Model, x: np.ndarray, P: np.ndarray, factor: float = 1.0) -> np.ndarray:
    """(k,) bool, whether each state ``x`` (k, ≥6), ``P`` (k, ≥6, ≥6) is known well enough to be published.

    Position within KNOWN_M or KNOWN_SHARE of the distance to the nearest instrument, and velocity within the
    same for a second; all that times ``factor``. A variance that rounding has made negative says nothing.
    """
    found = np.empty(len(x), np.bool_)
    x, P = np.ascontiguousarray(x), np.ascontiguousarray(P)
    _known(model.is_ins, model.offset, x, P, factor, found)
    return found


@kernel
def _known(is_ins, offset, x, P, factor, found):
    for k in range(len(x)):
        nearest = math.inf
        for s in range(len(is_ins)):
            if not is_ins[s]:
                a, b, c = x[k, 0] - offset[s, 0], x[k, 1] - offset[s, 1], x[k, 2] - offset[s, 2]
                nearest = min(nearest, a * a + b * b + c * c)
        distance = math.sqrt(nearest) if nearest < math.inf else 0.0
        limit = factor * max(KNOWN_M, KNOWN_SHARE * distance)
        good = True
        for i in range(6):
            variance = P[k, i, i]
            if i == 2 and P[k, 5, 5] == 0.0:  # a height told beforehand is as good as it was told
                variance = 0.0
            good &= -ROUNDING * limit * limit < variance < limit * limit
        found[k] = good


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
    unused = passes.scores(n)
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
