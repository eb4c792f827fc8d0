"""The unscented transform over the part of the state that an instrument's channel depends on.

A channel depends on y = G x: the target's position at the instrument's true time (d = 3), or position and
velocity (d = 6, range rate). The rest of the state follows by Gaussian conditioning (Morelande & Moran 2007,
*Reducing the computational complexity of the UKF*, partially linear form; arXiv 2009.07571).
Spread √3, so W = 1/6 on each of the 2d points and 1 − d/3 on the centre: the full UKF with α = 1, β = 0,
κ = 3 − n has the same mean, variance and cross-covariance, because its other points leave y where it is.
Statistical linear regression turns that into a gradient: g = C⁻¹ cov(y, z), Ω = var z − gᵀ C g.
"""

import math

from filters.models import radar, theodolite
from filters.models.kernel import exact, kernel
from filters.models.rows import AZIMUTH, ELEVATION, RANGE

SPREAD = math.sqrt(3.0)
WIDE, DEEP = 0.1, 0.4  # of the distance: 1-sigma across and along the line of sight beyond which a channel
# bends too much for sigma points, or they reach behind the instrument
NOTHING = 1e30  # variance of what a range alone says while the place is not known at all
POSSIBLE = 5.0  # sigmas along the line of sight within which a prediction allows a place


@kernel
def wrap(angle):
    """The same angle in [−π, π], radians."""
    return angle - 2.0 * math.pi * math.floor((angle + math.pi) / (2.0 * math.pi))


@kernel
def difference(channel, a, b):
    """a − b in the channel's units; angles the short way round."""
    return wrap(a - b) if channel in (AZIMUTH, ELEVATION) else a - b


@kernel
def is_wide(channel, y, C, place, i, offset, s):
    """Whether position ``y``, ``C`` is too uncertain for sigma points around it, seen from sensor ``s``.

    Of a line of sight alone, along it no less than across: a target twice as far away that moves twice as
    wildly is as likely, so from a distance that is not known well the two lead each other anywhere.
    """
    a, b, c = y[0] - offset[s, 0], y[1] - offset[s, 1], y[2] - offset[s, 2]
    near, placed = a * a + b * b + c * c, place[i, 0] == place[i, 0]
    deep = DEEP if placed or channel == RANGE else WIDE
    if placed:
        a, b, c = place[i, 0] - offset[s, 0], place[i, 1] - offset[s, 1], place[i, 2] - offset[s, 2]
        near = min(near, a * a + b * b + c * c)
    scale = 1.0 / max(a * a + b * b + c * c, 1e-9)
    along = a * a * C[0] + b * b * C[2] + c * c * C[5] + 2.0 * (a * b * C[1] + a * c * C[3] + b * c * C[4])
    along *= scale
    across = C[0] + C[2] + C[5] - along
    return across > WIDE * WIDE * near or along > deep * deep * near


@kernel
def _is_possible(y, C, place, i, offset, s):
    """Whether row ``i`` has a place, and position ``y``, ``C`` may be as far from sensor ``s`` as that is."""
    a, b, c = place[i, 0] - offset[s, 0], place[i, 1] - offset[s, 1], place[i, 2] - offset[s, 2]
    far2 = max(a * a + b * b + c * c, 1e-9)
    along = a * a * C[0] + b * b * C[2] + c * c * C[5] + 2.0 * (a * b * C[1] + a * c * C[3] + b * c * C[4])
    gap = a * (place[i, 0] - y[0]) + b * (place[i, 1] - y[1]) + c * (place[i, 2] - y[2])
    return gap * gap <= POSSIBLE * POSSIBLE * along + DEEP * DEEP * far2 * far2


@kernel
def _pointed_at(channel, seen, y, C, offset, rotation, s):
    """Where an angle of sensor ``s`` points, a point (3) as far away as position ``y``, ``C`` is expected."""
    a, b, c = y[0] - offset[s, 0], y[1] - offset[s, 1], y[2] - offset[s, 2]
    far = math.sqrt(a * a + b * b + c * c + C[0] + C[2] + C[5])
    east, north, up = _turn(rotation, s, a, b, c)
    azimuth, elevation = math.atan2(east, north), math.atan2(up, math.sqrt(east * east + north * north))
    azimuth, elevation = (seen, elevation) if channel == AZIMUTH else (azimuth, seen)
    a, b, c = theodolite.line_of_sight(rotation, s, azimuth, elevation)
    return offset[s, 0] + far * a, offset[s, 1] + far * b, offset[s, 2] + far * c


@exact
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


@kernel
def transform_position(channel, y, C, offset, rotation, bend, s):
    """Mean and variance of a channel's value, and its gradient (3), where d = 3: the innermost loop.

    ``y`` (3) mean and ``C`` (6) covariance by rows of its lower half, station ENU, as tuples: arrays cost
    four times as much here. ``offset, rotation, bend``: the model's, of sensor ``s``.
    """
    l00 = math.sqrt(C[0]) if C[0] > 0.0 else 0.0
    i00 = 1.0 / l00 if l00 > 0.0 else 0.0
    l10, l20 = C[1] * i00, C[3] * i00
    rest = C[2] - l10 * l10
    l11 = math.sqrt(rest) if rest > 0.0 else 0.0
    i11 = 1.0 / l11 if l11 > 0.0 else 0.0
    l21 = (C[4] - l20 * l10) * i11
    rest = C[5] - l20 * l20 - l21 * l21
    l22 = math.sqrt(rest) if rest > 0.0 else 0.0
    i22 = 1.0 / l22 if l22 > 0.0 else 0.0
    p = _turn(rotation, s, y[0] - offset[s, 0], y[1] - offset[s, 1], y[2] - offset[s, 2])
    s0, mean0, square0 = _pair(channel, p, _turn(rotation, s, l00, l10, l20), bend[s])
    s1, mean1, square1 = _pair(channel, p, _turn(rotation, s, 0.0, l11, l21), bend[s])
    s2, mean2, square2 = _pair(channel, p, _turn(rotation, s, 0.0, 0.0, l22), bend[s])
    mean = mean0 + mean1 + mean2
    g2 = s2 * i22
    g1 = (s1 - l21 * g2) * i11
    g0 = (s0 - l10 * g1 - l20 * g2) * i00
    value = theodolite.observe(channel, p, bend[s]) + mean
    return value, square0 + square1 + square2 - mean * mean, (g0, g1, g2)


@kernel
def linear_position(channel, seen, y, C, place, i, offset, rotation, bend, s):
    """Innovation, variance and gradient (3) of a channel linearised at row ``i`` of ``place`` (k, 3).

    For a position so uncertain that sigma points around ``y`` would reach round the instrument: the
    measurement itself says better than the prediction where it was taken (iterated extended Kalman filter:
    Bell & Cathey 1993, with the measurement's own position as the point of linearisation).

    Where the row has no place, or one that the prediction does not allow, an angle is compared with the
    prediction, but does not move the state: how far away the target is decides how much it says, and a target
    taken to be at the instrument itself lies on every line of sight.
    """
    allowed = _is_possible(y, C, place, i, offset, s)
    if allowed or channel == RANGE:
        at = place[i, 0], place[i, 1], place[i, 2]
    else:
        at = _pointed_at(channel, seen, y, C, offset, rotation, s)
    p = _turn(rotation, s, at[0] - offset[s, 0], at[1] - offset[s, 1], at[2] - offset[s, 2])
    h = theodolite.gradient(channel, p, bend[s])
    g0 = rotation[s, 0, 0] * h[0] + rotation[s, 1, 0] * h[1] + rotation[s, 2, 0] * h[2]
    g1 = rotation[s, 0, 1] * h[0] + rotation[s, 1, 1] * h[1] + rotation[s, 2, 1] * h[2]
    g2 = rotation[s, 0, 2] * h[0] + rotation[s, 1, 2] * h[1] + rotation[s, 2, 2] * h[2]
    v = difference(channel, seen, theodolite.observe(channel, p, bend[s]))
    v -= g0 * (y[0] - at[0]) + g1 * (y[1] - at[1]) + g2 * (y[2] - at[2])
    variance = g0 * g0 * C[0] + g1 * g1 * C[2] + g2 * g2 * C[5]
    variance += 2.0 * (g0 * g1 * C[1] + g0 * g2 * C[3] + g1 * g2 * C[4])
    if v != v:
        return 0.0, NOTHING, (0.0, 0.0, 0.0)
    return v, variance, ((g0, g1, g2) if allowed else (0.0, 0.0, 0.0))


@kernel
def _pair(channel, p, column, bend):
    """What the two points on either side of ``p`` add: slope, mean, mean square, all relative to ``p``."""
    a, b, c = SPREAD * column[0], SPREAD * column[1], SPREAD * column[2]
    up = theodolite.step(channel, p, (a, b, c), bend)
    down = theodolite.step(channel, p, (-a, -b, -c), bend)
    return SPREAD * (up - down) / 6.0, (up + down) / 6.0, (up * up + down * down) / 6.0


@kernel
def _turn(rotation, s, a, b, c):
    return (
        rotation[s, 0, 0] * a + rotation[s, 0, 1] * b + rotation[s, 0, 2] * c,
        rotation[s, 1, 0] * a + rotation[s, 1, 1] * b + rotation[s, 1, 2] * c,
        rotation[s, 2, 0] * a + rotation[s, 2, 1] * b + rotation[s, 2, 2] * c,
    )


@kernel
def transform_rate(y, C, offset, rotation, s, g, work):
    """Mean and variance of the range rate; the gradient goes to ``g`` (6,).

    ``y`` (6,) mean and ``C`` (6, 6) covariance of position and velocity, station ENU; ``work`` (8, n).
    """
    L, moved, slope = work[:6], work[6], work[7]
    cholesky(C, L, 6)
    centre = _rate(y, offset, rotation, s)
    total = square = 0.0
    for k in range(6):
        for i in range(6):
            moved[i] = y[i] + SPREAD * L[i, k]
        up = _rate(moved, offset, rotation, s) - centre
        for i in range(6):
            moved[i] = y[i] - SPREAD * L[i, k]
        down = _rate(moved, offset, rotation, s) - centre
        slope[k] = SPREAD * (up - down) / 6.0
        total += (up + down) / 6.0
        square += (up * up + down * down) / 6.0
    for k in range(5, -1, -1):
        rest = slope[k]
        for i in range(k + 1, 6):
            rest -= L[i, k] * g[i]
        g[k] = rest / L[k, k] if L[k, k] > 0.0 else 0.0
    return centre + total, square - total * total


@kernel
def _rate(y, offset, rotation, s):
    p = _turn(rotation, s, y[0] - offset[s, 0], y[1] - offset[s, 1], y[2] - offset[s, 2])
    return radar.range_rate(p, _turn(rotation, s, y[3], y[4], y[5]))
