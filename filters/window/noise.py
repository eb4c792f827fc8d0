"""How noisy each channel really is, judged by steps from row to row: they do not see an offset or a motion.

A low quantile of the steps does not see outliers either, so that neither a patch nor a crowd of them looks
like noise. The result counts only where it leaves no doubt; a quieter channel keeps its stated sigma.
"""

import math

import numpy as np
from numba import njit

from filters.models.rows import CHANNELS, VE

QUANTILE = 0.25
LEVEL = 0.3186  # |N(0, 1)| is below it once in four
GAIN = 0.02  # natural log per row: ten seconds at 20 Hz change the scale by less than a factor of three
DOUBTLESS = 2.5  # times the stated sigma; a third of all rows being outliers reaches 1.9
ENOUGH = 6  # rows of a channel in the window


@njit(cache=True)
def follow(is_ins, sensor, channel, off, variance, begin, end, last, scale):
    """Follow the instruments' residuals slowly over rows ``begin`` to ``end``, in place.

    ``last`` (s, 13) holds residuals, ``scale`` (s, 13), ≥ 1, climbs or sinks a little with every row
    (stochastic quantile tracking, Tierney 1983).
    """
    for i in range(begin, end):
        s, c = sensor[i], channel[i]
        if is_ins[s]:
            continue
        step = abs(off[i] - last[s, c]) / math.sqrt(2.0 * variance[s, c])
        change = GAIN * QUANTILE if step > LEVEL * scale[s, c] else -GAIN * (1.0 - QUANTILE)
        scale[s, c] = max(1.0, scale[s, c] * math.exp(change))
        last[s, c] = off[i]


@njit(cache=True)
def shake(rows, begin, end, s, variance, scale):
    """Scale of INS ``s``'s velocities and accelerations in the window, from their second differences.

    Vibration comes within a second and is many times the stated sigma. ``scale`` (s, 13) and the window's
    ``rows.noise`` change in place.
    """
    for c in range(VE, len(CHANNELS)):
        at = np.array([i for i in range(begin, end) if rows.sensor[i] == s and rows.channel[i] == c])
        if len(at) < ENOUGH:
            continue
        x = rows.value[at]
        bend = np.abs(x[2:] - 2.0 * x[1:-1] + x[:-2])
        sigma = np.quantile(bend, QUANTILE) / (LEVEL * math.sqrt(6.0))
        scale[s, c] = max(1.0, sigma / math.sqrt(variance[s, c]))
        rows.noise[at] = variance[s, c] * (scale[s, c] ** 2 if scale[s, c] > DOUBTLESS else 1.0)


def effective(variance: np.ndarray, scale: np.ndarray) -> np.ndarray:
    """(s, 13) variances to work with."""
    return np.where(scale > DOUBTLESS, variance * scale**2, variance)
