"""The bank of hypotheses about one set of sensors: the incumbent, an alternative, and who challenges it.

The first two proposals are made wherever there is one to make. The others when the incumbent explains its
window worse than a right model would (a posterior predictive check: Gelman et al. 2013, *Bayesian Data
Analysis*, 6.3), whatever went wrong, when a run has begun in it, when fewer than two sensors confirm it, and
where there are few rows; starts until the newest one has explained a window, as till then it is no likelier
than another one. The log evidence with prior odds decides:

    without     the weights of another bank, where that puts the target elsewhere
    closing     rows after the begin of a run stay closed in its channel, then opened
    astray      the same in all channels of the sensor
    again       the same anchor, all rows open again, annealed
    manoeuvre   the same, with a much wilder motion from just before the misfits begin
    start       nothing known before: each sensor's own fix and rows, then all rows

Where they lose they are tried again as soon as it explains less than before, when what it does not explain is
about to be decided, and else after twice the time: what one explanation gains on another grows with the rows.
The first start, a gap, a jump, a capture are all the last of these. The likeliest of those that lose, if it
is close and another explanation, lives on as the alternative, and is tried until the rows are decided.
"""

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from filters.models import runs
from filters.models.motion import CORE
from filters.smoother import gated, proposals, status
from filters.smoother.buffer import LONG_AGO_NS, Rows, scan_ns, streams
from filters.smoother.hypothesis import Hypothesis, Workspace, apart, differ
from filters.smoother.integrity import proof
from filters.smoother.passes import Scores
from filters.smoother.proposals import Prior

SHORTFALL = 2.0  # standard deviations of the log evidence below which the model is thought to be wrong
WRONG = 6.0  # … and below which it surely is
LOST = 12.0  # … for a method that decides at first sight and takes outliers in its stride
CHANCE = 1.0  # … by which a shortfall changes from one window to the next
FEW_ROWS = 60  # so few say too little of whether the model is right: it is challenged at every look
ODDS_MANOEUVRE, ODDS_START = np.log(0.1), np.log(1e-2)  # prior odds in any one window
INERTIA = np.log(1e-2)  # prior odds of any change: the incumbent has explained all windows before
TEMPER = 0.3  # power of the odds: rows of a channel are less independent than the model says
PROOF_NS = 3_000_000_000  # longer than the runs of outliers that radars and theodolites show
CLOSE = np.log(1e3)  # log odds within which two hypotheses are ambiguous
GOOD_SHARE = 0.5  # of the rows that a first state must explain


class Trial(NamedTuple):
    """A hypothesis on trial, and its log prior odds against the incumbent."""

    prior: float
    hypothesis: Hypothesis

    @property
    def log_odds(self) -> float:
        """What decides, up to a constant that all have."""
        return self.prior + self.hypothesis.log_evidence


class Challenge(NamedTuple):
    """When the incumbent began to explain too little, when it was challenged last, and its shortfall then."""

    since_ns: int
    t_ns: int
    shortfall: float


class Bank:
    """See the module's text. ``best`` is None until there is a first state."""

    def __init__(self, space: Workspace, prior: Prior, excluded: int = -1):
        self.space, self.prior, self.excluded = space, prior, excluded
        self.best: Hypothesis | None = None
        self.alternative: Trial | None = None  # nearly as likely, about the same rows
        self.slow = space.prior_slow  # see `Hypothesis`, of the newest one that was forgotten
        self._close_call, self.spread = False, np.zeros((CORE, CORE))  # (9, 9) doubt between hypotheses
        self._challenge: Challenge | None = None  # whose challengers have lost
        self._contradicted = False  # by another sensor, or by its own rows
        self._unproven: proof.Spans = ()
        self.reason = ""  # of the newest start

    def ambiguous(self, t_ns: np.ndarray) -> np.ndarray:
        """(k,) bool: another hypothesis is nearly as likely, or one sensor's word is against another's."""
        return self._close_call | self._contradicted | self.unproven(t_ns)

    def unproven(self, t_ns: np.ndarray) -> np.ndarray:
        """(k,) bool: the state rests on one sensor, or on one of two that disagree."""
        return proof.within(self._unproven, t_ns)

    @property
    def undecided(self) -> bool:
        """Whether later rows may tell which of two is right; not where neither is."""
        return self.alternative is not None and self.best.shortfall < WRONG

    def copy(self) -> "Bank":
        other = object.__new__(Bank)
        other.__dict__.update(self.__dict__)
        other.best = self.best and self.best.copy()
        if self.alternative is not None:
            other.alternative = self.alternative._replace(hypothesis=self.alternative.hypothesis.copy())
        return other

    def admit_alternative(self, new: Rows, states: gated.EpochStates, rule: gated.Rule) -> None:
        """The alternative takes ``new`` rows, which the incumbent takes too."""
        if self.alternative is not None:
            self.alternative.hypothesis.admit(new, states, rule, gated.NEVER_NS)

    def commit(
        self, rows: Rows, cut: int, found: Scores, seconds: float, scale: np.ndarray | None = None
    ) -> None:
        """`Hypothesis.commit` of the incumbent; what is decided has no alternative."""
        self.best.commit(rows, cut, found, seconds, scale)
        self.alternative = None

    def forget(self) -> None:
        """No state from here on; how large the slow errors are is still known."""
        self.slow = (self.best or self).slow
        self.best = self.alternative = None

    def redecide(self, rows: Rows, keep: int, others: Sequence[Hypothesis] = ()) -> Scores:
        """Settle the window, challenge the incumbent where it fails, keep the likeliest who is left.

        ``others``: what is made of the same rows without some sensor, or with all.
        """
        best = self.best
        if self.alternative is not None:
            self.alternative.hypothesis.settle(rows, 0)
        found = best.settle(rows, keep)
        trials, starts = self._challengers(rows, keep, others)
        ranked = [Trial(0.0, best), *trials, *starts]
        inertia = 0.0 if best.young else INERTIA
        top = max(ranked, key=lambda trial: trial.log_odds + inertia * (trial.hypothesis is not best))
        self._doubt(top, ranked)
        self._keep_alternative(top, ranked)
        if top.hypothesis is not best:
            self.best, self._challenge = top.hypothesis, None
        self._confirmed(rows)
        if top.hypothesis is best and (not keep or len(ranked) == 1):
            return found  # the trace is the incumbent's still, or nobody reads it
        if top in starts:
            if not best.young:  # else it is still the first one's
                refused = (best.own.weight < status.DOUBT).mean()
                self.reason = f"{refused:.0%} of the window's rows refused: begun again from the sensors"
            self.put_to_the_proof(rows)
        return self.best.settle(rows, keep)

    def _challengers(
        self, rows: Rows, keep: int, others: Sequence[Hypothesis]
    ) -> tuple[list[Trial], list[Trial]]:
        """Who goes on from the incumbent's anchor, and who begins anew; none where all is well."""
        best, trials, starts = self.best, [], []
        if self.alternative is not None:
            (starts if self.alternative.hypothesis.young else trials).append(self.alternative)
        weights = [other.own.weight for other in others if apart(best, other)]
        likely = [proposals.again(best, rows, weight, annealed=False) for weight in weights]
        if running := proposals.going_wrong(best, rows, streams(rows)):
            likely += proposals.closing(best, rows, np.any(running, axis=0))
        fixes = self._starts(rows) if best.young else []
        few = len(rows.t) < FEW_ROWS
        decided_ns = int(rows.t[keep - 1]) if keep else LONG_AGO_NS
        confirmed, heard = self._witnesses(rows)
        lost = confirmed < min(heard, 2)  # one sensor's word against others, or nobody's
        doubted = lost or (not few and proposals.going_on(best, rows))
        if len(rows.t) and (few or self._is_due(int(rows.t[-1]), decided_ns, doubted=doubted)):
            for astray in proposals.going_wrong(best, rows, rows.sensor):
                likely += proposals.closing(best, rows, astray)
            again = proposals.again(best, rows, np.ones(len(rows.t)), annealed=True)
            wilder = proposals.manoeuvre(best, rows)
            likely.append(again)
            trials.append(Trial(ODDS_MANOEUVRE, wilder))
            top = max(best, again, wilder, key=lambda one: one.log_evidence)
            mild = not few and not lost and best.shortfall < WRONG
            if not fixes and (not mild or top.shortfall > SHORTFALL):
                fixes = self._starts(rows, only_refused=mild)
        if fixes:
            weight = max(fixes, key=lambda fix: fix.log_evidence).own.weight
            likely.append(proposals.again(best, rows, weight, annealed=False))
            starts += [Trial(0.0 if best.young else ODDS_START, fix) for fix in fixes]
        return trials + [Trial(0.0, one) for one in likely], starts

    def _is_due(self, t_ns: int, decided_ns: int, *, doubted: bool = False) -> bool:
        """Whether there is a reason to challenge the incumbent about rows up to ``t_ns``, and it is time to.

        It explains them too poorly, or is ``doubted``: a run that begins may be a manoeuvre as well.
        Those up to ``decided_ns`` are about to be decided.
        """
        short, last = self.best.shortfall, self._challenge
        poor = short >= SHORTFALL
        if not poor and not doubted:
            self._challenge = None
            return False
        since_ns = t_ns if last is None else last.since_ns
        due = last is None or (poor and decided_ns >= since_ns) or t_ns - last.t_ns >= last.t_ns - since_ns
        if due or short > last.shortfall + CHANCE:
            self._challenge = Challenge(since_ns, t_ns, short)
        return self._challenge is not last

    def watch(self, rows: Rows, keep: int) -> Scores:
        """For methods that have no window: start anew where they have lost the target; as `redecide`."""
        found = self.best.look(rows, keep)
        if self.best.shortfall < LOST:
            return found
        starts = self._starts(rows)
        likeliest = max(starts, key=lambda trial: trial.log_evidence, default=self.best)
        gain = likeliest.log_evidence + ODDS_START + INERTIA - self.best.log_evidence
        if gain < 0.0 or likeliest.shortfall > SHORTFALL:
            return found
        self.best, self.reason = likeliest, "lost the target: begun again from the sensors"
        return likeliest.look(rows, keep)

    def begin(self, rows: Rows, weight: np.ndarray | None = None) -> bool:
        """Try to find a first state in a window of ``rows``; whether there is one now.

        ``weight`` (k,): what is made of the same rows with all sensors.
        """
        fixes = self._starts(rows)
        if fixes and weight is not None:
            likeliest = max(fixes, key=lambda fix: fix.log_evidence)
            fixes.append(proposals.again(likeliest, rows, weight, annealed=False))
        fixes.sort(key=lambda fix: -fix.log_evidence)
        heard = rows.sensor != self.excluded
        good = [(fix.own.weight[heard] > status.DOUBT).mean() >= GOOD_SHARE for fix in fixes]
        trials = [Trial(0.0, fix) for fix, enough in zip(fixes, good, strict=True) if enough]
        if not trials:
            return False
        self._doubt(trials[0], trials)
        self.best = trials[0].hypothesis
        self.put_to_the_proof(rows)
        return True

    def _starts(self, rows: Rows, *, only_refused: bool = False) -> list[Hypothesis]:
        """From each sensor, or only from those in which the incumbent refuses a patch: it uses the others."""
        slow, of, tries = (self.best or self).slow, rows.sensor, proposals.TRIES
        if only_refused:
            of, tries = rows.sensor[proposals.patches(self.best, rows)], proposals.FEW_TRIES
        return proposals.starts(self.space, rows, of, self.prior, self.best, self.excluded, slow, tries)

    def put_to_the_proof(self, rows: Rows, unknown: int = 0) -> None:
        """One that rests on one sensor is ambiguous for a while: what it says may be a run of its own.

        Half of all runs are shorter than ROWS; of those that have lasted for so many rows already, half last
        no longer again than these and ROWS: all ``unknown`` epochs without a state may be of one run.
        """
        if self._confirmed(rows) < 2 and len(rows.t):
            proof_ns = max(PROOF_NS, round((runs.ROWS + unknown) * scan_ns(rows)))
            until_ns = self.best.head.t_ns + proof_ns
            self._unproven = proof.with_span(self._unproven, int(rows.t[0]), until_ns)

    def note_contradiction(self, rows: Rows, t_ns: int) -> None:
        """At ``t_ns`` the state would be elsewhere without some sensor; for a while it is ambiguous, of two.

        Where three or more say where the target is, they decide; of two no row can tell which is right.
        """
        seen = Rows(*(column[: np.searchsorted(rows.t, t_ns, side="right")] for column in rows))
        if self._witnesses(seen)[1] == 2:
            until_ns = t_ns + max(PROOF_NS, round(scan_ns(seen)))
            self._unproven = proof.with_span(self._unproven, t_ns, until_ns)

    def _confirmed(self, rows: Rows) -> int:
        """How many sensors confirm the state. Where one does, and another contradicts it, it is in doubt."""
        confirmed, heard = self._witnesses(rows)
        poor = heard < 3 and self.best.young and self.best.shortfall >= SHORTFALL  # it begins, and misfits
        self._contradicted = poor or confirmed < 2 <= heard
        return confirmed

    def _witnesses(self, rows: Rows) -> tuple[int, int]:
        """`proof.witnesses` of the incumbent, among the first of its ``rows``."""
        heard, weight = rows.sensor != self.excluded, self.best.own.weight[: len(rows.t)]
        return proof.witnesses(rows.sensor[heard], rows.channel[heard], weight[heard] > status.DOUBT)

    def _doubt(self, top: Trial, ranked: list[Trial]) -> None:
        """What is left of the other hypotheses: a spread of the state, and whether it is ambiguous.

        ``ranked`` are all, ``top`` among them. Moments of a Gaussian mixture about its state (Bar-Shalom et
        al. 2001, 1.4.16).
        """
        winner, self._close_call, self.spread = top.hypothesis, False, np.zeros((CORE, CORE))
        others = [trial for trial in ranked if apart(winner, trial.hypothesis, 1.0)]
        chances = [np.exp(TEMPER * min(trial.log_odds - top.log_odds, 0.0)) for trial in others]
        for chance, trial in zip(chances, others, strict=True):
            gap = trial.hypothesis.head.x[:CORE] - winner.head.x[:CORE]
            self.spread += chance / (1.0 + sum(chances)) * np.outer(gap, gap)
            self._close_call |= trial.log_odds > top.log_odds - CLOSE and apart(winner, trial.hypothesis)

    def _keep_alternative(self, top: Trial, ranked: list[Trial]) -> None:
        """The likeliest of the others lives on, if it is close and judges the rows differently.

        It begins to where the states are apart, and goes on where they have met again: what was between is
        not decided yet.
        """
        two = (self.best, self.alternative.hypothesis) if self.alternative is not None else ()
        close = [
            trial for trial in ranked
            if trial.log_odds > top.log_odds - CLOSE and differ(top.hypothesis, trial.hypothesis)
            and (apart(top.hypothesis, trial.hypothesis, 1.0) or any(trial.hypothesis is one for one in two))
        ]  # fmt: skip
        likeliest = max(close, key=lambda trial: trial.log_odds, default=None)
        self.alternative = likeliest and likeliest._replace(prior=likeliest.prior - top.prior)
