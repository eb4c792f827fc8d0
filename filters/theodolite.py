"""What a theodolite sees: slant range, azimuth, elevation in its own ENU frame; a passive one has no range.

Refraction bends the line of sight: a target at distance d looks higher by k·d / (2 R_earth) radians.
Source: Torge & Müller, *Geodesy* (2012), 5.1.1; k = 0.13 for light, 0.25 for radar (the 4/3-Earth rule).
"""

import math

import numpy as np
from numba import njit

from filters.rows import AZIMUTH, RANGE

EARTH_RADIUS_M = 6371000.0
REFRACTION = {"none": 0.0, "optical": 0.13, "radar": 0.25}
ZERO_SIGMA = 5.0, np.radians(0.05), np.radians(0.05)  # priors in m, rad: set up with ordinary care
CLOCK_SIGMA_S = 0.1  # prior of the clock offset: a PC synchronised over the network


@njit(cache=True, fastmath=True)
def observe(channel, p, bend):
    """Range m, azimuth rad in (−π, π] or elevation rad of ``p`` (3,), sensor ENU; ``bend`` = k/2R."""
    flat = math.hypot(p[0], p[1])
    if channel == RANGE:
        return math.hypot(flat, p[2])
    if channel == AZIMUTH:
        return math.atan2(p[0], p[1])
    return math.atan2(p[2], flat) + bend * flat
