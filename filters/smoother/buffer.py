"""The measurement buffer: all rows in order of time, and what was made of each.

    0 ──► final ──► decided ──► done ──► size
                            window       new

Every row before ``done`` has a verdict. It may change in the window; when final, it is published for good.
Only a late row takes ``decided`` and ``done`` back, never before ``final``.

Rows have their numbers for the whole flight. Of the final ones only what the smoother of the flight reads is
kept, in a `Store`: `recall` gives it; `view` and `made` give the rows that still count.
"""

from typing import NamedTuple

import numpy as np

from filters.models.rows import CHANNELS, DUPLICATE, INVALID, LATE, ROW, VERDICT
from filters.models.store import InMemory, Keep
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


# of a final row what the smoother of the flight reads: 31 bytes
FINAL = np.dtype(
    [
        ("t", "i8"),
        ("sensor", "i2"),
        ("channel", "i1"),
        ("value", "f8"),
        ("weight", "f4"),
        ("noise", "f4"),
        ("regime", "i4"),
    ]
)
RECENT_SCANS = 5  # of a sensor, that tell how long one takes
BLOCK = 16_384  # final rows that are stored at a time
OUTCOME_TYPES = ("f4", "f4", "i4", "f8", "f8", "f4")


def outcome(n: int) -> Outcome:
    """Of ``n`` rows that are not judged yet."""
    return Outcome(*(np.zeros(n, kind) for kind in OUTCOME_TYPES))


class MeasurementBuffer:
    """See the module's text. ``variance`` (s, 13) is finite where a sensor has the channel."""

    def __init__(self, variance: np.ndarray, keep: Keep = InMemory):
        self._variance = variance
        self._rows, self._outcome = _rows(4096), outcome(4096)
        self._id, self._verdict = np.zeros(4096, "i8"), np.zeros(4096, "i1")
        self._reason, self._published = np.zeros(4096, "i1"), np.zeros(4096, "i1")
        self._past = keep(FINAL)
        self._base = 0  # rows that are in the past: the columns begin after them
        self.size = self.done = self.decided = self.final = 0
        self._reported = 0  # final when `changes` was last called

    def view(self, begin: int, end: int) -> Rows:
        """Rows ``begin`` to ``end``; not of long ago."""
        return Rows(*(column[self._at(begin, end)] for column in self._rows))

    def made(self, begin: int, end: int) -> Outcome:
        """What was made of rows ``begin`` to ``end``; not of long ago."""
        return Outcome(*(column[self._at(begin, end)] for column in self._outcome))

    def count_before(self, t_ns: int) -> int:
        """How many of the rows that are done are before ``t_ns``; of long ago all."""
        return self._base + int(np.searchsorted(self.view(self._base, self.done).t, t_ns))

    def recall(self, begin: int, end: int) -> tuple[Rows, Outcome]:
        """Copies of decided rows ``begin`` to ``end``, of any age, as far as `FINAL` keeps them."""
        past = self._past.read(min(begin, self._base), min(end, self._base))
        live = self._at(max(begin, self._base), max(end, self._base))
        kept = np.concatenate([past, self._kept(live)])
        rows, own = _rows(end - begin), outcome(end - begin)
        for full in (rows, own):
            for name, column in zip(full._fields, full, strict=True):
                if name in FINAL.fields:
                    column[:] = kept[name]
        return rows, own

    def _at(self, begin: int, end: int) -> slice:
        return slice(begin - self._base, end - self._base)

    def _columns(self) -> list[np.ndarray]:
        return [*self._rows, *self._outcome, self._id, self._verdict, self._reason, self._published]

    def _replace(self, columns: list[np.ndarray]) -> None:
        self._rows, self._outcome = Rows(*columns[:6]), Outcome(*columns[6:12])
        self._id, self._verdict, self._reason, self._published = columns[12:]

    def _kept(self, at: slice) -> np.ndarray:
        """(k,) FINAL of the columns ``at``."""
        kept = np.empty(at.stop - at.start, FINAL)
        for full in (self._rows, self._outcome):
            for name, column in zip(full._fields, full, strict=True):
                if name in FINAL.fields:
                    kept[name] = column[at]
        return kept

    def _pass(self) -> None:
        """Let a block of rows that nothing changes any more become the past."""
        self._past.append(self._kept(slice(0, BLOCK)))
        count = self.size - self._base - BLOCK
        for column in self._columns():
            column[:count] = column[BLOCK : BLOCK + count]
        self._base += BLOCK

    def insert(self, good: np.ndarray, place: np.ndarray) -> np.ndarray:
        """Sort ``good`` (n,) ROW with their ``place`` (n, 3) in among the rows not yet done.

        Returns those that were there already.
        """
        size = self.size + len(good)
        while size - self._base > len(self._id):
            self._replace([np.concatenate([c, np.zeros_like(c)]) for c in self._columns()])
        new, rows = self._at(self.size, size), self._rows
        rows.t[new], rows.sensor[new], rows.channel[new] = good["t_ns"], good["sensor"], good["channel"]
        rows.value[new], rows.place[new], self._id[new] = good["value"], place, good["id"]
        own = np.where(good["sigma"] > 0.0, good["sigma"] ** 2, np.nan)
        stated = self._variance[good["sensor"], good["channel"]]
        rows.stated[new], self._published[new] = np.where(np.isfinite(own), own, stated), -1
        tail = self._at(self.done, size)
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
            column[self._at(self.done, self.size)] = column[tail][order]
        return twice

    def void(self, begin: int, end: int) -> None:
        """Rows ``begin`` to ``end`` came before there was a state."""
        at = self._at(begin, end)
        self._verdict[at], self._reason[at] = INVALID, NO_STATE
        self._outcome.weight[at] = 0.0

    def judge(self, begin: int, own: Outcome, verdict: np.ndarray, reason: np.ndarray) -> None:
        """Enter what was made of the rows from ``begin`` on."""
        at = self._at(begin, begin + len(verdict))
        for column, value in zip(self._outcome, own, strict=True):
            column[at] = value
        self._verdict[at], self._reason[at] = verdict, reason

    def changes(self) -> np.ndarray:
        """(k,) VERDICT, those that are new, changed or final since the last call."""
        at = self._at(self._reported, self.done)
        final = np.arange(self._reported, self.done) < self.final
        k = at.start + np.flatnonzero(final | (self._verdict[at] != self._published[at]))
        k = k[self._id[k] >= 0]  # rows of our own have no sender
        out, own = np.zeros(len(k), VERDICT), self._outcome
        out["id"], out["verdict"], out["reason"] = self._id[k], self._verdict[k], self._reason[k]
        out["predicted"], out["sigma"] = self._rows.value[k] - own.residual[k], own.sigma[k]
        out["weight"], out["final"] = own.weight[k], k < self.final - self._base
        self._published[k] = self._verdict[k]
        self._reported = self.final
        while self._reported - self._base >= 2 * BLOCK:  # the newest final rows may still be looked at
            self._pass()
        return out


def _rows(n: int) -> Rows:
    zeros = (np.zeros(n, kind) for kind in ("i8", "i2", "i1", "f8", "f8"))
    return Rows(*zeros, np.full((n, 3), np.nan))


def scan_ns(rows: Rows) -> float:
    """The longest of the sensors' usual times between two measurements; 0 where none is heard twice."""
    longest = 0.0
    for sensor in np.unique(rows.sensor):
        times = np.unique(rows.t[rows.sensor == sensor])[-RECENT_SCANS - 1 :]
        if len(times) > 1:
            longest = max(longest, float(np.median(np.diff(times))))
    return longest


def streams(rows: Rows) -> np.ndarray:
    """(k,) a number for the channel of its sensor that each row is of."""
    return rows.sensor.astype(np.int64) * len(CHANNELS) + rows.channel


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
