"""The estimator: rows in; track, smoothed track and verdicts out.

    rows ──► buffer ──► first sight, epoch by epoch ──► head: the state now
                at every look, and at a surprise: settle the window, challenge the incumbent ──► head again
                one lag later: decided, the anchor moves on
                ``lateness_s`` after that: final

Beside the incumbent over all sensors, one bank for each sensor goes on without it: what that sensor says is
judged by all others there, and the distance between the two states bounds the error that it can cause. Four
times a second that distance is told for each sensor.
Everything follows from the rows in order of time. A late row winds the estimator back to the snapshot before
it and goes on from there, so what is final does not depend on the order of arrival.
"""

from collections.abc import Callable, Sequence

import numpy as np

from filters.correction import correction as corrections
from filters.models import state as models
from filters.models.motion import CORE
from filters.models.rows import ROW, SEPARATION, TRACK, VERDICT, Sensor, Step, joined, rehearsal
from filters.models.settings import Settings
from filters.models.store import InMemory, Keep
from filters.smoother import gated, status, tracks
from filters.smoother.bank import FEW_ROWS, Bank
from filters.smoother.buffer import LONG_AGO_NS, MeasurementBuffer, Rows, faults, first_epoch, refusals
from filters.smoother.hypothesis import Workspace
from filters.smoother.integrity import protection, report
from filters.smoother.proposals import Prior
from filters.smoother.snapshots import Progress, Snapshots, Withdrawals, WrongClock, mark_type
from filters.smoother.window import Window

LOOK_NS = 250_000_000  # data time between two re-decisions at the shortest lag
LOOKS_PER_LAG = 4
CELL_NS = LOOK_NS // 2  # the incumbent and a bank without a sensor are looked at in different cells
SURPRISE_NS = 50_000_000  # re-decisions for a surprise are at least so far apart


class FixedLagSmoother:
    """See the module's text. ``sensors`` in the order of ROW's ``sensor``.

    ``correction`` makes of each epoch's predicted and updated state the one that is published; as
    `corrections.off`. ``keep`` makes the places for what is final.
    """

    def __init__(
        self,
        sensors: Sequence[Sensor],
        settings: Settings,
        rule: gated.Rule = gated.BY_STATUS,
        correction: Callable = corrections.off,
        keep: Keep = InMemory,
    ):
        self.sensors, self.settings, self._correction = tuple(sensors), settings, correction
        self.model = models.build(sensors, settings.ins_bias_sigma_m, settings.ins_bias_tau_s)
        if np.isfinite(settings.height_m):
            self.model = models.with_height(self.model, settings.height_sigma_m)
        self._shift_variance = models.common_variance(self.model)
        psd = np.repeat([settings.jerk_psd, settings.gust_psd], 2)
        if np.isfinite(settings.height_m):  # a target that keeps its height
            psd[[1, 3]] = 0.0
        self._keep = keep
        self._rule, self._robust = rule, rule.kind == gated.STATUS
        space, prior = Workspace(self.model, psd), Prior(settings.height_m, settings.height_sigma_m)
        others = range(len(sensors)) if self._robust and len(sensors) > 1 else ()
        progress = Progress([Bank(space, prior, excluded) for excluded in (-1, *others)], len(sensors))
        self._buffer = MeasurementBuffer(self.model.variance, keep)
        self._window = Window(space, self._buffer, progress, settings, keep, robust=self._robust)
        self._withdrawals = Withdrawals(self._window, settings.height_m)
        self._snapshots = Snapshots(progress, keep(mark_type(len(self.model.prior), len(sensors))))
        self._smoothed: list[np.ndarray] = []  # and final, not handed out yet
        self._separations: list[np.ndarray] = []  # not handed out yet
        self._separated_ns = LONG_AGO_NS  # begin of the newest LOOK_NS in which it was told
        self._states = gated.epoch_states(64, len(self.model.prior))
        self._newest_ns, self._fixed_ns = LONG_AGO_NS, 0

    @property
    def _now(self) -> Progress:
        return self._window.now

    def warm_up(self) -> None:
        """Compile everything, or fetch it from the cache, before the first measurement."""
        twin = FixedLagSmoother(self.sensors, self.settings, self._rule, self._correction)
        twin.step(rehearsal(self.sensors))
        twin.finish()
        twin.smooth()

    def step(self, rows: np.ndarray) -> Step:
        """Take in ``rows`` (n,) ROW, late ones too, and say what they bring."""
        refused = self._insert(rows)
        buffer, parts = self._buffer, []
        while buffer.done < buffer.size:
            t = buffer.view(buffer.done, buffer.size).t
            cell_ns = int(t[0]) // CELL_NS * CELL_NS
            self.rest(cell_ns)
            if cell_ns > self._now.boundary_ns:
                self._close(cell_ns)
            if not self._begun():
                self._window.forget_the_lost(cell_ns)
            parts += self._take(buffer.done + int(np.searchsorted(t, cell_ns + CELL_NS)))
        verdicts = joined([refused, buffer.changes()], VERDICT)
        apart, self._separations = joined(self._separations, SEPARATION), []
        return Step(joined(parts, TRACK), self._take_smoothed(), verdicts, apart)

    def rest(self, upto_ns: int) -> None:
        """Do now what is due before any row from ``upto_ns`` on; all those before it have been taken.

        It changes nothing but when that is done: `step` does it otherwise, and the newest state waits for it.
        """
        begin_ns = self._now.boundary_ns + CELL_NS
        dense = self._buffer.done - self._buffer.decided >= FEW_ROWS
        if dense and begin_ns <= upto_ns and self._begun():
            self._close(begin_ns)

    def take_back(self, sensor: int, wrong: WrongClock) -> None:
        """Forget what ``sensor`` has said since its clock went wrong; only where rows are judged again."""
        if self._robust:
            self._withdrawals.ask(sensor, wrong)

    def finish(self) -> Step:
        """Decide what is left. No step may follow."""
        if self._now.best is not None:
            self._close(int(self._now.best.head.t_ns) + round(2e9 * self.settings.longest_lag_s))
        else:
            self._window.give_up(self._buffer.done)
        self._smoothed += self._snapshots.end()
        self._buffer.final = self._buffer.size
        return Step(np.zeros(0, TRACK), self._take_smoothed(), self._buffer.changes())

    def report(self) -> dict:
        """Evidence so far, ready for JSON: NIS per channel, systematic errors, counts, resets."""
        head = self._now.best and self._now.best.head
        x, P = (head.x, head.P) if head else (np.zeros(0), np.zeros((0, 0)))
        log = [{"t_ns": reset.anchor.t_ns, "reason": reset.reason} for reset in self._now.resets[1:]]
        return report.report(self.sensors, self.model, x, P, self._now.tally, log)

    def smooth(self) -> np.ndarray:
        """Best estimate of trajectory (k,) TRACK: forward and backward over the flight, final weights."""
        begins = self._snapshots.begins(self._now.resets)
        densities = self._window.densities.read(0, len(self._window.densities))["psd"].copy()
        space, height_m = self._window.space, self.settings.height_m
        smoothed = tracks.smooth(space, self._buffer, begins, densities, height_m)
        best = self._keep(TRACK)
        for part in smoothed:  # the last first
            best.append(self._window.track(*part)[::-1])
        return best.whole()[::-1]

    # ---- rows in, tracks out

    def _insert(self, new: np.ndarray) -> np.ndarray:
        """Put the good ones of ``new`` in order; returns the verdicts (k,) VERDICT on the others."""
        fault = faults(new, self.model.variance, self._snapshots.oldest_ns)
        bad, buffer = fault != status.NONE, self._buffer
        good = new[~bad]
        if len(good) and good["t_ns"].min() < max(self._now.boundary_ns, self._buffer.newest_done_ns + 1):
            self._window.now = self._snapshots.rewind(good["t_ns"].min(), buffer)
            self._withdrawals.rewound()
        twice = buffer.insert(good, np.nan)
        why = np.concatenate([fault[bad], np.full(len(twice), status.TWICE)])
        return refusals(joined([new[bad], twice], ROW), why)

    def _take_smoothed(self) -> np.ndarray:
        parts, self._smoothed = self._smoothed, []
        return joined(parts, TRACK)

    # ---- within a cell

    def _begun(self) -> bool:
        """Whether there is a row in this cell."""
        return self._buffer.newest_done_ns >= self._now.boundary_ns

    def _take(self, end: int) -> list[np.ndarray]:
        """Take the rows up to ``end``, all of one cell, at first sight; their tracks."""
        buffer, now, parts = self._buffer, self._now, []
        self._window.place(end)
        while buffer.done < end:
            new = buffer.view(buffer.done, end)
            if now.best is None:
                self._wait(new)
                continue
            sparse = self._robust and buffer.done - buffer.decided < FEW_ROWS
            if sparse:
                new = Rows(*(column[: first_epoch(new)] for column in new))
            quiet_ns = now.redecided_ns + SURPRISE_NS if self._robust else gated.NEVER_NS
            parts.append(self._admit(new, quiet_ns, sparse=sparse))
        return parts

    def _wait(self, new: Rows) -> None:
        """Take one epoch without a state, and look whether the window now gives one."""
        buffer = self._buffer
        buffer.done += first_epoch(new)
        self._now.unknown += 1
        oldest_ns = new.t[0] - self._window.lag_ns()
        self._window.give_up(buffer.count_before(oldest_ns))
        dense = buffer.done - buffer.decided >= FEW_ROWS
        if not dense or int(new.t[0]) - self._now.redecided_ns >= SURPRISE_NS:
            self._now.redecided_ns = int(new.t[0])
            self._window.begin()

    def _admit(self, new: Rows, quiet_ns: int, *, sparse: bool) -> np.ndarray:
        """Every bank takes ``new`` rows up to a surprise, not before ``quiet_ns``; (k,) TRACK of them.

        After a surprise, and where rows are ``sparse``, the state of the newest one is that decided again.
        """
        if len(new.t) > len(self._states.t):
            self._states = gated.epoch_states(2 * len(new.t), len(self.model.prior))
        states, now = self._states, self._now
        count, k = now.best.admit(new, states, self._rule, quiet_ns)
        track = self._head_track(states, k)
        same = Rows(*(column[:count] for column in new))
        now.banks[0].admit_alternative(same, states, self._rule)
        without = [self._admit_without(bank, same, k) for bank in now.banks[1:]]
        self._buffer.done += count
        self._window.enter()
        if sparse or (now.best.surprise > gated.SURPRISE and now.best.head.t_ns >= quiet_ns):
            self._window.redecide(0)
            states.x[k - 1], states.P[k - 1] = now.best.head.x, now.best.head.P[:CORE, :CORE]
            track[-1:] = self._head_track(gated.EpochStates(*(part[k - 1 : k] for part in states)), 1)
        elsewhere = protection.enter(track, without)
        self._window.note_contradictions(track, elsewhere)
        fresh = track["t_ns"] > self._newest_ns
        self._newest_ns = max(self._newest_ns, int(track["t_ns"][-1]))
        good = tracks.known(self.model, track["x"], track["P"])
        self._window.note_known(track, good)
        self._report_separation(track, fresh & good, without)
        return track[fresh & good]

    def _admit_without(self, bank: Bank, rows: Rows, k: int) -> tuple[np.ndarray, np.ndarray] | None:
        """One of the banks without a sensor takes ``rows`` of ``k`` epochs.

        Returns its states (k, n) by the clocks of its own, as they would be published, with covariances
        (k, 9, 9); None without a state.
        """
        if bank.best is None:
            return None
        states = self._states
        bank.admit_alternative(rows, states, self._rule)
        bank.best.admit(rows, states, self._rule, gated.NEVER_NS)
        x, P = states.x[:k].copy(), states.P[:k].copy()
        tracks.by_own_clocks(x, P, self._window.shift_s(x, bank.excluded), self._shift_variance)
        return x, P

    def _report_separation(self, track: np.ndarray, published: np.ndarray, without: list) -> None:
        """Once in LOOK_NS: how far a state that is ``published`` would move without each of the sensors.

        ``without`` has `_admit_without` of each.
        """
        if not published.any():
            return
        at = int(np.argmax(published))
        cell_ns = int(track["t_ns"][at]) // LOOK_NS * LOOK_NS
        if cell_ns <= self._separated_ns:
            return
        self._separated_ns = cell_ns
        for sensor, one in enumerate(without):
            if one is None or not self._now.tally[sensor].any():  # nobody there who could be left out
                continue
            x, P = (part[at : at + 1] for part in one)
            if tracks.known(self.model, x, P)[0]:
                apart = protection.separation(track[at : at + 1], sensor, x, P)
                self._separations.append(apart)

    def _head_track(self, states: gated.EpochStates, k: int) -> np.ndarray:
        """(k,) TRACK of the newest epochs."""
        track, bank = np.zeros(k, TRACK), self._now.banks[0]
        for i in range(k):
            if states.fixed[i]:
                self._fixed_ns = int(states.t[i])
            track["fixed_ns"][i] = self._fixed_ns
            x = states.x[i, :CORE]
            track["x"][i] = self._correction(states.before_x[i], states.before_P[i], x, states.P[i])[:CORE]
        track["t_ns"], track["P"] = states.t[:k], states.P[:k] + bank.spread
        track["reset_counter"], track["ambiguous"] = self._now.reset_counter, bank.ambiguous(track["t_ns"])
        return tracks.polished(track, self._window.shift_s(states.x[:k]), self._shift_variance)

    # ---- at its end

    def _close(self, boundary_ns: int) -> None:
        """End the cell: decide again, move the anchors, take a snapshot."""
        buffer, now, left = self._buffer, self._now, np.zeros(0, TRACK)
        self._withdrawals.step(boundary_ns)
        if now.best is not None:
            lag_ns, since_ns = self._window.lag_ns(), boundary_ns - now.closed_ns
            every_ns = max(LOOK_NS, lag_ns // LOOKS_PER_LAG) if self._robust else LOOK_NS
            if not now.turned and since_ns >= every_ns // 2:
                self._window.take_turn()
            if since_ns >= every_ns:
                t = buffer.view(buffer.decided, buffer.done).t
                left = self._window.redecide(int(np.searchsorted(t, boundary_ns - lag_ns)))
                now.closed_ns, now.turned = boundary_ns, False
        now.boundary_ns = boundary_ns
        self._snapshots.take(now, buffer, left)
        for oldest in self._snapshots.expire(boundary_ns - round(1e9 * self.settings.lateness_s)):
            buffer.final = oldest.decided
            self._smoothed.append(oldest.left)
