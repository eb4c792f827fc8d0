"""The measurement buffer: all rows in order of time, and what was made of each.

    0 ──► final ──► decided ──► done ──► size
                            window       new

Every row before ``done`` has a verdict. It may change in the window; when final, it is published for good.
Only a late row takes ``decided`` and ``done`` back, never before ``final``.
"""

from typing import NamedTuple

import numpy as np

from filters.models.rows import DUPLICATE, INVALID, LATE, ROW, VERDICT
from filters.smoother.status import NO_CHANNEL, NO_STATE, NONE, NOT_FINITE, TOO_OLD, TWICE


class Rows(NamedTuple):
    """Rows in order of time, arrays (k,); what the passes read."""

    t: np.ndarray  # ns
    sensor: np.ndarray
    channel: np.ndarray
    value: np.ndarray
    stated: np.ndarray  # variance as stated by the row or by its sensor
    place: np.ndarray  # (k, 3) position by its own measurement, station ENU, m; NaN: it cannot tell


class Outcome(NamedTuple):
    """What was made of them, arrays (k,); of one hypothesis, or of the published one."""

    weight: np.ndarray  # posterior probability of being good, 0 … 1
    noise: np.ndarray  # variance in use
    regime: np.ndarray  # which densities drive the motion on the way to the row, index into a table
    residual: np.ndarray  # value minus what the others predict, angles the short way
    sigma: np.ndarray  # 1-sigma of that
    nis: np.ndarray  # squared standardised innovation


OUTCOME_TYPES = ("f4", "f4", "i4", "f8", "f8", "f4")


def outcome(n: int) -> Outcome:
    """Of ``n`` rows that are not judged yet."""
    return Outcome(*(np.zeros(n, kind) for kind in OUTCOME_TYPES))


class MeasurementBuffer:
    """See the module's text. ``variance`` (s, 13) is finite where a sensor has the channel."""

    def __init__(self, variance: np.ndarray):
        self._variance = variance
        self.rows, self.outcome = _rows(4096), outcome(4096)
        self._id, self._verdict = np.zeros(4096, "i8"), np.zeros(4096, "i1")
        self._reason, self._published = np.zeros(4096, "i1"), np.zeros(4096, "i1")
        self.size = self.done = self.decided = self.final = 0
        self._reported = 0  # final when `changes` was last called

    def view(self, begin: int, end: int) -> Rows:
        """Rows ``begin`` to ``end``."""
        return Rows(*(column[begin:end] for column in self.rows))

    def _columns(self) -> list[np.ndarray]:
        return [*self.rows, *self.outcome, self._id, self._verdict, self._reason, self._published]

    def _replace(self, columns: list[np.ndarray]) -> None:
        self.rows, self.outcome = Rows(*columns[:6]), Outcome(*columns[6:12])
        self._id, self._verdict, self._reason, self._published = columns[12:]

    def insert(self, good: np.ndarray, place: np.ndarray) -> np.ndarray:
        """Sort ``good`` (n,) ROW with their ``place`` (n, 3) in among the rows not yet done.

        Returns those that were there already.
        """
        size = self.size + len(good)
        while size > len(self._id):
            self._replace([np.concatenate([c, np.zeros_like(c)]) for c in self._columns()])
        new, rows = slice(self.size, size), self.rows
        rows.t[new], rows.sensor[new], rows.channel[new] = good["t_ns"], good["sensor"], good["channel"]
        rows.value[new], rows.place[new], self._id[new] = good["value"], place, good["id"]
        own = np.where(good["sigma"] > 0.0, good["sigma"] ** 2, np.nan)
        stated = self._variance[good["sensor"], good["channel"]]
        rows.stated[new], self._published[new] = np.where(np.isfinite(own), own, stated), -1
        tail = slice(self.done, size)
        t, sensor, channel = rows.t[tail], rows.sensor[tail], rows.channel[tail]
        order = np.lexsort((channel, sensor, t))
        t, sensor, channel = t[order], sensor[order], channel[order]
        same = np.zeros(len(order), bool)
        same[1:] = (t[1:] == t[:-1]) & (sensor[1:] == sensor[:-1]) & (channel[1:] == channel[:-1])
        if not same.any() and (np.diff(order) == 1).all():  # as nearly always
            self.size = size
            return np.zeros(0, ROW)
        twice = np.zeros(same.sum(), ROW)
        twice["id"] = self._id[tail][order[same]]
        order = order[~same]
        self.size = self.done + len(order)
        for column in self._columns():
            column[self.done : self.size] = column[self.done : size][order]
        return twice

    def void(self, begin: int, end: int) -> None:
        """Rows ``begin`` to ``end`` came before there was a state."""
        self._verdict[begin:end], self._reason[begin:end] = INVALID, NO_STATE
        self.outcome.weight[begin:end] = 0.0

    def judge(self, begin: int, own: Outcome, verdict: np.ndarray, reason: np.ndarray) -> None:
        """Enter what was made of the rows from ``begin`` on."""
        at = slice(begin, begin + len(verdict))
        for column, value in zip(self.outcome, own, strict=True):
            column[at] = value
        self._verdict[at], self._reason[at] = verdict, reason

    def changes(self) -> np.ndarray:
        """(k,) VERDICT, those that are new, changed or final since the last call."""
        begin, end = self._reported, self.done
        final = np.arange(begin, end) < self.final
        k = begin + np.flatnonzero(final | (self._verdict[begin:end] != self._published[begin:end]))
        k = k[self._id[k] >= 0]  # rows of our own have no sender
        out, made = np.zeros(len(k), VERDICT), self.outcome
        out["id"], out["verdict"], out["reason"] = self._id[k], self._verdict[k], self._reason[k]
        out["predicted"], out["sigma"] = self.rows.value[k] - made.residual[k], made.sigma[k]
        out["weight"], out["final"] = made.weight[k], k < self.final
        self._published[k] = self._verdict[k]
        self._reported = self.final
        return out


def _rows(n: int) -> Rows:
    zeros = (np.zeros(n, kind) for kind in ("i8", "i2", "i1", "f8", "f8"))
    return Rows(*zeros, np.full((n, 3), np.nan))


def epochs(t: np.ndarray) -> np.ndarray:
    """(k,) the first row of each epoch in times ``t`` (n,)."""
    return np.flatnonzero(np.diff(t, prepend=t[:1] - 1))


def faults(new: np.ndarray, variance: np.ndarray, oldest_ns: int) -> np.ndarray:
    """(n,) why each of ``new`` (n,) ROW cannot be entered: an index into REASONS, NONE if it can.

    ``variance`` (s, 13) is finite where a sensor has the channel; what is before ``oldest_ns`` is final.
    """
    known = (new["sensor"] >= 0) & (new["sensor"] < len(variance))
    known &= (new["channel"] >= 0) & (new["channel"] < variance.shape[1])
    known[known] = np.isfinite(variance[new["sensor"][known], new["channel"][known]])
    fault = np.full(len(new), NONE)
    fault[new["t_ns"] < oldest_ns] = TOO_OLD
    fault[~np.isfinite(new["value"])] = NOT_FINITE
    fault[~known] = NO_CHANNEL
    return fault


def refusals(rows: np.ndarray, reason: np.ndarray) -> np.ndarray:
    """(n,) VERDICT on ``rows`` (n,) ROW that are not entered, each for its ``reason`` (n,)."""
    out = np.zeros(len(rows), VERDICT)
    out["id"], out["reason"], out["final"] = rows["id"], reason, True
    out["predicted"] = out["sigma"] = np.nan
    out["verdict"] = INVALID
    out["verdict"][reason == TWICE] = DUPLICATE
    out["verdict"][reason == TOO_OLD] = LATE
    return out
