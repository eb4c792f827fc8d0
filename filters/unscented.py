"""The unscented transform over the part of the state that an instrument's channel depends on.

A channel depends on y = G x: the target's position at the instrument's true time (d = 3), or position and
velocity (d = 6, range rate). The rest of the state follows by Gaussian conditioning (Morelande & Moran 2007,
*Reducing the computational complexity of the UKF*, partially linear form; arXiv 2009.07571).
Spread √3, so W = 1/6 on each of the 2d points and 1 − d/3 on the centre: the full UKF with α = 1, β = 0,
κ = 3 − n has the same mean, variance and cross-covariance, because its other points leave y where it is.
Statistical linear regression turns that into a gradient: g = C⁻¹ cov(y, z), Ω = var z − gᵀ C g.
"""

import math

from numba import njit

from filters import radar, theodolite
from filters.rows import AZIMUTH, ELEVATION

SPREAD = math.sqrt(3.0)


@njit(cache=True, fastmath=True)
def wrap(angle):
    """The same angle in [−π, π], radians."""
    return angle - 2.0 * math.pi * math.floor((angle + math.pi) / (2.0 * math.pi))


@njit(cache=True, fastmath=True)
def difference(channel, a, b):
    """a − b in the channel's units; angles the short way round."""
    return wrap(a - b) if channel in (AZIMUTH, ELEVATION) else a - b


@njit(cache=True)
def cholesky(C, L, d):
    """Lower factor of the leading d×d block of ``C`` into ``L``; a diagonal lost to rounding is zero."""
    for j in range(d):
        for i in range(j):
            L[i, j] = 0.0
        for i in range(j, d):
            s = C[i, j]
            for k in range(j):
                s -= L[i, k] * L[j, k]
            if i == j:
                L[j, j] = math.sqrt(s) if s > 0.0 else 0.0
            else:
                L[i, j] = s / L[j, j] if L[j, j] > 0.0 else 0.0


@njit(cache=True, fastmath=True)
def _measure(channel, y, offset, rotation, bend, d):
    p0, p1, p2 = y[0] - offset[0], y[1] - offset[1], y[2] - offset[2]
    p = (
        rotation[0, 0] * p0 + rotation[0, 1] * p1 + rotation[0, 2] * p2,
        rotation[1, 0] * p0 + rotation[1, 1] * p1 + rotation[1, 2] * p2,
        rotation[2, 0] * p0 + rotation[2, 1] * p1 + rotation[2, 2] * p2,
    )
    if d == 3:
        return radar.observe(channel, p, p, bend)
    v = (
        rotation[0, 0] * y[3] + rotation[0, 1] * y[4] + rotation[0, 2] * y[5],
        rotation[1, 0] * y[3] + rotation[1, 1] * y[4] + rotation[1, 2] * y[5],
        rotation[2, 0] * y[3] + rotation[2, 1] * y[4] + rotation[2, 2] * y[5],
    )
    return radar.observe(channel, p, v, bend)


@njit(cache=True, fastmath=True)
def transform_position(channel, y, C, offset, rotation, bend, g):
    """`transform` where d = 3, in scalars: the inner loop of everything, and four times as fast."""
    l00 = math.sqrt(C[0, 0]) if C[0, 0] > 0.0 else 0.0
    i00 = 1.0 / l00 if l00 > 0.0 else 0.0
    l10, l20 = C[1, 0] * i00, C[2, 0] * i00
    rest = C[1, 1] - l10 * l10
    l11 = math.sqrt(rest) if rest > 0.0 else 0.0
    i11 = 1.0 / l11 if l11 > 0.0 else 0.0
    l21 = (C[2, 1] - l20 * l10) * i11
    rest = C[2, 2] - l20 * l20 - l21 * l21
    l22 = math.sqrt(rest) if rest > 0.0 else 0.0
    i22 = 1.0 / l22 if l22 > 0.0 else 0.0
    p = _turn(rotation, y[0] - offset[0], y[1] - offset[1], y[2] - offset[2])
    centre = theodolite.observe(channel, p, bend)
    total = square = extra = s0 = s1 = s2 = 0.0
    for k in range(3):
        a, b, c = (l00, l10, l20) if k == 0 else ((0.0, l11, l21) if k == 1 else (0.0, 0.0, l22))
        e = _turn(rotation, SPREAD * a, SPREAD * b, SPREAD * c)
        up = theodolite.observe(channel, (p[0] + e[0], p[1] + e[1], p[2] + e[2]), bend)
        down = theodolite.observe(channel, (p[0] - e[0], p[1] - e[1], p[2] - e[2]), bend)
        up, down = difference(channel, up, centre), difference(channel, down, centre)
        slope = SPREAD * (up - down) / 6.0
        total += (up + down) / 6.0
        square += (up * up + down * down) / 6.0
        extra -= slope * slope
        if k == 0:
            s0 = slope
        elif k == 1:
            s1 = slope
        else:
            s2 = slope
    g[2] = s2 * i22
    g[1] = (s1 - l21 * g[2]) * i11
    g[0] = (s0 - l10 * g[1] - l20 * g[2]) * i00
    return centre + total, extra + square - total * total


@njit(cache=True, fastmath=True)
def _turn(rotation, a, b, c):
    return (
        rotation[0, 0] * a + rotation[0, 1] * b + rotation[0, 2] * c,
        rotation[1, 0] * a + rotation[1, 1] * b + rotation[1, 2] * c,
        rotation[2, 0] * a + rotation[2, 1] * b + rotation[2, 2] * c,
    )


@njit(cache=True, fastmath=True)
def transform(channel, y, C, offset, rotation, bend, d, g, work):
    """Mean of the channel's value, and Ω; the gradient goes to ``g`` (d,).

    ``y`` (d,) mean and ``C`` (d, d) covariance, station ENU; ``work`` (d + 2, d) scratch.
    """
    L, moved, slope = work[:d], work[d], work[d + 1]
    cholesky(C, L, d)
    centre = _measure(channel, y, offset, rotation, bend, d)
    total = square = 0.0
    for k in range(d):
        for i in range(d):
            moved[i] = y[i] + SPREAD * L[i, k]
        up = difference(channel, _measure(channel, moved, offset, rotation, bend, d), centre)
        for i in range(d):
            moved[i] = y[i] - SPREAD * L[i, k]
        down = difference(channel, _measure(channel, moved, offset, rotation, bend, d), centre)
        slope[k] = SPREAD * (up - down) / 6.0
        total += (up + down) / 6.0
        square += (up * up + down * down) / 6.0
    extra = square - total * total
    for k in range(d):
        extra -= slope[k] * slope[k]
    for k in range(d - 1, -1, -1):
        s = slope[k]
        for i in range(k + 1, d):
            s -= L[i, k] * g[i]
        g[k] = s / L[k, k] if L[k, k] > 0.0 else 0.0
    return centre + total, extra
