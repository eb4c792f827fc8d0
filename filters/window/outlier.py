"""The judgement of one value: how far off, how much weight, and the word for it.

Weights are IGG-III's, `update.weight`, from SOFT to HARD.
"""

import math

from numba import njit

from filters.models.kernel import exact
from filters.models.rows import DEWEIGHTED, ISOLATED, PATCH, USED

HARD = 4.5  # sigmas; a normal value is beyond once in 150,000, an outlier of 6 sigma is inside once in 15
SOFT = 3.5  # sigmas; between the two a value keeps part of its weight, so that a decision does not flip
AFTER = 3.0  # sigmas allowed to a value whose predecessor was an outlier: they come in runs
BOUND = 1.5  # noise sigmas: in a run, a sigma beyond this has grown for want of the refused rows themselves
JUMP = 4.5  # noise sigmas between two residuals, more than which is no longer the same run
RUN = 3  # consecutive outliers of one channel make a patch

REASONS = (
    "",
    "innovation",  # too far from what everything else says
    "run",  # one of RUN or more consecutive ones
    "ambiguous",  # no third witness tells which side is right
    "not a number",
    "sensor has no such channel",
    "same time and channel twice",
    "older than the window",
    "no state yet",
)
NONE, INNOVATION, IN_RUN, AMBIGUOUS, NOT_FINITE, NO_CHANNEL, TWICE, TOO_OLD, NO_STATE = range(len(REASONS))


@exact
def same_run(refused, off, noise):
    """Whether residual ``off`` may continue the run of the ``refused`` one beside it; ``noise``: 1-sigma."""
    return abs(refused) > AFTER * noise and abs(off - refused) < JUMP * math.sqrt(2.0) * noise


@njit(cache=True)
def label(sensor, channel, weight, off, verdict, reason, begin, end, run, alone):
    """Name what was done with rows ``begin`` to ``end`` by their weights; fills ``verdict`` and ``reason``.

    ``off`` are the residuals. ``run`` (s, 13, 2) is, for each channel up to ``begin``, the count of
    consecutive outliers and the last one's residual; moved on to ``end``, in place. ``alone`` (s,) says
    which sensors had fewer than two others to contradict them.
    """
    for i in range(begin, end):
        s, c = sensor[i], channel[i]
        if weight[i] > 0.0:
            run[s, c, 0] = 0.0
            verdict[i] = USED if weight[i] >= 1.0 else DEWEIGHTED
            reason[i] = NONE if weight[i] >= 1.0 else INNOVATION
            continue
        run[s, c, 0] += 1.0
        run[s, c, 1] = off[i]
        verdict[i], reason[i] = ISOLATED, INNOVATION
        if run[s, c, 0] < RUN:
            continue
        left, k = run[s, c, 0], i
        while left > 0 and k >= begin:
            if sensor[k] == s and channel[k] == c:
                left -= 1
                if verdict[k] == PATCH:
                    left = 0
                verdict[k], reason[k] = PATCH, AMBIGUOUS if alone[s] else IN_RUN
            k -= 1
