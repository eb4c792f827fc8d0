"""The estimator: rows in; track, smoothed track and verdicts out.

    rows ──► buffer ──► first sight, epoch by epoch ──► head: the state now
                every cell, and at a surprise: settle the window, challenge the incumbent ──► head again
                one lag later: decided, the anchor moves on
                ``lateness_s`` after that: final

Beside the incumbent over all sensors, one bank for each sensor goes on without it: what that sensor says is
judged by all others there, and the distance between the two states bounds the error that it can cause.
Everything follows from the rows in order of time. A late row winds the estimator back to the snapshot before
it and goes on from there, so what is final does not depend on the order of arrival.
"""

from collections.abc import Callable, Sequence
from typing import NamedTuple

import numpy as np

from filters.correction import correction as corrections
from filters.models import ins
from filters.models import state as models
from filters.models.motion import CORE
from filters.models.rows import CHANNELS, ROW, TRACK, Sensor, Step
from filters.smoother import gated, protection, report, start, status, tracks
from filters.smoother.bank import Bank, Prior
from filters.smoother.buffer import MeasurementBuffer, Rows, epochs, faults, refusals
from filters.smoother.hypothesis import Moment, Workspace


class Settings(NamedTuple):
    """What steers an estimator."""

    jerk_psd: float = 10.0  # m²/s⁵, middle of the prior of the density of the white jerk
    gust_psd: float = 0.05  # m²/s³, the same of the white acceleration
    ins_bias_sigma_m: float = ins.BIAS_SIGMA_M
    ins_bias_tau_s: float = ins.BIAS_TAU_S
    height_m: float = np.nan  # of the target, where no sensor sees it; NaN: not known
    height_sigma_m: float = np.nan
    lag_scans: float = 5.0  # of the slowest sensor, that later rows may still change a decision
    shortest_lag_s: float = 1.0
    longest_lag_s: float = 30.0
    lateness_s: float = 1.0  # a row may come so much later than the newest one


CELL_NS = 250_000_000  # data time between two re-decisions at the shortest lag
CELLS_PER_LAG = 4
SPARSE_ROWS = 60  # a window of fewer rows is tried for a start, and decided again, at every epoch
SURPRISE_NS = 50_000_000  # re-decisions for a surprise are at least so far apart
SPEED_LOST_MPS = start.SPEED_SIGMA_MPS  # a prediction that knows less than a start does is a start
LOST_FACTOR = 5.0  # of what may be published: beyond, rows are better taken for a start
LONG_AGO_NS, NEVER_NS = np.iinfo(np.int64).min // 2, np.iinfo(np.int64).max
MARK_NS = 1_000_000_000


class Snapshot(NamedTuple):
    """All that is needed to go on from the beginning of a cell."""

    boundary_ns: int
    done: int  # rows before the boundary
    decided: int  # of these
    redecided_ns: int
    closed_ns: int  # boundary of the newest cell whose window was decided again
    turn: int  # of the re-decisions, at which the other banks have theirs
    banks: list[Bank]
    length: np.ndarray  # (s, 13) consecutive outliers of each channel
    tally: np.ndarray  # (s, 13, 3) of decided rows: used, sum of NIS, refused
    resets: tuple
    was_known: bool
    left: np.ndarray  # (k,) TRACK smoothed, epochs decided when the cell before ended


class FixedLagSmoother:
    """See the module's text. ``sensors`` in the order of ROW's ``sensor``.

    ``correction`` makes of each epoch's predicted and updated state the one that is published; as
    `corrections.off`.
    """

    def __init__(
        self,
        sensors: Sequence[Sensor],
        settings: Settings,
        rule: gated.Rule = gated.BY_STATUS,
        correction: Callable = corrections.off,
    ):
        self.sensors, self.settings, self._correction = tuple(sensors), settings, correction
        self.model = models.build(sensors, settings.ins_bias_sigma_m, settings.ins_bias_tau_s)
        psd = np.repeat([settings.jerk_psd, settings.gust_psd], 2)
        if np.isfinite(settings.height_m):  # a target that keeps its height
            psd[[1, 3]] = 0.0
        self._space = Workspace(self.model, psd)
        self._rule, self._robust = rule, rule.kind == gated.STATUS
        prior = Prior(settings.height_m, settings.height_sigma_m)
        others = range(len(sensors)) if self._robust and len(sensors) > 1 else ()
        self._banks = [Bank(self._space, prior, excluded) for excluded in (-1, *others)]
        self._buffer = MeasurementBuffer(self.model.variance)
        self._length = np.zeros((len(sensors), len(CHANNELS)), np.int64)
        self._tally = np.zeros((len(sensors), len(CHANNELS), 3))
        self._boundary_ns = self._newest_ns = self._redecided_ns = self._closed_ns = LONG_AGO_NS
        self._fixed_ns = self._turn = 0
        self._was_known = True  # since the newest start
        self._lateness_ns = round(1e9 * settings.lateness_s)
        self._resets: tuple = ()
        self._densities = [np.zeros((0, 4))]
        self._marks: list[tuple[int, Moment]] = []
        self._smoothed: list[np.ndarray] = []
        self._told = gated.told(64, len(self.model.prior))
        self._snapshots = [self._snapshot(np.zeros(0, TRACK))]

    @property
    def _best(self):
        return self._banks[0].best

    def warm_up(self) -> None:
        """Compile everything, or fetch it from the cache, before the first measurement."""
        twin = FixedLagSmoother(self.sensors, self.settings, self._rule, self._correction)
        said = [(s, c) for s, sensor in enumerate(self.sensors) for c in np.flatnonzero(sensor.sigma > 0)]
        rows = np.zeros(6 * len(said), ROW)
        for k in range(len(rows)):
            s, c = said[k % len(said)]
            rows[k] = (k, k // len(said) * 300_000_000, s, c, 1.0, 0.0)
        twin.step(rows)
        twin.finish()
        twin.smooth()

    def step(self, rows: np.ndarray) -> Step:
        """Take in ``rows`` (n,) ROW, late ones too, and say what they bring."""
        refused = self._insert(rows)
        buffer, parts = self._buffer, []
        while buffer.done < buffer.size:
            t = buffer.rows.t[buffer.done : buffer.size]
            cell_ns = int(t[0]) // CELL_NS * CELL_NS
            if cell_ns > self._boundary_ns:
                self._close(cell_ns)
            parts += self._take(buffer.done + int(np.searchsorted(t, cell_ns + CELL_NS)))
        track = np.concatenate(parts) if parts else np.zeros(0, TRACK)
        return Step(track, self._take_smoothed(), np.concatenate([refused, buffer.changes()]))

    def finish(self) -> Step:
        """Decide what is left. No step may follow."""
        if self._best is not None:
            self._close(int(self._best.head.t_ns) + round(2e9 * self.settings.longest_lag_s))
        elif self._buffer.done > self._buffer.decided:
            self._buffer.void(self._buffer.decided, self._buffer.done)
        self._smoothed += [snapshot.left for snapshot in self._snapshots[1:]]
        self._snapshots = self._snapshots[-1:]
        self._buffer.final = self._buffer.size
        return Step(np.zeros(0, TRACK), self._take_smoothed(), self._buffer.changes())

    def report(self) -> dict:
        """Evidence so far, ready for JSON: NIS per channel, systematic errors, counts, resets."""
        head = self._best and self._best.head
        x, P = (head.x, head.P) if head else (np.zeros(0), np.zeros((0, 0)))
        log = [{"t_ns": anchor.t_ns, "reason": reason} for _, anchor, reason in self._resets[1:]]
        return report.report(self.sensors, self.model, x, P, self._tally, log)

    def smooth(self) -> np.ndarray:
        """Best estimate of trajectory (k,) TRACK: forward and backward over the flight, final weights."""
        buffer = self._buffer
        starts = {row: (mark, False) for row, mark in self._marks}
        starts |= {row: (anchor, True) for row, anchor, _ in self._resets}
        densities = np.concatenate(self._densities)
        parts = [self._track(*part) for part in tracks.smooth(self._space, buffer, starts, densities)]
        return np.concatenate([np.zeros(0, TRACK), *parts[::-1]])

    # ---- rows in

    def _insert(self, new: np.ndarray) -> np.ndarray:
        """Put the good ones of ``new`` in order; returns the verdicts (k,) VERDICT on the others."""
        fault = faults(new, self.model.variance, self._snapshots[0].boundary_ns)
        bad, buffer = fault != status.NONE, self._buffer
        good = new[~bad]
        if len(good) and buffer.done and good["t_ns"].min() <= buffer.rows.t[buffer.done - 1]:
            self._rewind(good["t_ns"].min())
        twice = buffer.insert(good, np.nan)
        why = np.concatenate([fault[bad], np.full(len(twice), status.TWICE)])
        return refusals(np.concatenate([new[bad], twice]), why)

    def _rewind(self, t_ns: int) -> None:
        """Go on from the last snapshot that knows nothing of ``t_ns``."""
        while self._snapshots[-1].boundary_ns > t_ns:
            self._snapshots.pop()
        to, buffer = self._snapshots[-1], self._buffer
        self._boundary_ns, buffer.done, buffer.decided = to.boundary_ns, to.done, to.decided
        self._redecided_ns, self._closed_ns = to.redecided_ns, to.closed_ns
        self._turn, self._resets, self._was_known = to.turn, to.resets, to.was_known
        self._banks = [bank.copy() for bank in to.banks]
        self._length, self._tally = to.length.copy(), to.tally.copy()

    def _snapshot(self, left: np.ndarray) -> Snapshot:
        """The present; ``left``: see there."""
        buffer = self._buffer
        return Snapshot(
            self._boundary_ns, buffer.done, buffer.decided, self._redecided_ns, self._closed_ns, self._turn,
            [bank.copy() for bank in self._banks], self._length.copy(), self._tally.copy(), self._resets,
            self._was_known, left,
        )  # fmt: skip

    # ---- within a cell

    def _take(self, end: int) -> list[np.ndarray]:
        """Take the rows up to ``end``, all of one cell, at first sight; their tracks."""
        buffer, parts = self._buffer, []
        before = int(
            np.searchsorted(buffer.rows.t[: buffer.done], buffer.rows.t[buffer.done] - start.TOGETHER_NS)
        )
        start.places(
            buffer.view(before, end), self.model.offset, self.model.rotation, self.model.is_ins,
            self.settings.height_m, buffer.done - before,
        )  # fmt: skip
        while buffer.done < end:
            new = buffer.view(buffer.done, end)
            self._forget_the_lost(int(new.t[0]))
            if self._best is None:
                self._wait(new)
                continue
            sparse = self._robust and buffer.done - buffer.decided < SPARSE_ROWS
            if sparse:
                new = Rows(*(column[: np.searchsorted(new.t, new.t[0], side="right")] for column in new))
            quiet_ns = self._redecided_ns + SURPRISE_NS if self._robust else NEVER_NS
            parts.append(self._admit(new, quiet_ns))
            surprised = self._best.surprise > gated.SURPRISE and self._best.head.t_ns >= quiet_ns
            if surprised or sparse:
                self._redecide(0)
        return parts

    def _wait(self, new: Rows) -> None:
        """Take one epoch without a state, and look whether the window now gives one."""
        buffer = self._buffer
        count = int(np.searchsorted(new.t, new.t[0], side="right"))
        buffer.done += count
        first = int(np.searchsorted(buffer.rows.t[: buffer.done], new.t[0] - self._lag_ns()))
        if first > buffer.decided:
            buffer.void(buffer.decided, first)
            buffer.decided = first
        dense = buffer.done - buffer.decided >= SPARSE_ROWS
        if dense and int(new.t[0]) - self._redecided_ns < SURPRISE_NS:
            return
        self._redecided_ns = int(new.t[0])
        self._begin(self._banks[0])

    def _begin(self, bank: Bank) -> None:
        """Try a first state from the window."""
        buffer = self._buffer
        if bank.begin(buffer.view(buffer.decided, buffer.done)):
            before = self._resets if self._was_known else self._resets[:-1]
            self._resets = (*before, (buffer.decided, bank.best.anchor.copy(), bank.reason))
            self._was_known = False

    def _forget_the_lost(self, t_ns: int) -> None:
        """Where a prediction knows no more than a start does, begin again: after a gap, or an outage of sorts."""
        main = self._banks[0]
        head = main.best and main.best.head
        if head and not tracks.known(self.model, head.x[None], head.P[None], LOST_FACTOR)[0]:
            main.best, main.reason = None, "known too poorly: begun again from the sensors"
        for bank in self._banks:
            if bank.best is None or t_ns - bank.best.head.t_ns < CELL_NS:
                continue
            dt, psd = (t_ns - bank.best.head.t_ns) * 1e-9, bank.best.usual_psd
            if psd[:2].max() * dt**3 / 3 + psd[2:].max() * dt < SPEED_LOST_MPS**2:
                continue
            if bank is self._banks[0]:
                bank.reason = f"nothing heard for {dt:.1f} s: begun again from the sensors"
                self._decide(self._buffer.done - self._buffer.decided)
            bank.best = None

    def _admit(self, new: Rows, quiet_ns: int) -> np.ndarray:
        """Every bank takes ``new`` rows up to a surprise, not before ``quiet_ns``; (k,) TRACK of the epochs."""
        if len(new.t) > len(self._told.t):
            self._told = gated.told(2 * len(new.t), len(self.model.prior))
        told, buffer = self._told, self._buffer
        count, k = self._best.admit(new, told, self._rule, quiet_ns)
        track = self._head_track(told, k)
        same = Rows(*(column[:count] for column in new))
        apart = []
        for bank in self._banks[1:]:
            if bank.best is not None:
                bank.best.admit(same, told, self._rule, NEVER_NS)
                apart.append((told.x[:k, :3].copy(), told.P[:k, :3, :3].copy()))
            else:
                apart.append(None)
        protection.enter(track, apart)
        buffer.done += count
        self._enter(0, buffer.done - buffer.decided)
        fresh = track["t_ns"] > self._newest_ns
        self._newest_ns = max(self._newest_ns, int(track["t_ns"][-1]))
        good = tracks.known(self.model, track["x"], track["P"])
        self._was_known |= bool(good.any())
        return track[fresh & good]

    def _head_track(self, told: gated.Told, k: int) -> np.ndarray:
        """(k,) TRACK of the newest epochs."""
        track = np.zeros(k, TRACK)
        for i in range(k):
            if told.fixed[i]:
                self._fixed_ns = int(told.t[i])
            track["fixed_ns"][i] = self._fixed_ns
            x = told.x[i, :CORE]
            track["x"][i] = self._correction(told.before_x[i], told.before_P[i], x, told.P[i])[:CORE]
        track["t_ns"], track["P"] = told.t[:k], told.P[:k] + self._banks[0].spread
        track["reset_counter"] = max(0, len(self._resets) - 1)
        track["ambiguous"] = self._banks[0].ambiguous
        return tracks.polished(track, self._shift(told.x[:k]))

    def _shift(self, x: np.ndarray) -> np.ndarray:
        return models.common_shift(self.model, x[:, self.model.clock_at], self._tally[..., 0].any(axis=1))

    # ---- the window

    def _lag_ns(self) -> int:
        """How long later rows may change a decision: some scans of the slowest sensor that is speaking."""
        s, buffer = self.settings, self._buffer
        begin = max(buffer.decided - 64, 0)
        t, sensor = buffer.rows.t[begin : buffer.done], buffer.rows.sensor[begin : buffer.done]
        longest = 0.0
        for k in range(len(self.sensors)):
            times = np.unique(t[sensor == k])[-6:]
            if len(times) > 1:
                longest = max(longest, float(np.median(np.diff(times))) * 1e-9)
        return round(1e9 * min(max(s.shortest_lag_s, s.lag_scans * longest), s.longest_lag_s))

    def _close(self, boundary_ns: int) -> None:
        """End the cell: decide again, move the anchors, take a snapshot."""
        buffer, left = self._buffer, np.zeros(0, TRACK)
        if self._best is None and self._banks[0].best is None and buffer.done > buffer.decided:
            pass
        if self._best is not None:
            lag_ns = self._lag_ns()
            every = max(1, round(lag_ns / CELLS_PER_LAG / CELL_NS))
            if boundary_ns - self._closed_ns >= every * CELL_NS or not self._robust:
                t = buffer.rows.t[buffer.decided : buffer.done]
                cut = int(np.searchsorted(t, boundary_ns - lag_ns))
                left = self._redecide(cut)
                self._closed_ns = boundary_ns
        self._boundary_ns = boundary_ns
        self._snapshots.append(self._snapshot(left))
        while len(self._snapshots) > 1 and self._snapshots[1].boundary_ns <= boundary_ns - self._lateness_ns:
            self._snapshots.pop(0)
            self._make_final(self._snapshots[0])

    def _redecide(self, cut: int) -> np.ndarray:
        """Settle all banks, then decide the first ``cut`` rows; their smoothed track (k,) TRACK."""
        buffer = self._buffer
        rows = buffer.view(buffer.decided, buffer.done)
        main = self._banks[0]
        self._redecided_ns = int(rows.t[-1]) if len(rows.t) else self._redecided_ns
        if cut:
            self._turn = (self._turn + 1) % CELLS_PER_LAG
        for bank in self._banks[1:] if cut and self._turn == 0 else ():
            if bank.best is None:
                bank.begin(rows)
            else:
                bank.redecide(rows, 0)
        found, started = (main.redecide if self._robust else main.watch)(rows, cut)
        if started:
            self._resets += ((buffer.decided, main.best.anchor.copy(), main.reason),)
        self._enter(0, len(rows.t))
        return self._decide(cut, found)

    def _enter(self, begin: int, end: int) -> None:
        """Write the incumbent's outcome of window rows into the buffer, with a verdict each."""
        buffer, own = self._buffer, self._best.own
        rows = buffer.view(buffer.decided + begin, buffer.decided + end)
        verdict, reason = np.zeros(end - begin, "i1"), np.zeros(end - begin, "i1")
        used = np.bincount(rows.sensor[own.weight[begin:end] > 0], minlength=len(self.sensors)) > 0
        status.label(rows, own.weight, self._length.copy(), used.sum() - used < 2, verdict, reason)
        buffer.judge(buffer.decided, own, verdict, reason)

    def _decide(self, cut: int, found=None) -> np.ndarray:
        """Decide the window's first ``cut`` rows for good."""
        buffer = self._buffer
        if not cut:
            return np.zeros(0, TRACK)
        rows = buffer.view(buffer.decided, buffer.done)
        left = np.zeros(0, TRACK)
        if found is None:
            found = (self._best.settle if self._robust else self._best.look)(rows, cut)
            self._enter(0, len(rows.t))
        first, out = epochs(rows.t[:cut]), self._space.trace
        left = self._track(rows.t[first], out.x[first].copy(), out.P[first].copy())
        self._count(rows, cut)
        label_rows = buffer.view(buffer.decided, buffer.decided + cut)
        scratch = np.zeros((2, cut), "i1")
        status.label(
            label_rows, self._best.own.weight[:cut], self._length, np.zeros(len(self.sensors), bool), *scratch
        )
        where = slice(buffer.decided, buffer.decided + cut)
        buffer.outcome.regime[where] += 2 * (len(self._densities) - 1)
        self._densities.append(self._best.densities())
        seconds = (int(rows.t[cut - 1]) - self._best.anchor.t_ns) * 1e-9
        for bank in self._banks:
            if bank.best is not None:
                bank.best.commit(rows, cut, found, seconds)
                bank.best.scale = self._best.scale if bank is not self._banks[0] else bank.best.scale
        buffer.decided += cut
        return left

    def _count(self, rows: Rows, cut: int) -> None:
        """Tally rows that are about to be decided for good."""
        own = self._best.own
        used, where = own.weight[:cut] >= status.DOUBT, (rows.sensor[:cut], rows.channel[:cut])
        np.add.at(self._tally[..., 0], where, used)
        np.add.at(self._tally[..., 1], where, np.where(used, own.nis[:cut], 0.0))
        np.add.at(self._tally[..., 2], where, ~used)

    def _make_final(self, oldest: Snapshot) -> None:
        """Nothing before the ``oldest`` snapshot changes any more."""
        self._buffer.final = oldest.decided
        self._smoothed.append(oldest.left)
        best = oldest.banks[0].best
        if best is None:
            return
        if not self._marks or best.anchor.t_ns >= self._marks[-1][1].t_ns + MARK_NS:
            self._marks.append((oldest.decided, best.anchor))

    # ---- what goes out

    def _track(self, t_ns: np.ndarray, x: np.ndarray, P: np.ndarray) -> np.ndarray:
        """(k,) TRACK of full states (k, n), (k, n, n), by the clocks as they are known now."""
        track = np.zeros(len(t_ns), TRACK)
        track["t_ns"], track["x"], track["P"] = t_ns, x[:, :CORE], P[:, :CORE, :CORE]
        track["reset_counter"] = max(0, len(self._resets) - 1)
        track["protection_h_m"] = track["protection_v_m"] = np.nan
        clocks = self._best.head.x[None] if self._best is not None else x[:1]
        return tracks.polished(track, self._shift(clocks))

    def _take_smoothed(self) -> np.ndarray:
        parts, self._smoothed = self._smoothed, []
        return np.concatenate(parts) if parts else np.zeros(0, TRACK)
