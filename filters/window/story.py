"""The story that the window's rows tell: which of them to believe, and where the target then is.

    anchor ──► the window's rows, each with its weight ──► head
    what is decided                                        the state now

`take` weighs fresh rows at first sight, `redecide` weighs the whole window again and hears other stories
about it, `leave` lets the anchor pass what is decided.
"""

from collections.abc import Callable
from typing import NamedTuple

import numpy as np

from filters.models import model as models
from filters.models import motion
from filters.models.rows import AE
from filters.window import decide, noise, outlier, passes, rivals, slide, start
from filters.window.book import Span

YOUNG_NS = 5_000_000_000  # so long the first fix itself may be doubted, for one channel's sake too
WITNESSES = 2  # other sensors that it takes to call a run wrong


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


class Memory(NamedTuple):
    """All that a story needs to go on from some row; what was made of the rows is theirs."""

    anchor: Moment | None  # after the decided rows; None before the first fix
    head: Moment | None  # after all rows
    jerk: float  # density of the white jerk now, m²/s⁵
    scale: np.ndarray  # (2, s, 13) each channel's last decided residual, and its noise in stated sigmas
    watched: np.ndarray  # (s,) bool, which sensors have others beside them to contradict them
    resets: tuple[Reset, ...]

    def copy(self) -> "Memory":
        anchor, head = self.anchor and self.anchor.copy(), self.head and self.head.copy()
        return self._replace(anchor=anchor, head=head, scale=self.scale.copy())


class Story:
    """See the module's text. ``anchor`` and ``head`` are None before `begin`; ``out`` traces the last pass.

    ``settings`` are the estimator's; ``admit`` as `decide.admit` and ``label`` as `outlier.label` serve at
    first sight.
    """

    def __init__(self, model: models.Model, settings, admit: Callable, label: Callable):
        self._model, self._settings, self._admit, self._label = model, settings, admit, label
        n, (sensors, channels) = len(model.prior), model.variance.shape
        self.anchor: Moment | None = None
        self.head: Moment | None = None
        self.predicted = np.zeros(n), np.zeros((n, n))
        self.resets: tuple[Reset, ...] = ()
        self._jerk = settings.jerk_psd
        self._scale = np.stack([np.zeros((sensors, channels)), np.ones((sensors, channels))])
        self._variance = model.variance  # as `_scale` has it
        self._watched, self._nobody = np.zeros(sensors, bool), np.zeros(sensors, bool)
        self._grown_ns = 0  # when the first fix is beyond doubt
        self.out, self._spare = passes.trace(1024, n, 1), passes.trace(1024, n, 1)
        self._work, self._recent = models.scratch(n), np.zeros((sensors, channels, 3))
        self._r, self._N = np.zeros(n), np.zeros((n, n))

    def memory(self) -> Memory:
        """What `recall` needs to go on from here."""
        return Memory(self.anchor, self.head, self._jerk, self._scale, self._watched, self.resets).copy()

    def recall(self, memory: Memory) -> None:
        """Go on from there."""
        self.anchor, self.head, self._jerk, self._scale, self._watched, self.resets = memory.copy()
        self._follow_noise()

    @property
    def young(self) -> bool:
        """Whether the first fix itself may still be what is wrong."""
        return self.anchor.t_ns < self._grown_ns

    @property
    def begun_again(self) -> int:
        """How many resets count."""
        return sum(reset.counted for reset in self.resets)

    # ---- on from row to row

    def begin(self, t_ns: int, x: np.ndarray, P: np.ndarray) -> None:
        """Start from a first fix."""
        self.anchor = Moment(t_ns, x, P, np.zeros_like(self._recent[..., :2]))
        self.head = self.anchor.copy()
        self._grown_ns = t_ns + YOUNG_NS

    def take(self, epoch: Span) -> bool:
        """Decide rows of one time at first sight; returns whether one of them ties the state down.

        ``predicted`` is the state before them.
        """
        rows, begin, _ = epoch
        head, s = self.head, self._settings
        fixed = self._admit(
            self._model, *epoch, head.x, head.P, head.t_ns, self._jerk, self._variance, head.run,
            s.soft, s.hard, self._watched, self.out, self._work,
        )  # fmt: skip
        self.predicted = self.out.x[0].copy(), self.out.P[0].copy()
        epoch.label(self._label, head.run, self._nobody)
        self.head = head._replace(t_ns=int(rows.t[begin]))
        return fixed

    def leave(self, left: Span) -> None:
        """Decide rows for good: the anchor passes them."""
        (rows, begin, cut), model = left, self._model
        columns = (rows.sensor, rows.channel, rows.off)
        noise.follow(model.is_ins, *columns, model.variance, begin, cut, *self._scale)
        self._follow_noise()
        if cut > begin:
            at = self.anchor
            t_ns = passes.ahead(model, *left, at.x, at.P, at.t_ns, self.out, self._work)
            left.copy().label(outlier.label, at.run, self._nobody)
            self.anchor = at._replace(t_ns=int(t_ns))

    def _follow_noise(self) -> None:
        """Take fresh rows for as noisy as `_scale` now says."""
        self._variance = noise.effective(self._model.variance, self._scale[1])

    def watch(self, window: Span) -> None:
        """Note which sensors have others beside them in the window, where it can be decided again."""
        used = self._used(window)
        self._watched = (used.sum() > used) & (self._settings.horizon_s > 0)

    def _used(self, window: Span) -> np.ndarray:
        """(s,) bool, which sensors have rows in use."""
        sensor = window.part("sensor")[window.part("weight") > 0]
        return np.bincount(sensor, minlength=len(self._model.is_ins)) > 0

    # ---- the window once more

    def redecide(self, window: Span, keep: int, fresh: int, deep: bool) -> None:
        """Weigh all rows of the window again, hear the rivals, take the best story; the head follows.

        States are smoothed for the first ``keep`` rows: those that leave the window now. Rows from ``fresh``
        on are new; ``deep`` hears the costly rivals too.
        """
        self._make_room(window.end - window.begin, keep)
        for s in np.flatnonzero(self._model.is_ins):
            noise.shake(*window, s, self._model.variance, self._scale[1])
        self._follow_noise()
        cost, slope = self._settle(window, self.anchor, self.head, self.out)
        cost = self._follow_jerk(window, cost, slope)
        cost = self._hear_jolt(window, cost)
        cost = self._hear_slide(window, cost)
        sensors = len(self._model.is_ins)
        for weights, margin in rivals.weights(*window, fresh, self.out, sensors, deep):
            cost = self._hear(window, weights, self.anchor, cost, margin)
        unheard = self.young and rivals.lost(*window, sensors)
        if deep and (unheard or rivals.disagreement(*window)):
            self._start_again(window)
        self.head.run[:] = self.anchor.run
        used = self._used(window)
        others = used.sum() - used
        window.label(outlier.label, self.head.run, others < WITNESSES)

    def _make_room(self, count: int, keep: int) -> None:
        """Traces for ``count`` rows, with states for ``keep`` of them."""
        if count > len(self.out.v):
            self.out, self._spare = (passes.trace(2 * count, len(self.head.x), 1) for _ in range(2))
        self.out, self._spare = (passes.keeping(out, keep) for out in (self.out, self._spare))

    def _follow_jerk(self, window: Span, cost: float, slope: float) -> float:
        """More jerk or less, where the window is likelier with it; all its rows are judged again then."""
        jerk = window.part("jerk")
        now = jerk.copy()
        calm = now < motion.JOLT
        other = self._jerk * (motion.STEP if slope < 0.0 else 1.0 / motion.STEP)
        if motion.CALMEST <= other <= motion.WILDEST and slope * (self._jerk - other) > motion.SURER:
            jerk[:] = np.where(calm, other, now)
            if self.price(window) < cost - motion.SURER:
                self._jerk = other
                return self._settle(window, self.anchor, self.head, self.out)[0]
        jerk[:] = np.where(calm, self._jerk, now)
        return cost

    def _hear_jolt(self, window: Span, cost: float) -> float:
        """Where several sensors are refused at once, it may be the motion that is unusual, not they."""
        jolt = window.end if self.young else rivals.jolt(*window)
        if jolt < window.end:
            weights = window.part("weight").copy()
            weights[jolt - window.begin :] = 1.0
            cost = self._hear(window, weights, self.anchor, cost, rivals.MARGIN, jolt)
        return cost

    def _hear_slide(self, window: Span, cost: float) -> float:
        """Where one channel's values are off together, the story without it."""
        if self._used(window).sum() <= WITNESSES:
            return cost
        gains = slide.gains(*window, self.out, self._model.rate)[:, :AE]
        s, c = np.unravel_index(gains.argmax(), gains.shape)
        if gains[s, c] > rivals.SLIDE:
            mine = (window.part("sensor") == s) & (window.part("channel") == c)
            weights = np.where(mine, 0.0, window.part("weight"))
            cost = self._hear(window, weights, self.anchor, cost, rivals.SLIDE_MARGIN)
        return cost

    def _start_again(self, window: Span) -> None:
        """After total disagreement: try the window from its own best-supported fixes."""
        rows, begin, end = window
        before, counted = self.anchor, not self.young
        share = (window.part("weight") == 0.0).mean()
        cost = self.price(window, decide.OUTBREAK)
        for x, P in start.candidates(self._model, *window, before.x, before.P):
            anchor = Moment(int(rows.t[begin]), x, P, np.zeros_like(before.run))
            everyone, margin = np.ones(end - begin), rivals.DEEP_MARGIN
            cost = self._hear(window, everyone, anchor, cost, margin, continued=decide.OUTBREAK)
        if self.anchor is not before:
            s = self._settings
            reason = f"{share:.0%} of the last {s.horizon_s:g} s refused: begun again from the sensors"
            self.resets += (Reset(begin, self.anchor.copy(), counted, reason),)

    def _hear(
        self, window: Span, weights: np.ndarray, anchor: Moment, cost: float, margin: float,
        jolt: int | None = None, continued: float = decide.CONTINUED,
    ) -> float:  # fmt: skip
        """Settle from other ``weights`` (end − begin,), with a jolt before row ``jolt``; returns the cost.

        The story stays if its cost is lower than ``cost`` by ``margin``.
        """
        before, head = window.judged(), self.head.copy()
        window.part("weight")[:] = weights
        if jolt is not None:
            window.rows.jerk[jolt : window.end] = motion.JOLT
        other, _ = self._settle(window, anchor, head, self._spare, continued)
        explained = jolt is None or rivals.explained(window.rows, jolt, window.end)
        if explained and other < cost - margin:
            self.out, self._spare = self._spare, self.out
            self.anchor, self.head = anchor, head
            return other
        window.restore(before)
        return cost

    def _settle(
        self, window: Span, anchor: Moment, head: Moment, out: passes.Trace,
        continued: float = decide.CONTINUED,
    ) -> tuple[float, float]:  # fmt: skip
        """`decide.settle`: weigh the window from ``anchor`` on, the state at its end into ``head``."""
        s = self._settings
        return decide.settle(
            self._model, *window, anchor.x, anchor.P, anchor.t_ns, s.soft, s.hard, continued, self._watched,
            anchor.run, head.x, head.P, out, self._work, self._r, self._N, self._recent,
        )  # fmt: skip

    def price(self, window: Span, continued: float = decide.CONTINUED) -> float:
        """`decide.price`: the cost of the story as it is."""
        anchor, head = self.anchor, self.head.copy()
        return decide.price(
            self._model, *window, anchor.x, anchor.P, anchor.t_ns, continued, head.x, head.P,
            self._spare, self._work, self._recent,
        )  # fmt: skip
