"""The estimator: rows in; track, smoothed track and verdicts out.

    rows ──► first decision, epoch by epoch ──► head: the state now
                 every ``cell_s`` of data time: re-decide the window ──► head again, from the re-decided rows
                 ``horizon_s`` later: decided, the anchor moves on
                 ``lateness_s`` after that: final

The `Book` keeps the rows, the `Story` judges them and knows the state; the estimator says when. Everything
follows from the rows in order of time. A late row winds the estimator back to the snapshot before it and goes
on from there, so what is final does not depend on the order of arrival.
"""

from collections.abc import Callable, Sequence
from typing import NamedTuple

import numpy as np

from filters.correction import correction as corrections
from filters.models import ins, motion
from filters.models import model as models
from filters.models.motion import CORE
from filters.models.rows import CHANNELS, ROW, TRACK, VERDICT, Sensor, Step
from filters.window import decide, outlier, rivals, start, tracks
from filters.window import report as reports
from filters.window.book import Book, Span, faults, refusals
from filters.window.story import Memory, Moment, Story


class Settings(NamedTuple):
    """What steers an estimator."""

    jerk_psd: float = motion.JERK_PSD
    ins_bias_sigma_m: float = ins.BIAS_SIGMA_M
    ins_bias_tau_s: float = ins.BIAS_TAU_S
    soft: float = outlier.SOFT  # sigmas
    hard: float = outlier.HARD  # sigmas; inf takes every value
    horizon_s: float = 1.0  # what later rows may still change; 0: decided at first sight
    lateness_s: float = 1.0  # a row may come so much later than the newest one
    cell_s: float = 0.2  # data time between two re-decisions


class Snapshot(NamedTuple):
    """All that is needed to go on from the beginning of a cell."""

    boundary_ns: int
    done: int  # rows before the boundary
    decided: int  # of these
    judged: list[np.ndarray]  # what was made of the rows between
    memory: Memory
    tally: np.ndarray  # (s, 13, 3) of decided rows: used, sum of NIS, refused
    left: np.ndarray  # (k,) TRACK smoothed, epochs decided when the cell before ended


LONG_AGO_NS = np.iinfo(np.int64).min // 2
MARK_NS = 1_000_000_000
DEEP = 3  # every so many re-decisions hear the costly rivals too
START_NS = 1_000_000_000  # rows so far apart may still make a fix together


class Estimator:
    """See the module's text. ``sensors`` in the order of ROW's ``sensor``.

    ``correction`` makes of each epoch's predicted and updated state the one that is published; as
    `corrections.off`.
    """

    def __init__(
        self,
        sensors: Sequence[Sensor],
        settings: Settings,
        handling: tuple[Callable, Callable] = (decide.admit, outlier.label),
        correction: Callable = corrections.off,
    ):
        self.sensors, self.settings = tuple(sensors), settings
        self._handling, self._correction = handling, correction
        self.model = models.build(
            sensors, settings.jerk_psd, settings.ins_bias_sigma_m, settings.ins_bias_tau_s
        )
        self._cell_ns, self._horizon_ns, self._lateness_ns = (
            round(1e9 * s) for s in (settings.cell_s, settings.horizon_s, settings.lateness_s)
        )
        self._book, self._story = Book(), Story(self.model, settings, *handling)
        self._tally = np.zeros((len(sensors), len(CHANNELS), 3))
        self._newest_ns, self._fixed_ns, self._boundary_ns = LONG_AGO_NS, 0, LONG_AGO_NS
        self._marks: list[tuple[int, Moment]] = []
        self._smoothed: list[np.ndarray] = []
        self._snapshots = [self._snapshot(np.zeros(0, TRACK))]

    def warm_up(self) -> None:
        """Compile everything, or fetch it from the cache, before the first measurement."""
        twin = Estimator(self.sensors, self.settings, self._handling, self._correction)
        said = [(s, c) for s, sensor in enumerate(self.sensors) for c in np.flatnonzero(sensor.sigma > 0)]
        rows = np.zeros(2 * len(said), ROW)
        for k, (s, c) in enumerate(said + said):
            rows[k] = (k, 0 if k < len(said) else 2 * 10**9, s, c, 1.0)
        twin.step(rows)
        twin._story.price(twin._book.span(0, 1))
        twin.finish()
        twin.smooth()

    def step(self, rows: np.ndarray) -> Step:
        """Take in ``rows`` (n,) ROW, late ones too, and say what they bring."""
        refused = self._insert(rows)
        book, story = self._book, self._story
        begin = book.done if story.head else 0  # before the start, rows wait and are gone through again
        room = len(book.span(begin, book.size).epochs())
        track, clocks, count = np.zeros(room, TRACK), np.zeros((room, len(self.sensors))), 0
        while book.done < book.size:
            if self._epoch() and story.head.t_ns > self._newest_ns:
                self._newest_ns = story.head.t_ns
                head = story.head
                x = self._correction(*story.predicted, head.x, head.P)
                track["t_ns"][count], track["fixed_ns"][count] = head.t_ns, self._fixed_ns
                track["x"][count], track["P"][count] = x[:CORE], head.P[:CORE, :CORE]
                track["reset_counter"][count] = story.begun_again
                clocks[count] = head.x[self.model.clock_at]
                count += 1
        track = tracks.polished(track[:count], models.common_shift(self.model, clocks[:count]))
        verdicts = book.changes()
        return Step(
            track, self._take_smoothed(), np.concatenate([refused, verdicts]) if len(refused) else verdicts
        )

    def finish(self) -> Step:
        """Decide what is left. No step may follow."""
        if self._story.head is not None:
            self._close(self._story.head.t_ns + self._horizon_ns + 1)
        self._snapshots = self._snapshots[-1:]
        self._book.final = self._book.size
        return Step(np.zeros(0, TRACK), self._take_smoothed(), self._book.changes())

    def report(self) -> dict:
        """Evidence so far, ready for JSON: NIS per channel, systematic errors, counts, resets."""
        story = self._story
        x, P = (story.head.x, story.head.P) if story.head else (np.zeros(0), np.zeros((0, 0)))
        log = [{"t_ns": r.anchor.t_ns, "reason": r.reason} for r in story.resets if r.counted]
        return reports.report(self.sensors, self.model, x, P, self._tally, log)

    def smooth(self) -> np.ndarray:
        """Best estimate of trajectory (k,) TRACK: ahead and back over the flight with final weights."""
        starts = {row: (mark, False) for row, mark in self._marks}
        starts |= {reset.row: (reset.anchor, True) for reset in self._story.resets}
        flight = self._book.span(0, self._book.size)
        parts = [self._track(*part) for part in tracks.smooth(self.model, flight, starts)]
        return np.concatenate([np.zeros(0, TRACK), *parts[::-1]])

    # ---- rows in

    def _insert(self, new: np.ndarray) -> np.ndarray:
        """Put the good ones of ``new`` in order; returns the verdicts (k,) VERDICT on the others."""
        fault = faults(new, self.model.variance, self._snapshots[0].boundary_ns)
        bad, book = fault != outlier.NONE, self._book
        good = new[~bad]
        if len(good) and book.done and good["t_ns"].min() <= book.rows.t[book.done - 1]:
            self._rewind(good["t_ns"].min())
        twice = book.enter(good)
        if len(good) == len(new) and not len(twice):
            return np.zeros(0, VERDICT)
        why = np.concatenate([fault[bad], np.full(len(twice), outlier.TWICE)])
        return refusals(np.concatenate([new[bad], twice]), why)

    def _rewind(self, t_ns: int) -> None:
        """Go on from the last snapshot that knows nothing of ``t_ns``."""
        while self._snapshots[-1].boundary_ns > t_ns:
            self._snapshots.pop()
        to, book = self._snapshots[-1], self._book
        self._boundary_ns, book.done, book.decided = to.boundary_ns, to.done, to.decided
        book.window().restore(to.judged)
        self._story.recall(to.memory)
        self._tally = to.tally.copy()

    def _snapshot(self, left: np.ndarray) -> Snapshot:
        """The present; ``left``: see there."""
        book = self._book
        return Snapshot(
            self._boundary_ns, book.done, book.decided, book.window().judged(),
            self._story.memory(), self._tally.copy(), left,
        )  # fmt: skip

    # ---- one epoch, one cell

    def _epoch(self) -> bool:
        """Take the next epoch's rows into the head; False while there is no state."""
        book, story, epoch = self._book, self._story, self._book.epoch()
        if story.head is None:
            self._begin(epoch)
            return False
        t_ns = int(epoch.part("t")[0])
        cell_ns = t_ns // self._cell_ns * self._cell_ns
        if cell_ns > self._boundary_ns:
            self._close(cell_ns)
        if story.take(epoch):
            self._fixed_ns = t_ns
        book.done = epoch.end
        if self.settings.horizon_s > 0 and (epoch.part("weight") == 0.0).any():
            self._doubt_motion(book.window())
        return True

    def _doubt_motion(self, window: Span) -> None:
        """Decide again at once, where what was just refused may be a jolt."""
        if not self._story.young and rivals.jolt(*window) < window.end:
            self._redecide(window, 0)

    def _begin(self, epoch: Span) -> None:
        """Start from the first fix that the last second's rows give; older rows get no state."""
        book, rows, end = self._book, epoch.rows, epoch.end
        first = int(np.searchsorted(rows.t[:end], rows.t[end - 1] - START_NS))
        near = book.span(first, end)
        fixes = start.fixes(self.model, *(near.part(name) for name in ("sensor", "channel", "value")))
        book.void(first)
        book.done = first if fixes else end
        if fixes:
            t_ns = int(rows.t[first])
            self._story.begin(t_ns, *start.state(self.model, *fixes[0]))
            self._marks = [(first, self._story.anchor.copy())]
            self._boundary_ns = t_ns // self._cell_ns * self._cell_ns

    def _close(self, boundary_ns: int) -> None:
        """End the cell: decide again, move the anchor, take a snapshot."""
        book, window = self._book, self._book.window()
        cut = window.begin + int(np.searchsorted(window.part("t"), boundary_ns - self._horizon_ns))
        leaving, left = book.span(window.begin, cut), np.zeros(0, TRACK)
        if self.settings.horizon_s > 0:
            self._redecide(window, cut - window.begin)
            left = self._window_track(leaving)
        self._count(leaving)
        self._story.leave(leaving)
        self._boundary_ns, book.decided = boundary_ns, cut
        self._story.watch(book.window())
        self._snapshots.append(self._snapshot(left))
        while len(self._snapshots) > 1 and self._snapshots[1].boundary_ns <= boundary_ns - self._lateness_ns:
            self._snapshots.pop(0)
            self._make_final(self._snapshots[0])

    def _redecide(self, window: Span, keep: int) -> None:
        """`Story.redecide`; what has come since the cell began is new."""
        fresh = window.begin + int(np.searchsorted(window.part("t"), self._boundary_ns))
        deep = self._boundary_ns // self._cell_ns % DEEP == 0
        self._story.redecide(window, keep, fresh, deep)

    def _count(self, leaving: Span) -> None:
        """Tally rows that are about to be decided for good."""
        used = leaving.part("weight") > 0
        where = (leaving.part("sensor"), leaving.part("channel"))
        np.add.at(self._tally[..., 0], where, used)
        np.add.at(self._tally[..., 1], where, np.where(used, leaving.part("nis"), 0.0))
        np.add.at(self._tally[..., 2], where, ~used)

    def _make_final(self, oldest: Snapshot) -> None:
        """Nothing before the ``oldest`` snapshot changes any more."""
        self._book.final = oldest.decided
        self._smoothed.append(oldest.left)
        anchor = oldest.memory.anchor
        if anchor.t_ns >= self._marks[-1][1].t_ns + MARK_NS:  # so often `smooth` can start its way ahead
            self._marks.append((oldest.decided, anchor))

    # ---- what goes out

    def _window_track(self, leaving: Span) -> np.ndarray:
        """Smoothed track (k,) TRACK of the epochs in rows ``leaving``, as last re-decided."""
        first, out = leaving.epochs(), self._story.out
        first = first[first < len(out.x)]
        return self._track(leaving.part("t")[first], out.x[first], out.P[first])

    def _track(self, t_ns: np.ndarray, x: np.ndarray, P: np.ndarray) -> np.ndarray:
        """(k,) TRACK of full states (k, n), (k, n, n), by the clocks as they are known now."""
        track = np.zeros(len(t_ns), TRACK)
        track["t_ns"], track["x"], track["P"] = t_ns, x[:, :CORE], P[:, :CORE, :CORE]
        track["reset_counter"] = self._story.begun_again
        clocks = self._story.head.x[None, self.model.clock_at]
        return tracks.polished(track, models.common_shift(self.model, clocks))

    def _take_smoothed(self) -> np.ndarray:
        parts, self._smoothed = self._smoothed, []
        return np.concatenate(parts) if parts else np.zeros(0, TRACK)
