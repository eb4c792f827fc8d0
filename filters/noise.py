"""How noisy each channel really is: a slow, robust scale of its residuals' steps from row to row.

Steps do not see an offset, and a low quantile of them does not see outliers, so that neither a patch nor a
crowd of outliers looks like noise. The scale climbs or sinks a little with every row (stochastic quantile
tracking, Tierney 1983) and counts only where it leaves no doubt; a quieter channel keeps its stated sigma.
"""

import math

import numpy as np
from numba import njit

QUANTILE = 0.25
LEVEL = 0.3186  # |N(0, 1)| is below it once in four
GAIN = 0.02  # natural log per row: ten seconds at 20 Hz change the scale by less than a factor of three
DOUBTLESS = 2.5  # times the stated sigma; a third of all rows being outliers reaches 1.9


@njit(cache=True)
def follow(sensor, channel, off, variance, begin, end, last, scale):
    """Follow rows ``begin`` to ``end``: ``last`` (s, 13) residuals and ``scale`` (s, 13), ≥ 1, change in place."""
    for i in range(begin, end):
        s, c = sensor[i], channel[i]
        step = abs(off[i] - last[s, c]) / math.sqrt(2.0 * variance[s, c])
        change = GAIN * QUANTILE if step > LEVEL * scale[s, c] else -GAIN * (1.0 - QUANTILE)
        scale[s, c] = max(1.0, scale[s, c] * math.exp(change))
        last[s, c] = off[i]


def effective(variance: np.ndarray, scale: np.ndarray) -> np.ndarray:
    """(s, 13) variances to work with."""
    return np.where(scale > DOUBTLESS, variance * scale**2, variance)
