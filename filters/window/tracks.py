"""Tracks as they are published: by the time most clocks agree on, and over the whole flight."""

from collections.abc import Iterator

import numpy as np

from filters.models import model as models
from filters.models import motion
from filters.window import passes
from filters.window.book import Span

HALF_QUALITY_M = 10.0  # position 1-sigma at which quality is 50


def polished(track: np.ndarray, shift_s: np.ndarray) -> np.ndarray:
    """The ``track`` (k,) TRACK moved by ``shift_s`` (k,) or (1,), with its quality; in place."""
    x, shift = track["x"], shift_s[:, None]
    x[:, :3] -= shift * x[:, 3:6] - 0.5 * shift**2 * x[:, 6:9]
    x[:, 3:6] -= shift * x[:, 6:9]
    sigma_m = np.sqrt(np.trace(track["P"][:, :3, :3], axis1=1, axis2=2))
    track["quality"] = np.round(100.0 / (1.0 + sigma_m / HALF_QUALITY_M))
    return track


def smooth(model: models.Model, flight: Span, starts: dict) -> Iterator[tuple[np.ndarray, ...]]:
    """Times (k,), states (k, n) and covariances (k, n, n) of a flight's epochs, part by part, the last first.

    ``starts``: row → (`story.Moment` to go ahead from there, whether it knows nothing of the rows before).
    Full covariances of a whole flight would not fit into memory: hence the parts.
    """
    rows, n, end = flight.rows, len(model.prior), flight.end
    r, N, work = np.zeros(n), np.zeros((n, n)), models.scratch(n)
    for begin in sorted(starts, reverse=True):
        at, fresh = starts[begin]
        if begin == end:
            continue
        part, out = Span(rows, begin, end), passes.trace(end - begin, n, end - begin)
        x, P = at.x.copy(), at.P.copy()
        passes.ahead(model, *part, x, P, at.t_ns, out, work)
        passes.back(model, *part, out, r, N, work)
        motion.pull_back(r, N, (rows.t[begin] - at.t_ns) * 1e-9, model.rate)
        if fresh:
            r[:], N[:] = 0.0, 0.0
        first = part.epochs()
        yield part.part("t")[first], out.x[first], out.P[first]
        end = begin
