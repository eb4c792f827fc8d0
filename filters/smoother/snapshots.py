"""Points to go on from: for a late row, and for the smoother of the whole flight.

At the end of every cell a snapshot of the estimator's progress is kept, until it is older than the latest row
that may come. What its rows were decided to be is final then. Of the final ones, one a second keeps its
anchor: the flight is smoothed from mark to mark. Anchors of the last seconds are kept to take back what a
wrong clock has taught.
"""

from array import array
from collections import deque
from collections.abc import Iterator, Sequence
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from filters.models.rows import CHANNELS, TRACK
from filters.models.store import Store
from filters.smoother import passes, status, tracks
from filters.smoother.bank import Bank
from filters.smoother.buffer import LONG_AGO_NS, MeasurementBuffer, Outcome, Rows
from filters.smoother.hypothesis import Hypothesis, Moment

if TYPE_CHECKING:  # the window uses this file
    from filters.smoother.window import Window

MARK_NS = 1_000_000_000
KEPT, APART_NS = 16, 1_000_000_000  # anchors to go back to, and how far apart


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
        self.turn, self.turned = 0, False  # of the other banks; has there been one since closed_ns?
        self.looked = (0,) * (len(banks) - 1)  # the turn at which each looked at the window
        self.length = np.zeros((sensors, len(CHANNELS)), np.int64)  # consecutive outliers
        self.tally = np.zeros((sensors, len(CHANNELS), 3))  # of decided rows: used, sum of NIS, refused
        self.resets: tuple[Reset, ...] = ()
        self.unknown = 0  # epochs since a state was known well enough to be published
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


class WrongClock(NamedTuple):
    """A clock that went wrong, flight time in ns."""

    before_ns: int  # it was right until then
    newest_ns: int  # its newest row that was taken before it was found out
    moved_s: float = 0.0  # when it goes right again: how far from where it was


class Anchors(NamedTuple):
    """Where one can go forward from."""

    row: int  # the first one after it
    of: tuple[Moment | None, ...]  # the banks


class Withdrawals:
    """What a sensor has said since its clock went wrong is taken back, once that is found out.

    By then its rows are decided: they have moved the target, and with it the slow errors and the clocks of
    all others. So each bank goes forward anew from an anchor of before, over the rows since as they were
    decided, but for those of that sensor: what comes out is what would be known without them. The verdicts
    stay as they were.
    """

    def __init__(self, window: "Window", height_m: float):
        self._window, self._height_m = window, height_m
        self._past: deque[Anchors] = deque(maxlen=KEPT)
        self._asked: dict[int, tuple[WrongClock, int]] = {}  # by sensor; and when done, LONG_AGO_NS: not yet

    def ask(self, sensor: int, wrong: WrongClock) -> None:
        """Take back what ``sensor`` has said since, as soon as its newest row is decided."""
        before, done_ns = self._asked.get(sensor, (None, LONG_AGO_NS))
        if before and before.before_ns == wrong.before_ns and done_ns != LONG_AGO_NS:  # it is right again
            for bank in self._window.now.banks:
                for one in (bank.best, bank.alternative and bank.alternative.hypothesis):
                    if one is not None:
                        self._widen(sensor, one.anchor.P, wrong.moved_s)
                        self._widen(sensor, one.head.P, wrong.moved_s)
        else:
            done_ns = LONG_AGO_NS
        self._asked[sensor] = wrong, done_ns

    def rewound(self) -> None:
        """A late row has taken the window back: what was done since is undone."""
        now, decided = self._window.now, self._window.buffer.decided
        self._forget_after(decided)
        for sensor, (wrong, done_ns) in self._asked.items():
            if done_ns > now.boundary_ns:
                self._asked[sensor] = wrong, LONG_AGO_NS

    def step(self, boundary_ns: int) -> None:
        """Do what can be done at the end of a cell, and note the anchors."""
        now, buffer = self._window.now, self._window.buffer
        if now.best is None:
            return
        for sensor, (wrong, done_ns) in self._asked.items():
            if done_ns == LONG_AGO_NS and wrong.newest_ns <= now.best.anchor.t_ns:
                self._take_back(sensor, wrong)
                self._asked[sensor] = wrong, boundary_ns
        newest = self._past[-1].of[0] if self._past else None
        if newest is None or now.best.anchor.t_ns - newest.t_ns >= APART_NS:
            self._past.append(
                Anchors(buffer.decided, tuple(bank.best and bank.best.anchor for bank in now.banks))
            )

    def _take_back(self, sensor: int, wrong: WrongClock) -> None:
        """Of who was never right there is nothing to go back to; then its clock alone is open again."""
        now, buffer, moved_s = self._window.now, self._window.buffer, np.inf
        began = now.resets[-1].row if now.resets else 0
        right = [
            one for one in self._past if one.row >= began and one.of[0] and one.of[0].t_ns <= wrong.before_ns
        ]
        if right and right[-1].row < buffer.decided:
            self._go_forward(right[-1], sensor)
            moved_s = wrong.moved_s
        for bank in now.banks:
            if bank.best is not None:
                self._widen(sensor, bank.best.anchor.P, moved_s)
                bank.best.settle(buffer.view(buffer.decided, buffer.done), 0)

    def _go_forward(self, past: Anchors, sensor: int) -> None:
        window, buffer = self._window, self._window.buffer
        rows, own = tracks.recalled(window.space.model, buffer, past.row, buffer.decided, self._height_m)
        first = int(own.regime.min())
        own.regime[:] -= first
        densities = window.densities.read(first, first + int(own.regime.max()) + 1)["psd"].copy()
        for bank, anchor in zip(window.now.banks, past.of, strict=True):
            if bank.best is not None and anchor is not None:
                self._again(bank, anchor, rows, own, densities, sensor)
        self._forget_after(past.row)

    def _forget_after(self, row: int) -> None:
        while self._past and self._past[-1].row > row:
            self._past.pop()

    def _again(
        self, bank: Bank, anchor: Moment, rows: Rows, own: Outcome, densities: np.ndarray, sensor: int
    ) -> None:
        """From an ``anchor`` of before over (k,) ``rows`` that are decided, without ``sensor``."""
        space = self._window.space
        left = (rows.sensor == sensor) | (rows.sensor == bank.excluded)
        own = own._replace(weight=np.where(left, np.float32(0.0), own.weight))
        x, P, out = anchor.x.copy(), anchor.P.copy(), passes.trace(len(rows.t), len(anchor.x), 0)
        t_ns = passes.forward(space.model, rows, own, densities, x, P, anchor.t_ns, 0, out, space.work)
        bank.best.anchor = Moment(int(t_ns), x, P, bank.best.anchor.memory)
        bank.alternative = None

    def _widen(self, sensor: int, P: np.ndarray, moved_s: float) -> None:
        """Its clock is by so much less sure; by as much as before the first row, at most. In place."""
        at = self._window.space.model.clock_at[sensor]
        if at >= 0:
            P[at, at] += min(moved_s**2, self._window.space.model.prior[at])
