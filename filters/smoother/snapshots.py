"""Points to go on from: for a late row, and for the smoother of the whole flight.

At the end of every cell a snapshot of the estimator's progress is kept, until it is older than the latest row
that may come. What its rows were decided to be is final then. Of the final ones, one a second keeps its
anchor: the flight is smoothed from mark to mark.
"""

from array import array
from collections.abc import Iterator, Sequence
from typing import NamedTuple

import numpy as np

from filters.models.rows import CHANNELS, TRACK
from filters.models.store import Store
from filters.smoother import status
from filters.smoother.bank import Bank
from filters.smoother.buffer import MeasurementBuffer
from filters.smoother.hypothesis import LONG_AGO_NS, Hypothesis, Moment

MARK_NS = 1_000_000_000


class Reset(NamedTuple):
    """A start from the sensors, with nothing known before."""

    row: int  # the first one after it
    anchor: Moment
    reason: str  # "" of the first


class Progress:
    """What the rows so far have come to: all that a late row takes back."""

    def __init__(self, banks: list[Bank], sensors: int):
        self.banks = banks  # over all sensors, then without each of them
        self.boundary_ns = LONG_AGO_NS  # begin of the cell
        self.redecided_ns = LONG_AGO_NS  # newest row when the window was last decided again
        self.closed_ns = LONG_AGO_NS  # end of the newest cell that moved the anchors
        self.turn = 0  # of the re-decisions, at which the other banks have theirs
        self.length = np.zeros((sensors, len(CHANNELS)), np.int64)  # consecutive outliers
        self.tally = np.zeros((sensors, len(CHANNELS), 3))  # of decided rows: used, sum of NIS, refused
        self.resets: tuple[Reset, ...] = ()
        self.was_known = True  # well enough to be published, since the newest start

    @property
    def best(self) -> Hypothesis | None:
        """The incumbent over all sensors."""
        return self.banks[0].best

    @property
    def reset_counter(self) -> int:
        """Starts after the first one."""
        return max(0, len(self.resets) - 1)

    def copy(self) -> "Progress":
        """Another one that may go its own way."""
        other = object.__new__(Progress)
        other.__dict__.update(self.__dict__)
        other.banks = [bank.copy() for bank in self.banks]
        other.length, other.tally = self.length.copy(), self.tally.copy()
        return other


class Snapshot(NamedTuple):
    """All that is needed to go on from the beginning of a cell."""

    progress: Progress
    done: int  # rows before the cell
    decided: int  # of these
    left: np.ndarray  # (k,) TRACK smoothed, epochs decided when the cell before ended


def mark_type(states: int, sensors: int) -> np.dtype:
    """As which the anchor of a mark is stored."""
    memory = status.fresh_memory(sensors).shape
    return np.dtype(
        [("t_ns", "i8"), ("x", "f8", (states,)), ("P", "f8", (states, states)), ("memory", "f8", memory)]
    )


class Snapshots:
    """See the module's text."""

    def __init__(self, progress: Progress, marks: Store):
        self._kept = [Snapshot(progress.copy(), 0, 0, np.zeros(0, TRACK))]
        self._rows, self._marked_ns = array("q"), LONG_AGO_NS  # of the marks; the time of the newest
        self._marks = marks  # the states before these rows, of `mark_type`

    @property
    def oldest_ns(self) -> int:
        """Nothing before changes any more."""
        return self._kept[0].progress.boundary_ns

    def take(self, progress: Progress, buffer: MeasurementBuffer, left: np.ndarray) -> None:
        """Keep the present; ``left``: see `Snapshot`."""
        self._kept.append(Snapshot(progress.copy(), buffer.done, buffer.decided, left))

    def rewind(self, t_ns: int, buffer: MeasurementBuffer) -> Progress:
        """Take ``buffer`` back to the last snapshot that knows nothing of ``t_ns``; the progress then."""
        while self._kept[-1].progress.boundary_ns > t_ns:
            self._kept.pop()
        buffer.done, buffer.decided = self._kept[-1].done, self._kept[-1].decided
        return self._kept[-1].progress.copy()

    def expire(self, latest_ns: int) -> Iterator[Snapshot]:
        """Give up all snapshots but the last one before ``latest_ns``; each that becomes the oldest so."""
        while len(self._kept) > 1 and self._kept[1].progress.boundary_ns <= latest_ns:
            self._kept.pop(0)
            self._mark(self._kept[0])
            yield self._kept[0]

    def _mark(self, oldest: Snapshot) -> None:
        best = oldest.progress.best
        if best is None:
            return
        anchor = best.anchor
        if anchor.t_ns < self._marked_ns + MARK_NS:
            return
        mark_of = mark_type(len(anchor.x), len(anchor.memory))
        self._marks.append(np.array([tuple(anchor)], mark_of))
        self._rows.append(oldest.decided)
        self._marked_ns = anchor.t_ns

    def begins(self, resets: Sequence[Reset]) -> Iterator[tuple[int, Moment, bool]]:
        """Where the flight is smoothed from, the last first: a row, the state before it, and whether that
        is one of the ``resets``, which know nothing of the rows before.
        """
        rows = np.array([*self._rows, *(reset.row for reset in resets)], np.int64)
        for k in np.argsort(rows, kind="stable")[::-1].tolist():
            if k < len(self._rows):
                yield int(rows[k]), self._mark_at(k), False
            else:
                yield int(rows[k]), resets[k - len(self._rows)].anchor, True

    def _mark_at(self, k: int) -> Moment:
        mark = self._marks.read(k, k + 1)[0]
        return Moment(int(mark["t_ns"]), *(mark[name].copy() for name in ("x", "P", "memory")))

    def end(self) -> list[np.ndarray]:
        """What was smoothed and is not final yet; no late row may follow."""
        left = [snapshot.left for snapshot in self._kept[1:]]
        self._kept = self._kept[-1:]
        return left
