"""What a theodolite sees: slant range, azimuth, elevation in its own ENU frame; a passive one has no range.

Beside its noise each value has a slow error, a Gauss-Markov process: axes that are not quite where they
should be, the part of the target that is sighted, the air between. It is as large as the stated noise until
the rows tell more (`adaptation.follow_slow`). A zero error that is to be estimated is one with a larger
prior, nearly constant. Of six boats that a radar and a lidar saw, most of the error was slow, half of it
still there after 3 to 30 s.

Refraction bends the line of sight: a target at distance d looks higher by k·d / (2 R_earth) radians.
Source: Torge & Müller, *Geodesy* (2012), 5.1.1; k = 0.13 for light, 0.25 for radar (the 4/3-Earth rule).
"""

import math

import numpy as np

from filters.models.kernel import kernel
from filters.models.rows import AZIMUTH, ELEVATION, RANGE

EARTH_RADIUS_M = 6371000.0
REFRACTION = {"none": 0.0, "optical": 0.13, "radar": 0.25}
ZERO_SIGMA = 5.0, np.radians(0.05), np.radians(0.05)  # priors in m, rad: set up with ordinary care
PARALLEL = 1e-4  # squared sine of the angle between two lines of sight that do not cross
SLOW_TAU_S = 10.0  # correlation time of the slow errors
TOGETHER_NS = 100_000_000  # channels, and lines of sight, so close in time are of one place
CLOCK_SIGMA_S = 0.1  # prior of the clock offset: a PC synchronised over the network


@kernel
def observe(channel, p, bend):
    """Range m, azimuth rad in (−π, π] or elevation rad of ``p`` (3,), sensor ENU; ``bend`` = k/2R."""
    flat = math.sqrt(p[0] * p[0] + p[1] * p[1])
    if channel == RANGE:
        return math.sqrt(flat * flat + p[2] * p[2])
    if channel == AZIMUTH:
        return math.atan2(p[0], p[1])
    return math.atan2(p[2], flat) + bend * flat


@kernel
def gradient(channel, p, bend):
    """Derivative (3) of `observe` by ``p`` (3,)."""
    flat2 = p[0] * p[0] + p[1] * p[1]
    slant2 = flat2 + p[2] * p[2]
    flat, slant = math.sqrt(flat2), math.sqrt(slant2)
    if channel == RANGE:
        return p[0] / slant, p[1] / slant, p[2] / slant
    if channel == AZIMUTH:
        return p[1] / flat2, -p[0] / flat2, 0.0
    turn = bend / flat - p[2] / (slant2 * flat)
    return p[0] * turn, p[1] * turn, flat / slant2


@kernel
def step(channel, p, e, bend):
    """`observe` of ``p`` + ``e`` minus that of ``p``, without a difference's cancellation and wrap."""
    flat2 = p[0] * p[0] + p[1] * p[1]
    flat_gain = 2.0 * (p[0] * e[0] + p[1] * e[1]) + e[0] * e[0] + e[1] * e[1]
    if channel == RANGE:
        gain = flat_gain + e[2] * (2.0 * p[2] + e[2])
        square = flat2 + p[2] * p[2]
        slant, moved = math.sqrt(square), math.sqrt(max(square + gain, 0.0))
        return gain / (moved + slant) if slant > 0.0 else moved
    if channel == AZIMUTH:
        return _angle(e[0] * p[1] - e[1] * p[0], flat2 + p[0] * e[0] + p[1] * e[1])
    flat, moved = math.sqrt(flat2), math.sqrt(max(flat2 + flat_gain, 0.0))
    out = flat_gain / (moved + flat) if flat > 0.0 else moved
    turned = _angle(e[2] * flat - p[2] * out, p[2] * (p[2] + e[2]) + flat * moved)
    return turned + bend * out


@kernel
def _angle(sine, cosine):
    """atan2; where the angle is small, by its series to the last bit, as it is nearly always here."""
    t = sine / cosine if cosine > 0.0 else 1.0
    t2 = t * t
    if t2 > 1.0 / 256.0:
        return math.atan2(sine, cosine)
    return t * (1.0 - t2 * (1 / 3 - t2 * (1 / 5 - t2 * (1 / 7 - t2 * (1 / 9 - t2 * (1 / 11 - t2 / 13))))))


@kernel
def places(rows, offset, rotation, is_ins, height_m, begin):
    """Fill ``rows.place`` from row ``begin`` on: the position that range, azimuth and elevation stand for.

    With a ``height_m`` known beforehand (else NaN), range and azimuth. Where there is no range, the crossing
    with another instrument's line of sight, of those that cross most nearly at a right angle. It is no
    measurement of its own: it is where a prediction that is too wide is linearised, so that a start and a gap
    need no update of another kind. A channel that an instrument gives at another instant is that of up to
    `TOGETHER_NS` ago.
    """
    count, k = rows.t.size, begin
    while k < count:
        end, s = k + 1, rows.sensor[k]
        while end < count and rows.t[end] == rows.t[k] and rows.sensor[end] == s:
            end += 1
        if not is_ins[s]:
            far = _newest(rows, s, RANGE, k, end)
            if far == far:
                azimuth, elevation = _newest(rows, s, AZIMUTH, k, end), _newest(rows, s, ELEVATION, k, end)
                if elevation != elevation and height_m == height_m:
                    elevation = math.asin(max(-1.0, min(1.0, (height_m - offset[s, 2]) / far)))
                a, b, c = line_of_sight(rotation, s, azimuth, elevation)
                place = offset[s, 0] + far * a, offset[s, 1] + far * b, offset[s, 2] + far * c
            else:
                place = _widest_crossing(rows, s, k, end, offset, rotation, is_ins, height_m)
            for i in range(k, end):
                rows.place[i, 0], rows.place[i, 1], rows.place[i, 2] = place
        k = end


@kernel
def _newest(rows, s, channel, k, end):
    """The newest value of a channel of sensor ``s`` before row ``end``, not long before row ``k``; or NaN."""
    i = end - 1
    while i >= 0 and (i >= k or rows.t[k] - rows.t[i] <= TOGETHER_NS):
        if rows.sensor[i] == s and rows.channel[i] == channel:
            return rows.value[i]
        i -= 1
    return math.nan


@kernel
def _widest_crossing(rows, s, k, end, offset, rotation, is_ins, height_m):
    """Where the line of sight of ``s`` crosses another one at row ``k``; NaN where there is none."""
    widest, place = 0.0, (math.nan, math.nan, math.nan)
    ray = _sighted(rows, s, k, end, rotation, height_m)
    for other in range(len(is_ins)):
        if other != s and not is_ins[other]:
            sine2, crossed = crossing(
                offset, s, ray, other, _sighted(rows, other, k, end, rotation, height_m)
            )
            if sine2 > widest:
                widest, place = sine2, crossed
    return place


@kernel
def _sighted(rows, s, k, end, rotation, height_m):
    """Direction in which sensor ``s`` sees the target at row ``k``; with a height known, level if need be."""
    elevation = _newest(rows, s, ELEVATION, k, end)
    if elevation != elevation and height_m == height_m:
        elevation = 0.0
    return line_of_sight(rotation, s, _newest(rows, s, AZIMUTH, k, end), elevation)


@kernel
def line_of_sight(rotation, s, azimuth, elevation):
    """Unit vector (3), station ENU, of instrument ``s`` with ``rotation`` (s, 3, 3) from there."""
    flat, up = math.cos(elevation), math.sin(elevation)
    east, north = flat * math.sin(azimuth), flat * math.cos(azimuth)
    return (
        rotation[s, 0, 0] * east + rotation[s, 1, 0] * north + rotation[s, 2, 0] * up,
        rotation[s, 0, 1] * east + rotation[s, 1, 1] * north + rotation[s, 2, 1] * up,
        rotation[s, 0, 2] * east + rotation[s, 1, 2] * north + rotation[s, 2, 2] * up,
    )


@kernel
def crossing(offset, a, ray_a, b, ray_b):
    """Squared sine of the angle between lines of sight from instruments ``a`` and ``b``, and the point (3)
    nearest to both; 0 of parallel ones, where it is behind one of them, and where one is NaN.
    """
    base = offset[b, 0] - offset[a, 0], offset[b, 1] - offset[a, 1], offset[b, 2] - offset[a, 2]
    cosine = ray_a[0] * ray_b[0] + ray_a[1] * ray_b[1] + ray_a[2] * ray_b[2]
    sine2 = 1.0 - cosine * cosine
    if sine2 >= PARALLEL:
        by_a = base[0] * ray_a[0] + base[1] * ray_a[1] + base[2] * ray_a[2]
        by_b = base[0] * ray_b[0] + base[1] * ray_b[1] + base[2] * ray_b[2]
        along_a, along_b = (by_a - cosine * by_b) / sine2, (cosine * by_a - by_b) / sine2
        if along_a > 0.0 and along_b > 0.0:
            half_a, half_b = 0.5 * along_a, 0.5 * along_b
            return sine2, (
                0.5 * (offset[a, 0] + offset[b, 0]) + half_a * ray_a[0] + half_b * ray_b[0],
                0.5 * (offset[a, 1] + offset[b, 1]) + half_a * ray_a[1] + half_b * ray_b[1],
                0.5 * (offset[a, 2] + offset[b, 2]) + half_a * ray_a[2] + half_b * ray_b[2],
            )
    return 0.0, (math.nan, math.nan, math.nan)
