"""What a radar sees: all that a theodolite does, and the range rate."""

import math

from numba import njit

from filters import theodolite
from filters.rows import RANGE_RATE


@njit(cache=True, fastmath=True)
def observe(channel, p, v, bend):
    """As ``theodolite.observe``; range rate m/s = p·v / |p|, positive when going away. In sensor ENU."""
    if channel == RANGE_RATE:
        return (p[0] * v[0] + p[1] * v[1] + p[2] * v[2]) / math.sqrt(p[0] ** 2 + p[1] ** 2 + p[2] ** 2)
    return theodolite.observe(channel, p, bend)
