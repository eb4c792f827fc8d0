"""Other stories that the window's rows might tell: which rows to turn round before settling again.

Re-weighting finds the nearest explanation, which need not be the best: a run that was believed from its first
row on bends the track towards itself. So where something does not fit, its opposite is settled too, and the
story of lower cost wins.
"""

import numpy as np
from numba import njit

from filters.models import motion
from filters.models.rows import RANGE_RATE, VE
from filters.window import outlier

JUMP = 3.2  # sigmas of a used row's innovation that may be the beginning of a run
MOSTLY = 0.6  # refused share of a channel's rows that makes one doubt the others instead
TOTAL = 0.6  # refused share of all positions that makes one doubt the state itself
MARGIN = 4.0  # by which a rival's cost has to be lower
DEEP_MARGIN = 20.0  # the same for the rivals that turn everything round
JOLT_NS = 150_000_000  # refusals of several sensors so close together may be one abrupt motion
SLIDE = 30.0  # gain in −2 log likelihood that makes one ask whether a channel slides away
SLIDE_MARGIN = 10.0  # by which the story without it has to be better
MANY = 4  # rivals tried at most for jumps in one re-decision


@njit(cache=True)
def jumps(rows, begin, end, since, out):
    """(k, 2) spans ``since`` ≤ i ≤ … < j over which a channel may have been believed wrongly, by its first
    innovation."""
    spans, size, found = np.zeros((MANY, 2), np.int64), np.zeros(MANY), 0
    for i in range(since, end):
        z = out.v[i - begin] ** 2 / out.S[i - begin]
        if rows.weight[i] == 0.0 or z < JUMP**2:
            continue
        j, length = i + 1, 1
        while j < end:
            if rows.sensor[j] == rows.sensor[i] and rows.channel[j] == rows.channel[i]:
                if rows.weight[j] == 0.0 or out.v[j - begin] ** 2 / out.S[j - begin] > JUMP**2:
                    break
                length += 1
            j += 1
        if length < 2:
            continue
        k = found if found < MANY else size.argmin()
        if found == MANY and z <= size[k]:
            continue
        spans[k, 0], spans[k, 1], size[k] = i, j, z
        found = min(found + 1, MANY)
    return spans[:found]


def weights(rows, begin, end, fresh, out, sensors: int, deep: bool) -> list[tuple[np.ndarray, float]]:
    """Starting weights (end − begin,) and margin of each rival; rows from ``fresh`` on are new.

    ``deep`` asks for the costly ones too, and for old jumps again.
    """
    weight = rows.weight[begin:end]
    found = []
    for i, j in jumps(rows, begin, end, begin if deep else fresh, out):
        other, span = weight.copy(), slice(i - begin, j - begin)
        mine = (rows.sensor[i:j] == rows.sensor[i]) & (rows.channel[i:j] == rows.channel[i])
        other[span][mine] = 0.0
        found.append((other, MARGIN))
    if deep:
        for mine in lost(rows, begin, end, sensors):
            found.append((np.where(mine, 1.0, weight), DEEP_MARGIN))
        if disagreement(rows, begin, end):
            found.append((np.ones(end - begin), DEEP_MARGIN))
    return found


def jolt(rows, begin, end) -> int:
    """The row from which an abrupt motion would explain what several sensors were just refused for.

    ``end`` where there is no such thing: fewer than two sensors refused within JOLT_NS.
    """
    first = begin + int(np.searchsorted(rows.t[begin:end], rows.t[end - 1] - JOLT_NS))
    refused = first + np.flatnonzero((rows.weight[first:end] == 0.0) & (rows.jerk[first:end] < motion.JOLT))
    if (rows.sensor[refused] == rows.sensor[refused[:1]]).all():
        return end
    return int(refused[0])


def explained(rows, jolt, end) -> bool:
    """Whether the sensors agree on the jolt: of rows ``jolt`` to ``end`` at most one sensor's are refused."""
    return len(np.unique(rows.sensor[jolt:end][rows.weight[jolt:end] == 0.0])) < 2


def lost(rows, begin, end, sensors: int) -> list[np.ndarray]:
    """Rows (end − begin,) bool of each sensor's channels that are mostly refused, for those that have any."""
    sensor, channel = rows.sensor[begin:end], rows.channel[begin:end]
    refused = rows.weight[begin:end] == 0.0
    found = []
    for s in range(sensors):
        mine = np.zeros(end - begin, bool)
        for c in np.unique(channel[sensor == s]):
            one = (sensor == s) & (channel == c)
            if refused[one].sum() > max(MOSTLY * one.sum(), outlier.RUN):
                mine |= one
        if mine.any():
            found.append(mine)
    return found


def disagreement(rows, begin, end) -> bool:
    """Whether so much of what says where the target is has been refused that the state itself is in doubt."""
    channel = rows.channel[begin:end]
    refused = rows.weight[begin:end][(channel < VE) & (channel != RANGE_RATE)] == 0.0
    return len(refused) > outlier.RUN and refused.mean() > TOTAL
