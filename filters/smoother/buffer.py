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
from numba import njit

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
LONG_AGO_NS = np.iinfo(np.int64).min // 2  # a time before all others
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

    @property
    def newest_done_ns(self) -> int:
        """The time of the newest row that is done."""
        return int(self._rows.t[self.done - self._base - 1]) if self.done else LONG_AGO_NS

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
        begin, rows = self.size - self._base, self._rows
        rows.place[begin : begin + len(good)] = place
        self._published[begin : begin + len(good)] = -1
        if _append(rows, self._id, good, self._variance, begin, self.done - self._base):  # as nearly always
            self.size = size
            return np.zeros(0, ROW)
        tail = self._at(self.done, size)
        t, sensor, channel = rows.t[tail], rows.sensor[tail], rows.channel[tail]
        order = np.lexsort((channel, sensor, t))
        t, sensor, channel = t[order], sensor[order], channel[order]
        same = np.zeros(len(order), bool)
        same[1:] = (t[1:] == t[:-1]) & (sensor[1:] == sensor[:-1]) & (channel[1:] == channel[:-1])
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
        out = np.empty(self.done - self._reported, VERDICT)
        count = _changed(
            self._rows, self._outcome, self._id, self._verdict, self._reason, self._published,
            self._reported - self._base, self.done - self._base, self.final - self._base, out,
        )  # fmt: skip
        self._reported = self.final
        while self._reported - self._base >= 2 * BLOCK:  # the newest final rows may still be looked at
            self._pass()
        return out[:count]


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


def first_epoch(rows: Rows) -> int:
    """How many rows have the time of the first one."""
    return int(np.searchsorted(rows.t, rows.t[0], side="right"))


def faults(new: np.ndarray, variance: np.ndarray, oldest_ns: int) -> np.ndarray:
    """(n,) why each of ``new`` (n,) ROW cannot be entered: an index into REASONS, NONE if it can.

    ``variance`` (s, 13) is finite where a sensor has the channel; what is before ``oldest_ns`` is final.
    """
    fault = np.empty(len(new), np.int64)
    _faults(new, variance, oldest_ns, fault)
    return fault


@njit(cache=True)
def _faults(new, variance, oldest_ns, fault):
    for k in range(len(new)):
        row, fault[k] = new[k], NONE
        if row["t_ns"] < oldest_ns:
            fault[k] = TOO_OLD
        if not np.isfinite(row["value"]):
            fault[k] = NOT_FINITE
        known = 0 <= row["sensor"] < variance.shape[0] and 0 <= row["channel"] < variance.shape[1]
        if not known or not np.isfinite(variance[row["sensor"], row["channel"]]):
            fault[k] = NO_CHANNEL


@njit(cache=True)
def _append(rows, ids, good, variance, begin, done):
    """Enter ``good`` (n,) ROW into the columns from ``begin`` on; are those from ``done`` on in order?

    That is by time, sensor and channel, and none of them twice.
    """
    for j in range(len(good)):
        k, row = begin + j, good[j]
        rows.t[k], rows.sensor[k], rows.channel[k] = row["t_ns"], row["sensor"], row["channel"]
        rows.value[k], ids[k] = row["value"], row["id"]
        own = row["sigma"] * row["sigma"]
        stated = row["sigma"] > 0.0 and np.isfinite(own)
        rows.stated[k] = own if stated else variance[row["sensor"], row["channel"]]
    in_order = True
    for k in range(max(begin, done + 1), begin + len(good)):
        before = (rows.t[k - 1], rows.sensor[k - 1], rows.channel[k - 1])
        in_order &= before < (rows.t[k], rows.sensor[k], rows.channel[k])
    return in_order


@njit(cache=True)
def _changed(rows, own, ids, verdict, reason, published, begin, end, final, out):
    """Put VERDICT of rows ``begin`` to ``end`` that are new, changed or final into ``out``; how many.

    Those before ``final`` are. Rows of our own have no sender, and an id below zero.
    """
    count = 0
    for k in range(begin, end):
        if (k >= final and verdict[k] == published[k]) or ids[k] < 0:
            continue
        one = out[count]
        one["id"], one["verdict"], one["reason"], one["final"] = ids[k], verdict[k], reason[k], k < final
        one["predicted"], one["sigma"] = rows.value[k] - own.residual[k], own.sigma[k]
        one["weight"] = own.weight[k]
        published[k] = verdict[k]
        count += 1
    return count


def refusals(rows: np.ndarray, reason: np.ndarray) -> np.ndarray:
    """(n,) VERDICT on ``rows`` (n,) ROW that are not entered, each for its ``reason`` (n,)."""
    out = np.zeros(len(rows), VERDICT)
    out["id"], out["reason"], out["final"] = rows["id"], reason, True
    out["predicted"] = out["sigma"] = np.nan
    out["verdict"] = INVALID
    out["verdict"][reason == TWICE] = DUPLICATE
    out["verdict"][reason == TOO_OLD] = LATE
    return out
