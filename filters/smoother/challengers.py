"""Who may challenge an incumbent: other explanations of the same rows, each made from the incumbent's own.

    again       the same anchor, from other weights: all rows open, annealed, or as somebody else weighs them
    running     rows after the begin of a run stay closed in their channel
    manoeuvre   the same anchor, with a much wilder motion from just before the misfits begin
    starts      nothing known before: each sensor's own fix and rows, then all rows

Who of them wins is the `bank`'s.
"""

from typing import NamedTuple

import numpy as np

from filters.models.motion import CORE
from filters.models.rows import CHANNELS
from filters.smoother import adaptation, start, status
from filters.smoother.buffer import Rows, outcome
from filters.smoother.hypothesis import Hypothesis, Moment, Workspace

LEAD_NS = 100_000_000  # a jerk is under way for so long before a position shows it: (6 · 0.1 m / 600 m/s³)^⅓
MISFIT = 5.0  # rows that one misfit outweighs in the search for where a manoeuvre began
FASTEST_MPS = 1000.0  # 1-sigma per axis of the speeds that there are


class Prior(NamedTuple):
    """What is known of the target before it is seen."""

    height_m: float = np.nan
    height_sigma_m: float = np.nan


def again(incumbent: Hypothesis, rows: Rows, weight: np.ndarray, *, annealed: bool) -> Hypothesis:
    """The same anchor, from other weights (k,)."""
    trial = incumbent.copy()
    trial.own.weight[:] = np.where(rows.sensor == trial.excluded, 0.0, weight)
    trial.settle(rows, 0, annealed=annealed)
    return trial


def running(incumbent: Hypothesis, rows: Rows) -> np.ndarray:
    """(k,) bool: rows from the begin of a run in their channel on, if some are used all the same."""
    found, outlier = np.zeros(len(rows.t), bool), incumbent.own.weight < status.DOUBT
    name = rows.sensor.astype(np.int64) * len(CHANNELS) + rows.channel
    for one in np.unique(name[outlier]):
        mine = np.flatnonzero(name == one)
        if len(mine) < status.PATCH_ROWS:
            continue
        together = np.convolve(outlier[mine], np.ones(status.PATCH_ROWS), "valid") == status.PATCH_ROWS
        if together.any():
            since = mine[np.argmax(together) :]
            found[since] = not outlier[since].all()
    return found & (rows.sensor != incumbent.excluded)


def manoeuvre(incumbent: Hypothesis, rows: Rows) -> Hypothesis:
    """The same anchor; from where the misfits begin, all rows open again and a much wilder motion."""
    trial, begin = incumbent.copy(), onset(incumbent, rows)
    own = trial.own
    own.weight[begin:] = rows.sensor[begin:] != trial.excluded
    own.regime[:begin], own.regime[begin:] = 1, 0
    trial.psd_before = trial.psd
    trial.psd = adaptation.wilder(trial.psd, trial.space.prior_psd)
    trial.settle(rows, 0, annealed=True)
    trial.settle(rows, 0)
    return trial


def onset(incumbent: Hypothesis, rows: Rows) -> int:
    """The first row of a manoeuvre: somewhat before the one from which on there are more misfits.

    That by a cumulative sum, reversed (Page 1954).
    """
    outlier = (incumbent.own.weight < status.DOUBT) & (rows.sensor != incumbent.excluded)
    seen = int(len(outlier) - 1 - np.argmax(np.cumsum((MISFIT * outlier - 1.0)[::-1])))
    return int(np.searchsorted(rows.t, rows.t[seen] - LEAD_NS))


def starts(
    space: Workspace, rows: Rows, prior: Prior, incumbent: Hypothesis | None, excluded: int, slow: np.ndarray
) -> list[Hypothesis]:
    """From what each sensor but the one ``excluded`` says; what an ``incumbent`` knows of errors is kept.

    ``slow``: see `Hypothesis`.
    """
    model, trials = space.model, []
    usable = Rows(*(column[rows.sensor != excluded] for column in rows))
    if not len(usable.t):
        return trials
    for s, x, P in start.candidates(model, usable, prior.height_m, prior.height_sigma_m):
        if incumbent is not None:
            keep_errors(incumbent, x, P)
        anchor = Moment(int(usable.t[0]), x, P, status.fresh_memory(len(model.is_ins)))
        trial = Hypothesis(space, anchor, excluded)
        trial.follow(slow)
        if incumbent is not None:
            trial.scale, trial.motion, trial.psd = incumbent.scale, incumbent.motion, incumbent.usual_psd
        trial.judged(outcome(len(rows.t)))
        trial.own.weight[:] = rows.sensor == s
        trial.settle(rows, 0)
        trial.settle(rows, 0)
        trial.log_evidence -= 0.5 * float(np.sum((trial.head.x[3:6] / FASTEST_MPS) ** 2))
        trials.append(trial)
    return trials


def keep_errors(incumbent: Hypothesis, x: np.ndarray, P: np.ndarray) -> None:
    """The instruments' errors keep what is known of them, twice as unsure; in place."""
    model, known = incumbent.space.model, incumbent.anchor
    kept = np.setdiff1d(model.bias_at[~model.is_ins], [-1])
    both = np.ix_(kept, kept)
    usual = adaptation.slow_factors(incumbent.slow, model)[kept - CORE]
    wide, most = 4.0 * known.P[both], model.prior[kept] * np.maximum(usual, 1.0)
    shrink = np.sqrt(np.minimum(1.0, most / np.maximum(np.diag(wide), 1e-300)))
    x[kept] = known.x[kept]
    P[both] = shrink[:, None] * wide * shrink  # never wider than the prior, and still a covariance
