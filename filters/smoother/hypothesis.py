"""One explanation of the window's rows, and how likely it is.

    anchor ──► the window's rows, each with its weight ──► head
    committed                                              the state now

A hypothesis is an anchor (a state with each channel's status), a sensor that it leaves out (or none), and the
densities of the motion. `admit` takes rows at first sight, `settle` weighs the whole window again
until nothing changes, `commit` lets the anchor pass rows that are decided.
"""

from typing import NamedTuple

import numpy as np

from filters.models import motion, runs
from filters.models.state import Model, scratch
from filters.smoother import adaptation, gated, passes, status
from filters.smoother.buffer import Outcome, Rows, outcome

SETTLED = 0.05  # a change of weight that is no change
PASSES = 3  # over the window at most, at one temperature
APART = 3.0  # sigmas between two positions beyond which it matters
ANNEALING = (100.0, 16.0, 4.0, 1.0)  # factors of all noise variances, from wide to narrow


class Moment(NamedTuple):
    """A state with its time, and the status of each channel then."""

    t_ns: int
    x: np.ndarray  # (n,)
    P: np.ndarray  # (n, n)
    memory: np.ndarray  # (s, 13, MEMORY) see status.filtered

    def copy(self) -> "Moment":
        return Moment(self.t_ns, self.x.copy(), self.P.copy(), self.memory.copy())


class Workspace:
    """Scratch arrays that all hypotheses of an estimator share; they hold nothing between calls."""

    def __init__(self, model: Model, prior_psd: np.ndarray):
        n = len(model.prior)
        self.model = model
        self.prior_psd, self.prior_noise = prior_psd, adaptation.noise_prior(model.is_ins)
        self.prior_motion = adaptation.motion_prior(prior_psd)
        self.prior_slow, self.prior_ins = adaptation.slow_prior(len(model.is_ins)), adaptation.ins_prior(n)
        self.work, self.r, self.N = scratch(n), np.zeros(n), np.zeros((n, n))
        self.trace = passes.trace(1024, n, 256)

    def room(self, rows: int, keep: int) -> passes.Trace:
        """A trace for ``rows`` rows that can keep the states of the first ``keep``."""
        trace = self.trace
        if rows > len(trace.v) or keep > len(trace.x):
            n = len(self.model.prior)
            self.trace = passes.trace(max(2 * rows, len(trace.v)), n, max(2 * keep, len(trace.x)))
        return self.trace


class Hypothesis:
    """See the module's text. ``excluded`` is the sensor left out, −1 for none."""

    def __init__(self, space: Workspace, anchor: Moment, excluded: int = -1):
        self.space, self.anchor, self.head, self.excluded = space, anchor, anchor.copy(), excluded
        self.judged(outcome(0))
        self.psd = space.prior_psd  # (4,) densities now
        self.motion = space.prior_motion  # (2, 4) what is known of the usual ones
        self.psd_before = self.psd  # of the rows in the window before a manoeuvre: regime 1
        self.log_evidence = self.shortfall = 0.0
        self.scale = space.prior_noise
        self.ins = space.prior_ins  # (2, n − 9) what is known of how large an INS's errors are
        self.follow(space.prior_slow)
        self.surprise = 0.0
        self.young = True  # none of its rows is decided yet

    def copy(self) -> "Hypothesis":
        """Another one that may go its own way."""
        other = object.__new__(Hypothesis)
        other.__dict__.update(self.__dict__)
        other.anchor, other.head = self.anchor.copy(), self.head.copy()
        other.judged(Outcome(*(column.copy() for column in self.own)))
        return other

    def follow(self, slow: np.ndarray) -> None:
        """Take over ``slow`` (2, s), what is known of how large the slow errors are; ``factors`` (n − 9,)."""
        self.slow = slow
        self.factors = adaptation.slow_factors(slow, self.space.model) * np.exp(self.ins[0])

    def judged(self, own: Outcome) -> None:
        """Begin with what was made of the window's rows."""
        self._room, self._size = own, len(own.weight)  # the first of what there is room for

    @property
    def own(self) -> Outcome:
        """What it makes of the window's rows."""
        return Outcome(*(column[: self._size] for column in self._room))

    @property
    def usual_psd(self) -> np.ndarray:
        """(4,) the middle of the prior of the densities."""
        return np.where(self.psd > 0.0, np.exp(self.motion[0]), 0.0)

    def densities(self) -> np.ndarray:
        """(2, n − 5) of the regimes: now, and before the manoeuvre that the window has seen."""
        return np.stack([self._with_errors(psd) for psd in (self.psd, self.psd_before)])

    def _with_errors(self, psd: np.ndarray) -> np.ndarray:
        """(n − 5,) the motion's ``psd`` (4,), and how large the slow errors are; see `motion.densities`."""
        return motion.densities(psd, self.factors)

    def admit(self, new: Rows, states: gated.EpochStates, rule: gated.Rule, quiet_ns: int) -> tuple[int, int]:
        """Take ``new`` rows at first sight until one surprises; (rows, epochs) taken.

        Nothing surprises before ``quiet_ns``."""
        space, model, head = self.space, self.space.model, self.head
        end = self._size + len(new.t)
        if end > len(self._room.weight):
            room = outcome(2 * end)
            for column, known in zip(room, self.own, strict=True):
                column[: self._size] = known
            self._room = room
        count, epochs, self.surprise = gated.admit(
            model, new, self._room, self._size, self.scale[0], self._with_errors(self.psd), head.x, head.P,
            head.t_ns, head.memory, self.excluded, rule, self.surprise, quiet_ns, space.room(1, 0), states,
            space.work,
        )  # fmt: skip
        self._size += count
        self.head = Moment(int(new.t[count - 1]), head.x, head.P, head.memory)
        return count, epochs

    def _noise(self, rows: Rows) -> np.ndarray:
        return rows.stated * np.exp(self.scale[0, rows.sensor, rows.channel])

    def settle(
        self, rows: Rows, keep: int, closed: np.ndarray | None = None, *, annealed: bool = False
    ) -> passes.Scores:
        """Weigh the window's ``rows`` again, each by what all others say; the head follows.

        States of the first ``keep`` rows are smoothed into the workspace's trace. Rows that are ``closed``
        (k,) get no weight, beside those of the sensor left out. ``annealed`` begins with wide noise, so that
        the weights it starts from do not decide where it ends. Sets ``log_evidence`` and
        ``shortfall`` (what the model would expect more, in its own standard deviations).
        """
        noise, own = self._noise(rows), self.own
        left_out = rows.sensor == self.excluded
        closed = left_out if closed is None else closed | left_out
        for temperature in ANNEALING if annealed else ANNEALING[-1:]:
            own.noise[:] = temperature * noise
            for _ in range(1 if temperature > 1.0 else PASSES):
                found = self._smooth(rows, keep)
                memory = self.anchor.memory.copy()
                change = status.posterior(rows, own, memory, closed, self.young)
                if temperature == 1.0 and change < SETTLED:
                    break
            if temperature == 1.0:
                self.psd = adaptation.densities(self.psd, self.usual_psd, found)
        self.head, self.surprise = self.head._replace(memory=memory), 0.0
        self._weigh_evidence(rows)
        return found

    def look(self, rows: Rows, keep: int) -> passes.Scores:
        """As `settle`, but what was decided at first sight stays: for the methods that have no window."""
        head, own = self.head, self.own
        first_sight = own.residual.copy(), own.sigma.copy(), own.nis.copy()
        found, out = self._smooth(rows, keep), self.space.trace
        own.residual[:], own.sigma[:], own.nis[:] = first_sight
        self.head, count = head, len(rows.t)
        out.v[:count], out.S[:count], out.moved[:count] = own.residual, own.sigma**2, 0.0
        out.fresh[:count] = runs.FRESH * (own.sigma**2 - own.noise)
        self.log_evidence, self.shortfall = status.log_evidence(
            rows, own, out, status.fresh_memory(len(self.anchor.memory)), self.excluded
        )
        return found

    def _smooth(self, rows: Rows, keep: int) -> passes.Scores:
        """Once forward and backward with the weights as they are."""
        space, model = self.space, self.space.model
        out = space.room(len(rows.t), keep)
        x, P = self.anchor.x.copy(), self.anchor.P.copy()
        densities, found = self.densities(), passes.scores(len(x))
        t_ns = passes.forward(model, rows, self.own, densities, x, P, self.anchor.t_ns, keep, out, space.work)
        space.r[:], space.N[:] = 0.0, 0.0
        passes.backward(model, rows, self.own, densities, keep, out, space.r, space.N, found, space.work)
        self.own.nis[:] = out.v[: len(rows.t)] ** 2 / out.S[: len(rows.t)]
        self.head = Moment(int(t_ns), x, P, self.head.memory)
        return found

    def _weigh_evidence(self, rows: Rows) -> None:
        self.log_evidence, self.shortfall = status.log_evidence(
            rows, self.own, self.space.trace, self.anchor.memory.copy(), self.excluded
        )
        self.log_evidence += adaptation.log_prior(self.psd, self.usual_psd)

    def commit(
        self, rows: Rows, cut: int, found: passes.Scores, seconds: float, scale: np.ndarray | None = None
    ) -> None:
        """Decide the first ``cut`` rows for good: the anchor passes them, the densities are followed.

        So is the noise, unless its ``scale`` (2, s, 13) is known from whom all sensors tell it.
        """
        space, model = self.space, self.space.model
        x, P, memory = self.anchor.x.copy(), self.anchor.P.copy(), self.anchor.memory.copy()
        left = Rows(*(column[:cut] for column in rows))
        own = Outcome(*(column[:cut] for column in self.own))
        out = space.room(cut, 0)
        t_ns = passes.forward(model, left, own, self.densities(), x, P, self.anchor.t_ns, 0, out, space.work)
        status.advance(left, own, memory)
        self.anchor, self.young = Moment(int(t_ns), x, P, memory), False
        self.judged(Outcome(*(column[cut:].copy() for column in self.own)))
        if scale is None:
            seen = adaptation.noise_scores(left, own, memory[..., runs.CHANCE], model.is_ins)
            scale = adaptation.follow_noise(self.scale, space.prior_noise, seen, seconds)
        self.scale = scale
        psd = np.stack([self.psd, self.psd_before])
        self.motion = adaptation.follow_motion(self.motion, space.prior_motion, psd, found, seconds)
        self.ins = adaptation.follow_ins(self.ins, model, found, seconds)
        self.follow(adaptation.follow_slow(self.slow, model, x, np.diag(P), seconds))


def differ(a: Hypothesis, b: Hypothesis) -> bool:
    """Whether two hypotheses about the same rows judge as many of them differently as make a patch."""
    return bool(np.abs(a.own.weight - b.own.weight).sum() >= status.PATCH_ROWS)


def apart(a: Hypothesis, b: Hypothesis, sigmas: float = APART) -> bool:
    """Whether two hypotheses put the target in different places, by so many of their own ``sigmas``."""
    gap = a.head.x[:3] - b.head.x[:3]
    variance = np.diag(a.head.P)[:3] + np.diag(b.head.P)[:3]
    return bool((gap**2 > sigmas**2 * np.maximum(variance, 1e-12)).any())
