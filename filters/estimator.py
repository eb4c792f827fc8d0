"""The estimator: rows in; track, smoothed track and verdicts out.

    rows ──► first decision, epoch by epoch ──► head: the state now
                 every ``cell_s`` of data time: re-decide the window ──► head again, from the re-decided rows
                 ``horizon_s`` later: decided, the anchor moves on
                 ``lateness_s`` after that: final

Everything follows from the rows in order of time. A late row winds the estimator back to the snapshot before
it and goes on from there, so what is final does not depend on the order of arrival.
"""

from collections.abc import Callable, Sequence
from typing import NamedTuple

import numpy as np

from filters import correction as corrections
from filters import decide, ins, m1, motion, noise, outlier, rivals, slide, start
from filters import model as models
from filters import report as reports
from filters import window as windows
from filters.motion import CORE
from filters.rows import (
    AE,
    CHANNELS,
    DUPLICATE,
    INVALID,
    LATE,
    ROW,
    TRACK,
    VERDICT,
    Sensor,
    Step,
)  # fmt: skip


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
    said: np.ndarray  # weight as published


JUDGED = (
    "noise",
    "jerk",
    "weight",
    "off",
    "predicted",
    "sigma",
    "nis",
    "verdict",
    "reason",
)  # columns that a rewind restores


def room(n: int) -> Rows:
    """Empty rows, ``n`` of them."""
    types = ["i8", "i8", "i2", "i1", "f8", "f8", "f8", "f8", "f8", "f8", "f8", "f8", "i1", "i1", "i1", "f8"]
    return Rows(*(np.zeros(n, t) for t in types))


class Moment(NamedTuple):
    """A state with its time, and each channel's run of outliers up to then."""

    t_ns: int
    x: np.ndarray  # (n,)
    P: np.ndarray  # (n, n)
    run: np.ndarray  # (s, 13, 2), see outlier.label

    def copy(self) -> "Moment":
        return Moment(self.t_ns, self.x.copy(), self.P.copy(), self.run.copy())


class Reset(NamedTuple):
    """A new beginning, because nothing fitted the old state."""

    row: int  # the first one filtered from here
    anchor: Moment
    counted: bool  # the search for the first state is no reset
    reason: str


class Snapshot(NamedTuple):
    """All that is needed to go on from the beginning of a cell."""

    boundary_ns: int
    size: int  # rows before the boundary
    decided: int  # rows decided
    anchor: Moment | None  # after the decided rows
    head: Moment | None  # after all rows
    judged: tuple[np.ndarray, ...]  # JUDGED of the rows between
    tally: np.ndarray  # (s, 13, 3) of decided rows: used, sum of NIS, refused
    scale: np.ndarray  # (2, s, 13) each channel's last decided residual, and its noise in stated sigmas
    jerk: float  # density of the white jerk now
    resets: tuple[Reset, ...]
    left: np.ndarray  # (k,) TRACK smoothed, epochs decided when the cell before ended


LONG_AGO_NS = np.iinfo(np.int64).min // 2
MARK_NS = 1_000_000_000
HALF_QUALITY_M = 10.0  # position 1-sigma at which quality is 50
DEEP = 3  # every so many re-decisions hear the costly rivals too
YOUNG_NS = 5_000_000_000  # so long the first fix itself may be doubted, for one channel's sake too
WITNESSES = 2  # other sensors that it takes to call a run wrong
START_NS = 1_000_000_000  # rows so far apart may still make a fix together
METHODS = {
    "default": {},
    "ukf": {"hard": np.inf, "soft": np.inf, "horizon_s": 0.0},
    "gate": {"hard": 4.0, "soft": 4.0, "horizon_s": 0.0},
    "igg": {"hard": 8.5, "soft": 1.5, "horizon_s": 0.0},
    "ga-bp-ukf": {"hard": m1.NOTHING, "soft": m1.C, "horizon_s": 0.0},
}
HANDLING = {"ga-bp-ukf": (m1.admit, m1.label)}  # how fresh rows are decided and named; else the default


def make(
    method: str,
    sensors: Sequence[Sensor],
    settings: Settings | None = None,
    correction: Callable = corrections.off,
) -> "Estimator":
    """An estimator by name, which overrides some ``settings``. Raises ValueError for an unknown one."""
    if method not in METHODS:
        raise ValueError(f"unknown method {method!r}; choose one of {', '.join(METHODS)}")
    handling = HANDLING.get(method, (decide.admit, outlier.label))
    return Estimator(sensors, (settings or Settings())._replace(**METHODS[method]), handling, correction)


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
        self._admit, self._label = handling
        self._correction = correction
        self.model = models.build(
            sensors, settings.jerk_psd, settings.ins_bias_sigma_m, settings.ins_bias_tau_s
        )
        n = len(self.model.prior)
        self._cell_ns, self._horizon_ns, self._lateness_ns = (
            round(1e9 * s) for s in (settings.cell_s, settings.horizon_s, settings.lateness_s)
        )
        self._rows, self._size, self._done, self._final = room(4096), 0, 0, 0
        self._out, self._spare = windows.trace(1024, n, 1), windows.trace(1024, n, 1)
        self._work = models.scratch(n)
        self._r, self._N = np.zeros(n), np.zeros((n, n))
        self._recent = np.zeros((len(sensors), len(CHANNELS), 3))
        self._newest_ns, self._fixed_ns, self._told, self._marks = LONG_AGO_NS, 0, 0, []
        self._nobody = np.zeros(len(sensors), bool)
        tally = np.zeros((len(sensors), len(CHANNELS), 3))
        scale = np.stack([np.zeros((len(sensors), len(CHANNELS))), np.ones((len(sensors), len(CHANNELS)))])
        blank = Snapshot(
            LONG_AGO_NS, 0, 0, None, None, (), tally, scale, settings.jerk_psd, (), np.zeros(0, TRACK)
        )
        self._snapshots, self._smoothed = [blank], []
        self._rewind(blank)

    def warm_up(self) -> None:
        """Compile everything, or fetch it from the cache, before the first measurement."""
        twin = Estimator(self.sensors, self.settings, (self._admit, self._label), self._correction)
        said = [(s, c) for s, sensor in enumerate(self.sensors) for c in np.flatnonzero(sensor.sigma > 0)]
        rows = np.zeros(2 * len(said), ROW)
        for k, (s, c) in enumerate(said + said):
            rows[k] = (k, 0 if k < len(said) else 2 * 10**9, s, c, 1.0)
        twin.step(rows)
        twin._price(0, 1)
        twin.finish()
        twin.smooth()

    def step(self, rows: np.ndarray) -> Step:
        """Take in ``rows`` (n,) ROW, late ones too, and say what they bring."""
        refused = self._insert(rows)
        begin = self._done if self._head else 0  # before the start, rows wait and are gone through again
        room = len(np.unique(self._rows.t[begin : self._size]))
        track, clocks, count = np.zeros(room, TRACK), np.zeros((room, len(self.sensors))), 0
        while self._done < self._size:
            if self._epoch() and self._head.t_ns > self._newest_ns:
                self._newest_ns = self._head.t_ns
                head, out = self._head, self._out
                x = self._correction(out.x[0], out.P[0], head.x, head.P)
                track["t_ns"][count], track["fixed_ns"][count] = head.t_ns, self._fixed_ns
                track["x"][count], track["P"][count] = x[:CORE], head.P[:CORE, :CORE]
                track["reset_counter"][count] = self._counted
                clocks[count] = x[self.model.clock_at]
                count += 1
        track = self._polished(track[:count], models.common_shift(self.model, clocks[:count]))
        return Step(track, self._take_smoothed(), np.concatenate([refused, self._changed()]))

    def finish(self) -> Step:
        """Decide what is left. No step may follow."""
        if self._head is not None:
            self._close(self._head.t_ns + self._horizon_ns + 1)
        self._snapshots = self._snapshots[-1:]
        self._final = self._size
        return Step(np.zeros(0, TRACK), self._take_smoothed(), self._changed())

    # ---- rows in

    def _insert(self, new: np.ndarray) -> np.ndarray:
        """Put the good ones of ``new`` in order; returns the verdicts (k,) VERDICT on the others."""
        known = (new["sensor"] >= 0) & (new["sensor"] < len(self.sensors))
        known[known] = np.isfinite(self.model.variance[new["sensor"][known], new["channel"][known]])
        finite = np.isfinite(new["value"])
        in_time = new["t_ns"] >= self._snapshots[0].boundary_ns
        reason = np.select(
            [~known, ~finite, ~in_time],
            [outlier.NO_CHANNEL, outlier.NOT_FINITE, outlier.TOO_OLD],
            outlier.NONE,
        )
        good = new[reason == outlier.NONE]
        if len(good) and self._done and good["t_ns"].min() <= self._rows.t[self._done - 1]:
            first = good["t_ns"].min()
            while self._snapshots[-1].boundary_ns > first:
                self._snapshots.pop()
            self._rewind(self._snapshots[-1])
        twice = self._merge(good)
        refused = np.concatenate([new[reason != outlier.NONE], twice])
        reason = np.concatenate([reason[reason != outlier.NONE], np.full(len(twice), outlier.TWICE)])
        out = np.zeros(len(refused), VERDICT)
        out["id"], out["reason"], out["final"] = refused["id"], reason, True
        out["predicted"] = out["sigma"] = np.nan
        out["verdict"] = np.select(
            [reason == outlier.TWICE, reason == outlier.TOO_OLD], [DUPLICATE, LATE], INVALID
        )
        return out

    def _merge(self, good: np.ndarray) -> np.ndarray:
        """Sort ``good`` in among the rows not yet done; returns those that were there already."""
        size = self._size + len(good)
        while size > len(self._rows.t):
            self._rows = Rows(*(np.concatenate([c, np.zeros_like(c)]) for c in self._rows))
        new = slice(self._size, size)
        for name, field in (
            ("id", "id"),
            ("t", "t_ns"),
            ("sensor", "sensor"),
            ("channel", "channel"),
            ("value", "value"),
        ):
            getattr(self._rows, name)[new] = good[field]
        self._rows.told[new] = -1
        tail = slice(self._done, size)
        t, sensor, channel = (getattr(self._rows, name)[tail] for name in ("t", "sensor", "channel"))
        order = np.lexsort((channel, sensor, t))
        t, sensor, channel = t[order], sensor[order], channel[order]
        same = np.zeros(len(order), bool)
        same[1:] = (t[1:] == t[:-1]) & (sensor[1:] == sensor[:-1]) & (channel[1:] == channel[:-1])
        twice = np.zeros(same.sum(), ROW)
        twice["id"] = self._rows.id[tail][order[same]]
        order = order[~same]
        self._size = self._done + len(order)
        for column in self._rows:
            column[self._done : self._size] = column[tail][order]
        return twice

    def _rewind(self, to: Snapshot) -> None:
        """Go on from a snapshot."""
        self._boundary_ns, self._done, self._decided = to.boundary_ns, to.size, to.decided
        self._anchor = to.anchor and to.anchor.copy()
        self._head = to.head and to.head.copy()
        for name, column in zip(JUDGED, to.judged, strict=False):
            getattr(self._rows, name)[to.decided : to.size] = column
        self._tally, self._scale = to.tally.copy(), to.scale.copy()
        self._variance = noise.effective(self.model.variance, self._scale[1])
        self._jerk, self._resets = to.jerk, to.resets
        self._watch()

    # ---- one epoch, one cell

    def _epoch(self) -> bool:
        """Take the next epoch's rows into the head; False while there is no state."""
        begin, rows = self._done, self._rows
        t_ns = rows.t[begin]
        end = begin + int(np.searchsorted(rows.t[begin : self._size], t_ns, side="right"))
        if self._head is None:
            return self._begin(end)
        cell_ns = t_ns // self._cell_ns * self._cell_ns
        if cell_ns > self._boundary_ns:
            self._close(cell_ns)
        head, s = self._head, self.settings
        fixed = self._admit(
            self.model,
            rows,
            begin,
            end,
            head.x,
            head.P,
            head.t_ns,
            self._jerk,
            self._variance,
            head.run,
            s.soft,
            s.hard,
            self._watched,
            self._out,
            self._work,
        )
        self._label(
            rows.sensor,
            rows.channel,
            rows.weight,
            rows.off,
            rows.verdict,
            rows.reason,
            begin,
            end,
            head.run,
            self._nobody,
        )
        self._head = head._replace(t_ns=int(t_ns))
        self._fixed_ns = int(t_ns) if fixed else self._fixed_ns
        self._done = end
        if s.horizon_s > 0 and (rows.weight[begin:end] == 0.0).any():
            self._doubt_motion(end)
        return True

    def _doubt_motion(self, end: int) -> None:
        """Decide again at once, where what was just refused may be a jolt."""
        if not self._young() and rivals.jolt(self._rows, self._decided, end) < end:
            self._redecide(self._decided, end, 0)

    def _young(self) -> bool:
        """Whether the first fix itself may still be what is wrong."""
        return self._anchor.t_ns < self._marks[0][1].t_ns + YOUNG_NS

    def _begin(self, end: int) -> bool:
        """Start from the first fix that the last second's rows give; older rows get no state."""
        rows = self._rows
        first = int(np.searchsorted(rows.t[:end], rows.t[end - 1] - START_NS))
        fixes = start.fixes(
            self.model, rows.sensor[first:end], rows.channel[first:end], rows.value[first:end]
        )
        self._decided = first
        rows.verdict[:first], rows.reason[:first], rows.weight[:first] = INVALID, outlier.NO_STATE, 0.0
        self._done = first if fixes else end
        if fixes:
            x, P = start.state(self.model, *fixes[0])
            self._anchor = Moment(int(rows.t[first]), x, P, np.zeros((len(self.sensors), len(CHANNELS), 2)))
            self._head = self._anchor.copy()
            self._marks = [(first, self._anchor.copy())]
            self._boundary_ns = rows.t[first] // self._cell_ns * self._cell_ns
        return False

    def _close(self, boundary_ns: int) -> None:
        """End the cell: decide again, move the anchor, take a snapshot."""
        rows, begin, end, s = self._rows, self._decided, self._done, self.settings
        cut = begin + int(np.searchsorted(rows.t[begin:end], boundary_ns - self._horizon_ns))
        if s.horizon_s > 0:
            self._redecide(begin, end, cut - begin)
        left = self._leave(begin, cut)
        self._boundary_ns, self._decided = boundary_ns, cut
        self._variance = noise.effective(self.model.variance, self._scale[1])
        self._watch()
        judged = tuple(getattr(rows, name)[cut:end].copy() for name in JUDGED)
        self._snapshots.append(
            Snapshot(
                boundary_ns,
                end,
                cut,
                self._anchor.copy(),
                self._head.copy(),
                judged,
                self._tally.copy(),
                self._scale.copy(),
                self._jerk,
                self._resets,
                left,
            )
        )
        while len(self._snapshots) > 1 and self._snapshots[1].boundary_ns <= boundary_ns - self._lateness_ns:
            self._snapshots.pop(0)
            self._smoothed.append(self._snapshots[0].left)
            self._final = self._snapshots[0].decided
            self._mark(self._snapshots[0])

    def _watch(self) -> None:
        """Note which sensors have others beside them in the window, where it can be decided again."""
        used = self._used(self._decided, self._done)
        self._watched = (used.sum() > used) & (self.settings.horizon_s > 0)

    def _used(self, begin: int, end: int) -> np.ndarray:
        """(s,) bool, which sensors have rows in use."""
        sensor = self._rows.sensor[begin:end][self._rows.weight[begin:end] > 0]
        return np.bincount(sensor, minlength=len(self.sensors)) > 0

    def _mark(self, snapshot: Snapshot) -> None:
        """Remember about every second where `smooth` can start its way ahead."""
        if snapshot.anchor.t_ns >= self._marks[-1][1].t_ns + MARK_NS:
            self._marks.append((snapshot.decided, snapshot.anchor))

    def _redecide(self, begin: int, end: int, keep: int) -> None:
        """Weigh all rows of the window again, hear the rivals, take the best story; the head follows.

        States are smoothed for the first ``keep`` rows: those that leave the window now.
        """
        rows = self._rows
        if end - begin > len(self._out.v):
            self._out, self._spare = (
                windows.trace(2 * (end - begin), len(self._head.x), 1) for _ in range(2)
            )
        self._out, self._spare = (windows.keeping(out, keep) for out in (self._out, self._spare))
        for s in np.flatnonzero(self.model.is_ins):
            noise.shake(rows, begin, end, s, self.model.variance, self._scale[1])
        self._variance = noise.effective(self.model.variance, self._scale[1])
        cost, slope = self._settle(begin, end, self._anchor, self._head, self._out)
        cost = self._follow_jerk(begin, end, cost, slope)
        cost = self._hear_jolt(begin, end, cost)
        cost = self._hear_slide(begin, end, cost)
        deep = self._boundary_ns // self._cell_ns % DEEP == 0
        fresh = begin + int(np.searchsorted(rows.t[begin:end], self._boundary_ns))
        for weights, margin in rivals.weights(rows, begin, end, fresh, self._out, len(self.sensors), deep):
            cost = self._hear(begin, end, weights, self._anchor, cost, margin)
        young = self._young()
        unheard = young and rivals.lost(rows, begin, end, len(self.sensors))
        if deep and (unheard or rivals.disagreement(rows, begin, end)):
            self._start_again(begin, end, cost, not young)
        self._head.run[:] = self._anchor.run
        used = self._used(begin, end)
        others = used.sum() - used
        outlier.label(
            rows.sensor,
            rows.channel,
            rows.weight,
            rows.off,
            rows.verdict,
            rows.reason,
            begin,
            end,
            self._head.run,
            others < WITNESSES,
        )

    def _follow_jerk(self, begin: int, end: int, cost: float, slope: float) -> float:
        """More jerk or less, where the window is likelier with it; all its rows are judged again then."""
        jerk = self._rows.jerk
        now = jerk[begin:end].copy()
        calm = now < motion.JOLT
        other = self._jerk * (motion.STEP if slope < 0.0 else 1.0 / motion.STEP)
        if motion.CALMEST <= other <= motion.WILDEST and slope * (self._jerk - other) > motion.SURER:
            jerk[begin:end] = np.where(calm, other, now)
            if self._price(begin, end) < cost - motion.SURER:
                self._jerk = other
                return self._settle(begin, end, self._anchor, self._head, self._out)[0]
        jerk[begin:end] = np.where(calm, self._jerk, now)
        return cost

    def _hear_jolt(self, begin: int, end: int, cost: float) -> float:
        """Where several sensors are refused at once, it may be the motion that is unusual, not they."""
        jolt = end if self._young() else rivals.jolt(self._rows, begin, end)
        if jolt < end:
            weights = self._rows.weight[begin:end].copy()
            weights[jolt - begin :] = 1.0
            cost = self._hear(begin, end, weights, self._anchor, cost, rivals.MARGIN, jolt)
        return cost

    def _hear_slide(self, begin: int, end: int, cost: float) -> float:
        """Where one channel's values are off together, the story without it."""
        rows, used = self._rows, self._used(begin, end)
        if used.sum() <= WITNESSES:
            return cost
        gains = slide.gains(rows, begin, end, self._out, self.model.rate)[:, :AE]
        s, c = np.unravel_index(gains.argmax(), gains.shape)
        if gains[s, c] > rivals.SLIDE:
            mine = (rows.sensor[begin:end] == s) & (rows.channel[begin:end] == c)
            weights = np.where(mine, 0.0, rows.weight[begin:end])
            cost = self._hear(begin, end, weights, self._anchor, cost, rivals.SLIDE_MARGIN)
        return cost

    def _settle(
        self, begin: int, end: int, anchor: Moment, head: Moment, out: windows.Trace,
        continued: float = decide.CONTINUED,
    ) -> tuple[float, float]:  # fmt: skip
        s = self.settings
        return decide.settle(
            self.model, self._rows, begin, end, anchor.x, anchor.P, anchor.t_ns, s.soft, s.hard, continued,
            self._watched, anchor.run, head.x, head.P, out, self._work, self._r, self._N, self._recent,
        )  # fmt: skip

    def _price(self, begin: int, end: int, continued: float = decide.CONTINUED) -> float:
        anchor, head = self._anchor, self._head.copy()
        return decide.price(
            self.model, self._rows, begin, end, anchor.x, anchor.P, anchor.t_ns, continued, head.x, head.P,
            self._spare, self._work, self._recent,
        )  # fmt: skip

    def _hear(
        self,
        begin: int,
        end: int,
        weights: np.ndarray,
        anchor: Moment,
        cost: float,
        margin,
        jolt=None,
        continued=decide.CONTINUED,
    ):
        """Settle from other ``weights`` (end − begin,), with a jolt before row ``jolt``; returns the cost.

        The story stays if its cost is lower than ``cost`` by ``margin``.
        """
        judged = [(column, column[begin:end].copy()) for column in self._judged()]
        head = self._head.copy()
        self._rows.weight[begin:end] = weights
        if jolt is not None:
            self._rows.jerk[jolt:end] = motion.JOLT
        other, _ = self._settle(begin, end, anchor, head, self._spare, continued)
        explained = jolt is None or rivals.explained(self._rows, jolt, end)
        if explained and other < cost - margin:
            self._out, self._spare = self._spare, self._out
            self._anchor, self._head = anchor, head
            return other
        for column, was in judged:
            column[begin:end] = was
        return cost

    def _start_again(self, begin: int, end: int, cost: float, counted: bool) -> None:
        """After total disagreement: try the window from its own best-supported fixes."""
        rows, before = self._rows, self._anchor
        share = (rows.weight[begin:end] == 0.0).mean()
        cost = self._price(begin, end, decide.OUTBREAK)
        for x, P in start.candidates(self.model, rows, begin, end, before.x, before.P):
            anchor = Moment(int(rows.t[begin]), x, P, np.zeros_like(before.run))
            cost = self._hear(
                begin, end, np.ones(end - begin), anchor, cost, rivals.DEEP_MARGIN, None, decide.OUTBREAK
            )
        if self._anchor is not before:
            reason = (
                f"{share:.0%} of the last {self.settings.horizon_s:g} s refused: begun again from the sensors"
            )
            self._resets += (Reset(begin, self._anchor.copy(), counted, reason),)

    @property
    def _counted(self) -> int:
        return sum(reset.counted for reset in self._resets)

    def _judged(self) -> list[np.ndarray]:
        return [getattr(self._rows, name) for name in JUDGED]

    def _leave(self, begin: int, cut: int) -> np.ndarray:
        """Decide rows ``begin`` to ``cut`` for good: the anchor passes them; returns their smoothed track."""
        rows, anchor = self._rows, self._anchor
        left = self._left(begin, cut)
        used = rows.weight[begin:cut] > 0
        where = (rows.sensor[begin:cut], rows.channel[begin:cut])
        np.add.at(self._tally[..., 0], where, used)
        np.add.at(self._tally[..., 1], where, np.where(used, rows.nis[begin:cut], 0.0))
        np.add.at(self._tally[..., 2], where, ~used)
        noise.follow(
            self.model.is_ins,
            rows.sensor,
            rows.channel,
            rows.off,
            self.model.variance,
            begin,
            cut,
            *self._scale,
        )
        if cut > begin:
            t_ns = windows.ahead(
                self.model, rows, begin, cut, anchor.x, anchor.P, anchor.t_ns, self._out, self._work,
            )  # fmt: skip
            self._anchor = anchor._replace(t_ns=int(t_ns))
            part = (
                c[begin:cut].copy()
                for c in (rows.sensor, rows.channel, rows.weight, rows.off, rows.verdict, rows.reason)
            )
            outlier.label(*part, 0, cut - begin, anchor.run, self._nobody)
        return left

    # ---- what goes out

    def _left(self, begin: int, cut: int) -> np.ndarray:
        """Smoothed track (k,) TRACK of the epochs in rows ``begin`` to ``cut``, as last re-decided."""
        if self.settings.horizon_s == 0:
            return np.zeros(0, TRACK)
        t = self._rows.t[begin:cut]
        first = np.flatnonzero(np.diff(t, prepend=LONG_AGO_NS))
        first = first[first < len(self._out.x)]
        return self._tracks(t[first], self._out.x[first], self._out.P[first])

    def _tracks(self, t_ns, x, P) -> np.ndarray:
        track = np.zeros(len(t_ns), TRACK)
        track["t_ns"], track["x"], track["P"] = t_ns, x[:, :CORE], P[:, :CORE, :CORE]
        track["reset_counter"] = self._counted
        return self._polished(track, models.common_shift(self.model, self._head.x[None, self.model.clock_at]))

    def _polished(self, track: np.ndarray, shift_s: np.ndarray) -> np.ndarray:
        """The ``track`` (k,) moved to the time that most clocks agree on, with its quality; in place."""
        x, shift = track["x"], shift_s[:, None]
        x[:, :3] -= shift * x[:, 3:6] - 0.5 * shift**2 * x[:, 6:9]
        x[:, 3:6] -= shift * x[:, 6:9]
        sigma_m = np.sqrt(np.trace(track["P"][:, :3, :3], axis1=1, axis2=2))
        track["quality"] = np.round(100.0 / (1.0 + sigma_m / HALF_QUALITY_M))
        return track

    def _take_smoothed(self) -> np.ndarray:
        smoothed = np.concatenate([np.zeros(0, TRACK), *self._smoothed])
        self._smoothed = []
        return smoothed

    def _changed(self) -> np.ndarray:
        """Verdicts that are new, changed or now final."""
        rows, begin = self._rows, self._told
        final = np.arange(begin, self._done) < self._final
        k = begin + np.flatnonzero(
            final | (rows.verdict[begin : self._done] != rows.told[begin : self._done])
        )
        out = np.zeros(len(k), VERDICT)
        for name in ("id", "predicted", "sigma", "weight", "verdict", "reason"):
            out[name] = getattr(rows, name)[k]
        out["final"] = k < self._final
        rows.told[k] = rows.verdict[k]
        self._told = self._final
        return out

    def report(self) -> dict:
        """Evidence so far, ready for JSON: NIS per channel, systematic errors, counts, resets."""
        x, P = (self._head.x, self._head.P) if self._head else (np.zeros(0), np.zeros((0, 0)))
        log = [{"t_ns": r.anchor.t_ns, "reason": r.reason} for r in self._resets if r.counted]
        return reports.report(self.sensors, self.model, x, P, self._tally, log)

    def smooth(self) -> np.ndarray:
        """Best estimate of trajectory (k,) TRACK: ahead and back over the flight with final weights."""
        rows, model, n = self._rows, self.model, len(self.model.prior)
        r, N = np.zeros(n), np.zeros((n, n))
        parts, end = [], self._size
        starts = {row: (mark, False) for row, mark in self._marks}
        starts |= {reset.row: (reset.anchor, True) for reset in self._resets}
        for begin in sorted(starts, reverse=True):
            mark, fresh = starts[begin]
            if begin == end:
                continue
            out = windows.trace(end - begin, n, end - begin)
            x, P = mark.x.copy(), mark.P.copy()
            windows.ahead(model, rows, begin, end, x, P, mark.t_ns, out, self._work)
            windows.back(model, rows, begin, end, out, r, N, self._work)
            motion.pull_back(r, N, (rows.t[begin] - mark.t_ns) * 1e-9, model.rate)
            if fresh:
                r[:], N[:] = 0.0, 0.0
            first = np.flatnonzero(np.diff(rows.t[begin:end], prepend=LONG_AGO_NS))
            parts.append(self._tracks(rows.t[begin + first], out.x[first], out.P[first]))
            end = begin
        return np.concatenate([np.zeros(0, TRACK), *parts[::-1]])
