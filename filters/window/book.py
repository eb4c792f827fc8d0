"""The book of all rows: in order of time, with what was made of each.

    0 ──► final ──► decided ──► done ──► size
                            window       new

Every row before ``done`` has a verdict. It may change in the window; when final, it is published for good.
Only a late row takes ``decided`` and ``done`` back, never before ``final``.
"""

from typing import NamedTuple

import numpy as np

from filters.models.rows import DUPLICATE, INVALID, LATE, ROW, VERDICT
from filters.window import outlier


class Rows(NamedTuple):
    """All rows so far in order of time, and what was made of them; arrays (capacity,)."""

    id: np.ndarray
    t: np.ndarray  # ns
    sensor: np.ndarray
    channel: np.ndarray
    value: np.ndarray
    noise: np.ndarray  # variance
    jerk: np.ndarray  # density of the white jerk on the way to the row, m²/s⁵
    weight: np.ndarray
    off: np.ndarray  # value − predicted, the short way round
    predicted: np.ndarray
    sigma: np.ndarray
    nis: np.ndarray  # squared standardised innovation
    verdict: np.ndarray
    reason: np.ndarray
    told: np.ndarray  # verdict as published, −1 not yet


GIVEN = {"id": "id", "t": "t_ns", "sensor": "sensor", "channel": "channel", "value": "value"}  # Rows: ROW
JUDGED = ("noise", "jerk", "weight", "off", "predicted", "sigma", "nis", "verdict", "reason")


def room(n: int) -> Rows:
    """Empty rows, ``n`` of them."""
    types = ["i8", "i8", "i2", "i1", "f8", "f8", "f8", "f8", "f8", "f8", "f8", "f8", "i1", "i1", "i1"]
    return Rows(*(np.zeros(n, t) for t in types))


class Span(NamedTuple):
    """Rows ``begin`` to ``end``. Unpacked, it is how kernels take them."""

    rows: Rows
    begin: int
    end: int

    def part(self, name: str) -> np.ndarray:
        """A view of one column."""
        return getattr(self.rows, name)[self.begin : self.end]

    def judged(self) -> list[np.ndarray]:
        """What was made of these rows, copied; see `restore`."""
        return [self.part(name).copy() for name in JUDGED]

    def restore(self, judged: list[np.ndarray]) -> None:
        """Take back what was made of them since."""
        for name, column in zip(JUDGED, judged, strict=True):
            self.part(name)[:] = column

    def label(self, how, run: np.ndarray, alone: np.ndarray) -> None:
        """Name them; ``how`` is `outlier.label` or takes the same, as do ``run`` and ``alone``."""
        rows = self.rows
        columns = (rows.sensor, rows.channel, rows.weight, rows.off, rows.verdict, rows.reason)
        how(*columns, self.begin, self.end, run, alone)

    def copy(self) -> "Span":
        """The same rows apart from the book."""
        return Span(Rows(*(c[self.begin : self.end].copy() for c in self.rows)), 0, self.end - self.begin)

    def epochs(self) -> np.ndarray:
        """(k,) the first row of each epoch, counted from ``begin``."""
        t = self.part("t")
        return np.flatnonzero(np.diff(t, prepend=t[:1] - 1))


class Book:
    """See the module's text."""

    def __init__(self):
        self.rows = room(4096)
        self.size = self.done = self.decided = self.final = 0
        self._told = 0  # final when `changes` last said so

    def span(self, begin: int, end: int) -> Span:
        """Rows ``begin`` to ``end``."""
        return Span(self.rows, begin, end)

    def window(self) -> Span:
        """What is done and not decided."""
        return self.span(self.decided, self.done)

    def epoch(self) -> Span:
        """The first rows that are not done: those of one time."""
        t = self.rows.t[self.done : self.size]
        return self.span(self.done, self.done + int(np.searchsorted(t, t[0], side="right")))

    def enter(self, good: np.ndarray) -> np.ndarray:
        """Sort ``good`` (n,) ROW in among the rows not yet done; returns those that were there already."""
        size = self.size + len(good)
        while size > len(self.rows.t):
            self.rows = Rows(*(np.concatenate([c, np.zeros_like(c)]) for c in self.rows))
        new = self.span(self.size, size)
        for name, field in GIVEN.items():
            new.part(name)[:] = good[field]
        new.part("told")[:] = -1
        tail = self.span(self.done, size)
        t, sensor, channel = (tail.part(name) for name in ("t", "sensor", "channel"))
        order = np.lexsort((channel, sensor, t))
        t, sensor, channel = t[order], sensor[order], channel[order]
        same = np.zeros(len(order), bool)
        same[1:] = (t[1:] == t[:-1]) & (sensor[1:] == sensor[:-1]) & (channel[1:] == channel[:-1])
        if not same.any() and (np.diff(order) == 1).all():  # as nearly always
            self.size = size
            return np.zeros(0, ROW)
        twice = np.zeros(same.sum(), ROW)
        twice["id"] = tail.part("id")[order[same]]
        order = order[~same]
        self.size = self.done + len(order)
        for column in self.rows:
            column[self.done : self.size] = column[self.done : size][order]
        return twice

    def void(self, end: int) -> None:
        """The rows before ``end`` came before there was a state."""
        rows = self.rows
        rows.verdict[:end], rows.reason[:end], rows.weight[:end] = INVALID, outlier.NO_STATE, 0.0
        self.decided = end

    def changes(self) -> np.ndarray:
        """(k,) VERDICT, those that are new, changed or final since the last call."""
        done = self.span(self._told, self.done)
        final = np.arange(done.begin, done.end) < self.final
        k = done.begin + np.flatnonzero(final | (done.part("verdict") != done.part("told")))
        out = np.zeros(len(k), VERDICT)
        for name in ("id", "predicted", "sigma", "weight", "verdict", "reason"):
            out[name] = getattr(self.rows, name)[k]
        out["final"] = k < self.final
        self.rows.told[k] = self.rows.verdict[k]
        self._told = self.final
        return out


def faults(new: np.ndarray, variance: np.ndarray, oldest_ns: int) -> np.ndarray:
    """(n,) why each of ``new`` (n,) ROW cannot be entered: an index into `outlier.REASONS`, NONE if it can.

    ``variance`` (s, 13) is finite where a sensor has the channel; what is before ``oldest_ns`` is final.
    """
    known = (new["sensor"] >= 0) & (new["sensor"] < len(variance))
    known[known] = np.isfinite(variance[new["sensor"][known], new["channel"][known]])
    fault = np.full(len(new), outlier.NONE)
    fault[new["t_ns"] < oldest_ns] = outlier.TOO_OLD
    fault[~np.isfinite(new["value"])] = outlier.NOT_FINITE
    fault[~known] = outlier.NO_CHANNEL
    return fault


def refusals(rows: np.ndarray, reason: np.ndarray) -> np.ndarray:
    """(n,) VERDICT on ``rows`` (n,) ROW that are not entered, each for its ``reason`` (n,)."""
    out = np.zeros(len(rows), VERDICT)
    out["id"], out["reason"], out["final"] = rows["id"], reason, True
    out["predicted"] = out["sigma"] = np.nan
    out["verdict"] = INVALID
    out["verdict"][reason == outlier.TWICE] = DUPLICATE
    out["verdict"][reason == outlier.TOO_OLD] = LATE
    return out
