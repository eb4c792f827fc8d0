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
TOGETHER_NS = 100_000_000  # two lines of sight so close in time cross where the target is
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

    With a ``height_m`` known beforehand (else NaN), range and azimuth. It is no measurement of its own: it is
    where a prediction that is too wide is linearised, so that a start and a gap need no update of another
    kind. A channel that an instrument gives at another instant is that of up to `TOGETHER_NS` ago.
    """
    count, k = rows.t.size, begin
    while k < count:
        end = k + 1
        while end < count and rows.t[end] == rows.t[k] and rows.sensor[end] == rows.sensor[k]:
            end += 1
        s = rows.sensor[k]
        far = azimuth = elevation = math.nan
        i, missing = end - 1, 7  # bits: range, azimuth, elevation
        while i >= 0 and missing and not is_ins[s] and (i >= k or rows.t[k] - rows.t[i] <= TOGETHER_NS):
            if rows.sensor[i] == s and rows.channel[i] == RANGE and missing & 1:
                far, missing = rows.value[i], missing & ~1
            elif rows.sensor[i] == s and rows.channel[i] == AZIMUTH and missing & 2:
                azimuth, missing = rows.value[i], missing & ~2
            elif rows.sensor[i] == s and rows.channel[i] == ELEVATION and missing & 4:
                elevation, missing = rows.value[i], missing & ~4
            i -= 1
        if not is_ins[s]:
            if missing & 4 and not missing & 1 and height_m == height_m:
                elevation = math.asin(max(-1.0, min(1.0, (height_m - offset[s, 2]) / far)))
            flat = far * math.cos(elevation)
            a, b, c = flat * math.sin(azimuth), flat * math.cos(azimuth), far * math.sin(elevation)
            for i in range(k, end):
                for j in range(3):
                    rows.place[i, j] = (
                        offset[s, j] + rotation[s, 0, j] * a + rotation[s, 1, j] * b + rotation[s, 2, j] * c
                    )
        k = end


def line_of_sight(rotation: np.ndarray, azimuth: float, elevation: float) -> np.ndarray:
    """Unit vector, station ENU, of an instrument with ``rotation`` (3, 3) from there."""
    flat = np.cos(elevation)
    return rotation.T @ np.array([flat * np.sin(azimuth), flat * np.cos(azimuth), np.sin(elevation)])


def crossing(a: np.ndarray, ray_a: np.ndarray, b: np.ndarray, ray_b: np.ndarray) -> np.ndarray | None:
    """The point nearest to lines of sight from ``a`` and ``b`` (3,); none of parallel ones or behind them."""
    base, cosine = b - a, ray_a @ ray_b
    sine2 = 1.0 - cosine**2
    if sine2 < PARALLEL:
        return None
    along_a = (base @ ray_a - cosine * (base @ ray_b)) / sine2
    along_b = (cosine * (base @ ray_a) - base @ ray_b) / sine2
    if along_a <= 0.0 or along_b <= 0.0:
        return None
    return (a + along_a * ray_a + b + along_b * ray_b) / 2
