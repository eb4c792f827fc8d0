"""Where to begin: what the instruments themselves say about the place, with nothing known before.

`places` gives every measurement of range, azimuth and elevation the position that it stands for (with a
height known beforehand, of range and azimuth). It is no measurement of its own: it is where a prediction that
is too wide is linearised, so that a start and a gap need no update of another kind. `candidates` are first
states around such places, and around the crossings of two lines of sight.
"""

import math

import numpy as np

from filters.models.kernel import kernel
from filters.models.motion import CORE
from filters.models.rows import AZIMUTH, ELEVATION, RANGE, VE, E, N, U
from filters.models.state import Model, prior_covariance
from filters.smoother.buffer import Rows

PLACE_SIGMA_M, PLACE_SHARE = 1e3, 0.3  # of a first state about its place, m, and share of the distance: much
# more than the place is worth, and not so much that the covariance loses its digits
NEAR = 0.05  # of the distance: the same where only crossing lines of sight say it, which bend beyond
SPEED_SIGMA_MPS = 300.0  # … about what its own places show
ACCELERATION_SIGMA_MPS2 = 20.0
TOGETHER_NS = 100_000_000  # two lines of sight so close in time cross where the target is
PARALLEL = 1e-4  # squared sine of the angle between two lines of sight that do not cross


@kernel
def places(rows, offset, rotation, is_ins, height_m, begin):
    """Fill ``rows.place`` from row ``begin`` on; ``height_m`` NaN: none known beforehand.

    A channel that an instrument gives at another instant is that of up to `TOGETHER_NS` ago.
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


def fixes(model: Model, rows: Rows, height_m: float) -> np.ndarray:
    """(f, 5) sensor, time (s from the first row) and position (3,) m station ENU that the rows allow.

    Of an INS, of an instrument alone, and of two lines of sight (sensor: the first one's).
    """
    t_s, found, rays = (rows.t - rows.t[0]) * 1e-9, [], []
    first = np.flatnonzero(np.diff(rows.t, prepend=-1) | np.diff(rows.sensor, prepend=-1))
    for k, end in zip(first, np.append(first[1:], len(rows.t)), strict=True):
        s, said = int(rows.sensor[k]), dict(zip(rows.channel[k:end].tolist(), rows.value[k:end], strict=True))
        if model.is_ins[s]:
            if E in said and N in said and U in said:
                found.append((s, t_s[k], said[E], said[N], said[U]))
        elif np.isfinite(rows.place[k, 0]):
            found.append((s, t_s[k], *rows.place[k]))
        elif AZIMUTH in said and ELEVATION in said:
            rays.append((s, t_s[k], _ray(model, s, said[AZIMUTH], said[ELEVATION])))
        elif AZIMUTH in said and np.isfinite(height_m):
            rays.append((s, t_s[k], _ray(model, s, said[AZIMUTH], 0.0)))
    for i, (a, when, ray) in enumerate(rays):
        for b, then, other in rays[max(0, i - 8) : i]:
            if a != b and when - then <= TOGETHER_NS * 1e-9:
                cross = _crossing(model, a, ray, b, other)
                if cross is not None:
                    found.append((min(a, b), when, *cross))
    return np.array(found).reshape(-1, 5)


def _ray(model, s, azimuth, elevation):
    """Unit vector of the line of sight, station ENU."""
    flat = np.cos(elevation)
    local = np.array([flat * np.sin(azimuth), flat * np.cos(azimuth), np.sin(elevation)])
    return model.rotation[s].T @ local


def _crossing(model, a, ray_a, b, ray_b):
    """The point nearest to both lines of sight, unless they are all but parallel or meet behind."""
    base, cosine = model.offset[b] - model.offset[a], ray_a @ ray_b
    sine2 = 1.0 - cosine**2
    if sine2 < PARALLEL:
        return None
    along_a = (base @ ray_a - cosine * (base @ ray_b)) / sine2
    along_b = (cosine * (base @ ray_a) - base @ ray_b) / sine2
    if along_a <= 0.0 or along_b <= 0.0:
        return None
    return (model.offset[a] + along_a * ray_a + model.offset[b] + along_b * ray_b) / 2


def candidates(
    model: Model, rows: Rows, height_m: float, height_sigma_m: float
) -> list[tuple[int, np.ndarray, np.ndarray]]:
    """(sensor, x (n,), P (n, n)) at the time of the first row: one first state for every sensor with a fix.

    Position and velocity are the middle of what its own fixes show; their sigmas know of nothing.
    """
    all_fixes, out = fixes(model, rows, height_m), []
    for s in np.unique(all_fixes[:, 0]).astype(int):
        own = all_fixes[all_fixes[:, 0] == s]
        place, velocity = _line(own[:, 1], own[:, 2:])
        told = (rows.sensor == s) & (rows.channel >= VE) & (rows.channel < VE + 3)
        for axis in range(3):
            values = rows.value[told & (rows.channel == VE + axis)]
            velocity[axis] = np.median(values) if len(values) else velocity[axis]
        mine = rows.sensor == s
        alone = model.is_ins[s] or np.isfinite(rows.place[mine, 0]).any()
        distance = 0.0 if model.is_ins[s] else np.linalg.norm(place - model.offset[s])
        sigma_m = max(PLACE_SIGMA_M, PLACE_SHARE * distance) if alone else NEAR * distance
        out.append((s, *state(model, place, sigma_m, velocity, height_m, height_sigma_m)))
    return out


def _line(t_s: np.ndarray, p: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Position at t = 0 and velocity, (3,) each: medians of slopes and offsets (Theil 1950, Sen 1968)."""
    use = np.linspace(0, len(t_s) - 1, min(len(t_s), 30)).astype(int)
    t_s, p = t_s[use], p[use]
    i, j = np.triu_indices(len(t_s), 1)
    apart = t_s[j] - t_s[i]
    far = apart >= 0.3 * max(apart.max(initial=0.0), 1e-9)
    if not far.any() or apart.max() <= 0.0:
        return np.median(p, axis=0), np.zeros(3)
    velocity = np.median((p[j] - p[i])[far] / apart[far, None], axis=0)
    return np.median(p - t_s[:, None] * velocity, axis=0), velocity


def state(
    model: Model,
    place: np.ndarray,
    sigma_m: float,
    velocity: np.ndarray,
    height_m: float,
    height_sigma_m: float,
) -> tuple[np.ndarray, np.ndarray]:
    """State (n,) and covariance (n, n) around a place, with an open mind."""
    n = len(model.prior)
    x, P = np.zeros(n), prior_covariance(model)
    x[:3], x[3:6] = place, velocity
    P[range(3), range(3)] = sigma_m**2
    if np.isfinite(height_m):
        x[2], P[2, 2] = height_m, height_sigma_m**2
    P[range(3, 6), range(3, 6)] = SPEED_SIGMA_MPS**2
    P[range(6, CORE), range(6, CORE)] = ACCELERATION_SIGMA_MPS2**2
    if np.isfinite(height_m):  # and keeps it
        x[5], P[5, 5], P[8, 8] = 0.0, 0.0, 0.0
    return x, P
