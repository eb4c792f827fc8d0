"""The window: rows that have been seen, and are judged again until they are decided.

decided ──► the window's rows, each judged by all others ──► done
anchor      │◄──────── some scans of the slowest sensor ────────►│
"""

import math

import numpy as np

from filters.models import state as models
from filters.models import theodolite
from filters.models.motion import CORE, MOTIONS
from filters.models.rows import TRACK
from filters.models.settings import Settings
from filters.models.store import InMemory, Keep
from filters.smoother import gated, passes, proposals, status, tracks
from filters.smoother.bank import PROOF_NS, Bank
from filters.smoother.buffer import MeasurementBuffer, Rows, epochs, scan_ns
from filters.smoother.hypothesis import Workspace
from filters.smoother.snapshots import Progress, Reset

SPEED_LOST_MPS = proposals.SPEED_SIGMA_MPS  # a prediction that knows less than a start does is a start
LOST_FACTOR = 5.0  # of what may be published: beyond, rows are better taken for a start
SILENCE_NS = 250_000_000  # since the newest row, from which a gap may be one
TURNS = 4  # looks until each of the banks without a sensor has had its own
RECENT_ROWS = 64  # before the window, that tell the scans of its sensors


def density_type(states: int) -> np.dtype:
    """As which the densities of a window are stored, see `motion.densities`."""
    return np.dtype([("psd", "f8", (states - CORE + MOTIONS,))])


class Window:
    """See the module's text. ``robust``: rows are judged again; other methods stay with their first sight."""

    def __init__(
        self,
        space: Workspace,
        buffer: MeasurementBuffer,
        progress: Progress,
        settings: Settings,
        keep: Keep = InMemory,
        *,
        robust: bool,
    ):
        self.space, self.buffer, self.now, self.robust = space, buffer, progress, robust
        self._settings = settings
        self._floating = models.floating(space.model)
        self.densities = keep(density_type(len(space.model.prior)))  # of every window that was decided

    def lag_ns(self) -> int:
        """How long later rows may change a decision: some scans of the slowest sensor that is speaking."""
        settings, buffer = self._settings, self.buffer
        longest = scan_ns(buffer.view(max(buffer.decided - RECENT_ROWS, 0), buffer.done)) * 1e-9
        lag_s = max(settings.shortest_lag_s, settings.lag_scans * longest)
        return round(1e9 * min(lag_s, settings.longest_lag_s))

    # ---- a state begins and ends

    def begin(self) -> None:
        """Try a first state from the window."""
        buffer, now = self.buffer, self.now
        bank = now.banks[0]
        if bank.begin(buffer.view(buffer.decided, buffer.done)):
            before = now.resets if now.was_known else now.resets[:-1]
            now.resets = (*before, Reset(buffer.decided, bank.best.anchor.copy(), bank.reason))
            now.was_known = False

    def give_up(self, before: int) -> None:
        """Rows up to ``before`` come too early to be judged by any state."""
        if before > self.buffer.decided:
            self.buffer.void(self.buffer.decided, before)
            self.buffer.decided = before

    def forget_the_lost(self, t_ns: int) -> None:
        """Where a prediction knows no more than a start does, begin again: after a gap, or an outage."""
        main = self.now.banks[0]
        head = main.best and main.best.head
        if head and not tracks.known(self.space.model, head.x[None], head.P[None], LOST_FACTOR)[0]:
            main.forget()
            main.reason = "known too poorly: begun again from the sensors"
        for bank in self.now.banks:
            if bank.best is not None and self._silent_too_long(bank, t_ns):
                if bank is main:
                    dt = (t_ns - bank.best.head.t_ns) * 1e-9
                    bank.reason = f"nothing heard for {dt:.1f} s: begun again from the sensors"
                    self._decide(self.buffer.done - self.buffer.decided)
                bank.forget()
        if main.best is None:  # the others go on only beside it: their windows are the same rows
            for bank in self.now.banks[1:]:
                bank.forget()

    def _silent_too_long(self, bank: Bank, t_ns: int) -> bool:
        gap_ns, psd = t_ns - bank.best.head.t_ns, bank.best.usual_psd
        dt = gap_ns * 1e-9
        lost = psd[:2].max() * dt**3 / 3 + psd[2:].max() * dt >= SPEED_LOST_MPS**2
        return bool(gap_ns >= SILENCE_NS and lost)

    # ---- rows are judged

    def place(self, end: int) -> None:
        """Enter the places that the new rows up to ``end`` stand for."""
        buffer, model = self.buffer, self.space.model
        before = buffer.count_before(buffer.view(buffer.done, end).t[0] - theodolite.TOGETHER_NS)
        theodolite.places(
            buffer.view(before, end), model.offset, model.rotation, model.is_ins, self._settings.height_m,
            buffer.done - before,
        )  # fmt: skip

    def enter(self) -> None:
        """Write what the incumbent makes of the window's rows into the buffer, with a verdict each."""
        buffer, own = self.buffer, self.now.best.own
        rows = buffer.view(buffer.decided, buffer.done)
        verdict, reason = np.empty((2, len(rows.t)), "i1")
        alone = np.empty(len(self.now.length), bool)
        status.alone(rows, own.weight, alone)
        status.label(rows, own.weight, self.now.length.copy(), alone, verdict, reason)
        buffer.judge(buffer.decided, own, verdict, reason)

    def redecide(self, cut: int) -> np.ndarray:
        """Settle the window, then decide its first ``cut`` rows; their smoothed track (k,) TRACK.

        While two explanations of the window are close nothing is decided, for PROOF_NS or the lag at most:
        later rows may tell which is right.
        """
        buffer, now = self.buffer, self.now
        rows, main = buffer.view(buffer.decided, buffer.done), now.banks[0]
        now.redecided_ns = int(rows.t[-1]) if len(rows.t) else now.redecided_ns
        if self.robust:
            without = [bank.best for bank in now.banks[1:] if bank.best is not None]
            found = main.redecide(rows, cut, without)
        else:
            found = main.watch(rows, cut)
        self._note_start()
        self.enter()
        if cut and main.undecided and rows.t[cut - 1] - rows.t[0] < max(PROOF_NS, self.lag_ns()):
            return np.zeros(0, TRACK)
        return self._commit(rows, cut, found)

    def _note_start(self) -> None:
        """Enter the incumbent's start as a reset, instead of others that have decided nothing either."""
        now, bank, decided = self.now, self.now.banks[0], self.buffer.decided
        now.resets = tuple(reset for reset in now.resets if reset.row < decided)
        if bank.best.young:
            now.resets += (Reset(decided, bank.best.anchor.copy(), bank.reason),)

    def take_turn(self) -> None:
        """One of the banks without a sensor looks at the window; of more than TURNS a part.

        Who has waited longest; a surprise counts as much as a whole round of waiting.
        """
        now, others = self.now, self.now.banks[1:]
        rows = self.buffer.view(self.buffer.decided, self.buffer.done)
        now.turn, now.turned = now.turn + 1, True
        waits = [now.turn - looked for looked in now.looked]
        for k, bank in enumerate(others):
            if bank.best is not None and bank.best.surprise > gated.SURPRISE:
                waits[k] += len(others)
        for k in sorted(range(len(others)), key=lambda k: -waits[k])[: math.ceil(len(others) / TURNS)]:
            now.looked = (*now.looked[:k], now.turn, *now.looked[k + 1 :])
            if others[k].best is None:
                others[k].begin(rows, now.best.own.weight)
            else:
                others[k].redecide(rows, 0, (now.best,))

    def _decide(self, cut: int) -> None:
        """Settle the incumbent, and decide the first ``cut`` rows."""
        if cut:
            rows, best = self.buffer.view(self.buffer.decided, self.buffer.done), self.now.best
            found = (best.settle if self.robust else best.look)(rows, cut)
            self.enter()
            self._commit(rows, cut, found)

    def _commit(self, rows: Rows, cut: int, found: passes.Scores) -> np.ndarray:
        """Decide the window's first ``cut`` ``rows`` for good; their smoothed track."""
        if not cut:
            return np.zeros(0, TRACK)
        buffer, now = self.buffer, self.now
        first, out = epochs(rows.t[:cut]), self.space.trace
        left = self.track(rows.t[first], out.x[first].copy(), out.P[first].copy())
        self._count(rows, cut)
        made = buffer.made(buffer.decided, buffer.decided + cut)
        made.regime[:] += len(self.densities)
        self.densities.append(now.best.densities().view(density_type(len(now.best.anchor.x)))[:, 0])
        seconds = (int(rows.t[cut - 1]) - now.best.anchor.t_ns) * 1e-9
        now.banks[0].commit(rows, cut, found, seconds)
        for bank in now.banks[1:]:
            if bank.best is not None:
                bank.commit(rows, cut, found, seconds, now.best.scale)
        buffer.decided += cut
        return left

    def _count(self, rows: Rows, cut: int) -> None:
        """Tally rows that are about to be decided for good, and go on with the runs of outliers in them."""
        now, own = self.now, self.now.best.own
        used, where = own.weight[:cut] >= status.DOUBT, (rows.sensor[:cut], rows.channel[:cut])
        np.add.at(now.tally[..., 0], where, used)
        np.add.at(now.tally[..., 1], where, np.where(used, np.nan_to_num(own.nis[:cut]), 0.0))
        np.add.at(now.tally[..., 2], where, ~used)
        decided, unread = Rows(*(column[:cut] for column in rows)), np.zeros((2, cut), "i1")
        status.label(decided, own.weight[:cut], now.length, np.zeros(len(now.length), bool), *unread)

    # ---- what goes out

    def note_contradictions(self, track: np.ndarray, elsewhere: np.ndarray) -> None:
        """Doubt a ``track`` (k,) TRACK that would be ``elsewhere`` (k,) bool without some sensor."""
        if elsewhere.any():
            bank, rows = self.now.banks[0], self.buffer.view(self.buffer.decided, self.buffer.done)
            for t_ns in track["t_ns"][elsewhere].tolist():
                bank.note_contradiction(rows, t_ns)
            self._doubt(track)

    def _doubt(self, track: np.ndarray) -> None:
        """Flag ``track`` (k,) TRACK, made before the incumbent's doubt was noted, in place."""
        track["ambiguous"] |= self.now.banks[0].ambiguous(track["t_ns"])
        tracks.doubted(track)

    def note_known(self, track: np.ndarray, good: np.ndarray) -> None:
        """A state known again, in ``track`` where it is ``good``, is put to the proof as a start is."""
        now, bank = self.now, self.now.banks[0]
        if not good.any():
            now.unknown += len(track)
            return
        if now.unknown:
            bank.put_to_the_proof(self.buffer.view(self.buffer.decided, self.buffer.done), now.unknown)
            self._doubt(track)
        now.was_known, now.unknown = True, len(track) - 1 - int(np.flatnonzero(good)[-1])

    def track(self, t_ns: np.ndarray, x: np.ndarray, P: np.ndarray) -> np.ndarray:
        """(k,) TRACK of full states (k, n), (k, n, n) that are known well enough, by their own clocks."""
        good = tracks.known(self.space.model, x, P)
        t_ns, x, P = t_ns[good], x[good], P[good]
        track = np.zeros(len(t_ns), TRACK)
        track["t_ns"], track["x"], track["P"] = t_ns, x[:, :CORE], P[:, :CORE, :CORE]
        track["reset_counter"] = self.now.reset_counter
        track["ambiguous"] = self.now.banks[0].unproven(t_ns)
        track["protection_h_m"] = track["protection_v_m"] = np.nan
        return tracks.polished(track, self.shift_s(x), models.common_variance(self.space.model))

    def shift_s(self, x: np.ndarray, excluded: int = -1) -> np.ndarray:
        """(k,) of the time that most clocks agree on, by states (k, n) that know nothing of ``excluded``."""
        if not self._floating:
            return np.zeros(len(x))
        model, heard = self.space.model, self.now.tally[..., 0].any(axis=1)
        heard &= np.arange(len(heard)) != excluded
        return models.common_shift(model, x[:, model.clock_at], heard)
