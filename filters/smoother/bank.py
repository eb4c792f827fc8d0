"""The bank of hypotheses about one set of sensors: the incumbent, and those that challenge it.

The first two proposals are made wherever there is one to make. The others when the incumbent explains its
window worse than a right model would (a posterior predictive check: Gelman et al. 2013, *Bayesian Data
Analysis*, 6.3), whatever went wrong; and starts also until the newest one has explained a window, as till
then it is no likelier than another one. The log evidence with prior odds decides:

    without     the weights of the bank without some sensor, where that puts the target elsewhere
    running     rows after the begin of a run stay closed in their channel, then opened
    again       the same anchor, all rows open again, annealed
    manoeuvre   the same, with a much wilder motion from just before the misfits begin
    start       nothing known before: each sensor's own fix and rows, then all rows

The first start, a gap, a jump, a capture by a bad sensor are all the last of these.
"""

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from filters.models.motion import CORE
from filters.models.rows import AE, CHANNELS
from filters.models.state import prior_covariance
from filters.smoother import adaptation, start, status
from filters.smoother.buffer import Rows, outcome
from filters.smoother.hypothesis import Hypothesis, Moment, Workspace
from filters.smoother.passes import Scores

SHORTFALL = 2.0  # standard deviations of the log evidence below which the model is thought to be wrong
LOST = 12.0  # … for a method that decides at first sight and takes outliers in its stride
ODDS_MANOEUVRE, ODDS_START = np.log(0.1), np.log(1e-2)  # prior odds in any one window
INERTIA = np.log(1e-2)  # prior odds of any change: the incumbent has explained all windows before
LEAD_NS = 100_000_000  # a jerk is under way for so long before a position shows it: (6 · 0.1 m / 600 m/s³)^⅓
MISFIT = 5.0  # rows that one misfit outweighs in the search for where a manoeuvre began
TEMPER = 0.3  # power of the odds: rows of a channel are less independent than the model says
PROOF_NS = 3_000_000_000  # longer than the runs of outliers that radars and theodolites show
CLOSE = np.log(1e3)  # log odds within which two hypotheses are ambiguous
APART = 3.0  # sigmas between their positions beyond which it matters
FASTEST_MPS = 1000.0  # 1-sigma per axis of the speeds that there are
GOOD_SHARE = 0.5  # of the rows that a first state must explain


class Prior(NamedTuple):
    """What is known of the target before it is seen."""

    height_m: float = np.nan
    height_sigma_m: float = np.nan


class Bank:
    """See the module's text. ``best`` is None until there is a first state."""

    def __init__(self, space: Workspace, prior: Prior, excluded: int = -1):
        self.space, self.prior, self.excluded = space, prior, excluded
        self.best: Hypothesis | None = None
        self._close_call, self.spread = False, np.zeros((CORE, CORE))  # (9, 9) doubt between hypotheses
        self._proven_ns = 0  # until then a start of one sensor alone may be the middle of its own run
        self.reason = ""  # of the newest start

    def ambiguous(self, t_ns: np.ndarray) -> np.ndarray:
        """(k,) bool: another hypothesis is nearly as likely, or nobody else has confirmed this start yet."""
        return self._close_call | (t_ns < self._proven_ns)

    def copy(self) -> "Bank":
        other = object.__new__(Bank)
        other.__dict__.update(self.__dict__)
        other.best = self.best and self.best.copy()
        return other

    def redecide(self, rows: Rows, keep: int, others: Sequence[Hypothesis] = ()) -> tuple[Scores, bool]:
        """Settle the window, challenge the incumbent where it fails; returns (scores, started anew).

        ``others``: what is made of the same rows without some sensor.
        """
        best = self.best
        found = best.settle(rows, keep)
        self._close_call, self.spread = False, np.zeros((CORE, CORE))
        weights = [other.own.weight for other in others if apart(best, other)]
        running = self._running(rows)
        failing = len(rows.t) > 0 and best.shortfall >= SHORTFALL
        if not weights and not running.any() and not failing and not best.young:
            return found, False
        trials = [(0.0, best)]  # log prior odds, hypothesis
        trials += [(0.0, self._again(rows, weight, annealed=False)) for weight in weights]
        if running.any():
            trial = best.copy()
            trial.settle(rows, 0, running)
            trials.append((0.0, trial))
            trials.append((0.0, self._again(rows, trial.own.weight, annealed=False)))
        odds_start, inertia = (0.0, 0.0) if best.young else (ODDS_START, INERTIA)
        starts = self._starts(rows) if best.young else []
        if failing:
            everything = (rows.sensor != self.excluded).astype(float)
            again = self._again(rows, everything, annealed=True)
            wilder = self._manoeuvre(rows)
            trials += [(0.0, again), (ODDS_MANOEUVRE, wilder)]
            unexplained = min(again.shortfall, wilder.shortfall) > SHORTFALL
            if not starts and (unexplained or best.shortfall > 3.0 * SHORTFALL):
                starts = self._starts(rows)
        if starts:
            likeliest = max(starts, key=lambda trial: trial.log_evidence)
            trials.append((0.0, self._again(rows, likeliest.own.weight, annealed=False)))
        kept = len(trials)
        trials += [(odds_start, trial) for trial in starts]
        ranked = [(prior + trial.log_evidence, trial) for prior, trial in trials]
        number = int(np.argmax([odds + (inertia if h is not best else 0.0) for odds, h in ranked]))
        top, winner = ranked[number]
        self._doubt(winner, top, ranked)
        if winner is best:
            best.settle(rows, keep)
            return found, False
        self.best = winner
        started = number >= kept
        if started:
            if not best.young:  # else it is still the first one's
                refused = (best.own.weight < status.DOUBT).mean()
                self.reason = f"{refused:.0%} of the window's rows refused: begun again from the sensors"
            self._put_to_the_proof(rows)
        return winner.settle(rows, keep), started

    def watch(self, rows: Rows, keep: int) -> tuple[Scores, bool]:
        """For methods that have no window: start anew where they have lost the target; as `redecide`."""
        found = self.best.look(rows, keep)
        if self.best.shortfall < LOST:
            return found, False
        starts = self._starts(rows)
        likeliest = max(starts, key=lambda trial: trial.log_evidence, default=self.best)
        gain = likeliest.log_evidence + ODDS_START + INERTIA - self.best.log_evidence
        if gain < 0.0 or likeliest.shortfall > SHORTFALL:
            return found, False
        self.best, self.reason = likeliest, "lost the target: begun again from the sensors"
        return likeliest.look(rows, keep), True

    def begin(self, rows: Rows) -> bool:
        """Try to find a first state in a window of ``rows``; whether there is one now."""
        trials = sorted(self._starts(rows), key=lambda t: -t.log_evidence)
        trials = [t for t in trials if (t.own.weight > status.DOUBT).mean() >= GOOD_SHARE]
        if not trials:
            return False
        self.best = trials[0]
        self._doubt(trials[0], trials[0].log_evidence, [(trial.log_evidence, trial) for trial in trials])
        self._put_to_the_proof(rows)
        return True

    def _put_to_the_proof(self, rows: Rows) -> None:
        """A start that rests on one sensor is ambiguous for a while: what it says may be a run of its own."""
        used = rows.sensor[(self.best.own.weight > status.DOUBT) & (rows.channel < AE)]
        alone = len(np.unique(used)) < 2
        self._proven_ns = self.best.head.t_ns + (PROOF_NS if alone else 0)

    def _doubt(self, winner: Hypothesis, top: float, ranked: list[tuple[float, Hypothesis]]) -> None:
        """What is left of the other hypotheses: a spread of the state, and whether it is ambiguous.

        ``ranked`` (log odds, hypothesis), the ``winner`` with log odds ``top`` among them. Moments of a
        Gaussian mixture about the winner (Bar-Shalom et al. 2001, 1.4.16).
        """
        others = [(min(odds - top, 0.0), h) for odds, h in ranked if apart(winner, h, 1.0)]
        chances = [np.exp(TEMPER * odds) for odds, _ in others]
        self.spread = np.zeros((CORE, CORE))
        for chance, (_, h) in zip(chances, others, strict=True):
            gap = h.head.x[:CORE] - winner.head.x[:CORE]
            self.spread += chance / (1.0 + sum(chances)) * np.outer(gap, gap)
        self._close_call = any(-odds < CLOSE and apart(winner, h) for odds, h in others)

    def _again(self, rows: Rows, weight: np.ndarray, *, annealed: bool) -> Hypothesis:
        """The same anchor, from other weights (k,)."""
        trial = self.best.copy()
        trial.own.weight[:] = weight
        trial.settle(rows, 0, annealed=annealed)
        return trial

    def _running(self, rows: Rows) -> np.ndarray:
        """(k,) bool: rows from the begin of a run in their channel on, if some are used all the same."""
        running, outlier = np.zeros(len(rows.t), bool), self.best.own.weight < status.DOUBT
        name = rows.sensor.astype(np.int64) * len(CHANNELS) + rows.channel
        for one in np.unique(name[outlier]):
            mine = np.flatnonzero(name == one)
            if len(mine) < status.PATCH_ROWS:
                continue
            together = np.convolve(outlier[mine], np.ones(status.PATCH_ROWS), "valid") == status.PATCH_ROWS
            if together.any():
                since = mine[np.argmax(together) :]
                running[since] = not outlier[since].all()
        return running & (rows.sensor != self.excluded)

    def _manoeuvre(self, rows: Rows) -> Hypothesis:
        """The same anchor; from where the misfits begin, all rows open again and a much wilder motion."""
        trial = self.best.copy()
        own, begin = trial.own, self._onset(rows)
        own.weight[begin:] = rows.sensor[begin:] != self.excluded
        own.regime[:begin], own.regime[begin:] = 1, 0
        trial.psd_before = trial.psd
        trial.psd = adaptation.wilder(trial.psd, self.space.prior_psd)
        trial.settle(rows, 0, annealed=True)
        trial.settle(rows, 0)
        return trial

    def _onset(self, rows: Rows) -> int:
        """The first row of a manoeuvre: somewhat before the one from which on there are more misfits.

        That by a cumulative sum, reversed (Page 1954).
        """
        own = self.best.own
        misfit = np.where(own.weight < status.DOUBT, MISFIT, 0.0) * (rows.sensor != self.excluded)
        seen = int(len(misfit) - 1 - np.argmax(np.cumsum((misfit - 1.0)[::-1])))
        return int(np.searchsorted(rows.t, rows.t[seen] - LEAD_NS))

    def _starts(self, rows: Rows) -> list[Hypothesis]:
        model, prior = self.space.model, self.prior
        trials = []
        heard = np.flatnonzero(rows.sensor != self.excluded)
        if not len(heard):
            return trials
        usable = Rows(*(column[heard] for column in rows))
        for s, x, P in start.candidates(model, usable, prior.height_m, prior.height_sigma_m):
            if self.best is not None:
                self._keep_errors(x, P)
            anchor = Moment(int(usable.t[0]), x, P, status.fresh_memory(len(model.is_ins)))
            trial = Hypothesis(self.space, anchor, self.excluded)
            if self.best is not None:
                trial.scale, trial.motion = self.best.scale, self.best.motion
                trial.psd = self.best.usual_psd
            trial.own = outcome(len(rows.t))
            trial.own.weight[:] = rows.sensor == s
            trial.settle(rows, 0)
            trial.settle(rows, 0)
            trial.log_evidence -= 0.5 * float(np.sum((trial.head.x[3:6] / FASTEST_MPS) ** 2))
            trials.append(trial)
        return trials

    def _keep_errors(self, x: np.ndarray, P: np.ndarray) -> None:
        """Constant errors of the instruments keep what is known of them, twice as unsure; in place."""
        model, known = self.space.model, self.best.anchor
        kept = CORE + np.flatnonzero(model.rate[CORE:] == 0.0)
        if len(kept):
            x[kept] = known.x[kept]
            both = np.ix_(kept, kept)
            wide, most = 4.0 * known.P[both], np.diag(prior_covariance(model))[kept]
            shrink = np.sqrt(np.minimum(1.0, most / np.maximum(np.diag(wide), 1e-300)))
            P[both] = shrink[:, None] * wide * shrink  # never wider than the prior, and still a covariance


def apart(a: Hypothesis, b: Hypothesis, sigmas: float = APART) -> bool:
    """Whether two hypotheses put the target in different places, by so many of their own ``sigmas``."""
    gap = a.head.x[:3] - b.head.x[:3]
    variance = np.diag(a.head.P)[:3] + np.diag(b.head.P)[:3]
    return bool((gap**2 > sigmas**2 * np.maximum(variance, 1e-12)).any())
