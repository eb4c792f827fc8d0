"""Where to begin: one fix out of a handful of rows, with nothing known before.

A fix is an INS position, or range, azimuth and elevation of one instrument, or azimuth and elevation of two.
It only places the start of the filter, with ten times its own uncertainty: the rows behind it are then
filtered like all others, so that nothing is lost and nothing counts twice by more than one percent.
"""

import numpy as np

from filters.models.model import prior_covariance
from filters.models.motion import CORE
from filters.models.rows import AZIMUTH, ELEVATION, RANGE, E, N, U

WIDER = 10.0
SLICES = 5  # of the window, each giving its own fixes
TRIED = 4  # fixes tried
SPEED_SIGMA_MPS = 30.0  # per axis: any UAV
ACCELERATION_SIGMA_MPS2 = 10.0


def fixes(model, sensor, channel, value) -> list[tuple[np.ndarray, float]]:
    """Every (position (3,) station ENU, 1-sigma m) that the rows allow, the surest first.

    ``sensor, channel, value`` (k,) are rows close together in time. Of repeated ones the last counts.
    """
    said = {(int(s), int(c)): float(v) for s, c, v in zip(sensor, channel, value, strict=True)}
    found, rays = [], []
    for s in range(len(model.is_ins)):
        if all((s, c) in said for c in (E, N, U)):
            zero = [model.prior[model.bias_at[s, c]] if model.bias_at[s, c] >= 0 else 0.0 for c in (E, N, U)]
            sigma = np.sqrt(np.max(model.variance[s, [E, N, U]] + zero))
            found.append((np.array([said[s, c] for c in (E, N, U)]), sigma))
        elif (s, AZIMUTH) in said and (s, ELEVATION) in said:
            ray = _ray(model, s, said[s, AZIMUTH], said[s, ELEVATION])
            if (s, RANGE) in said:
                found.append(_along(model, s, ray, said[s, RANGE]))
            rays.append((s, ray))
    for i, (a, ray_a) in enumerate(rays):
        for b, ray_b in rays[:i]:
            found += _crossing(model, a, ray_a, b, ray_b)
    return sorted(found, key=lambda fix: fix[1])


def _ray(model, s, azimuth, elevation):
    """Unit vector of the line of sight, station ENU."""
    flat = np.cos(elevation)
    local = np.array([flat * np.sin(azimuth), flat * np.cos(azimuth), np.sin(elevation)])
    return model.rotation[s].T @ local


def _angle_variance(model, s):
    zero = [
        model.prior[model.bias_at[s, c]] if model.bias_at[s, c] >= 0 else 0.0 for c in (AZIMUTH, ELEVATION)
    ]
    return np.max(model.variance[s, [AZIMUTH, ELEVATION]] + zero)


def _along(model, s, ray, distance):
    zero = model.prior[model.bias_at[s, RANGE]] if model.bias_at[s, RANGE] >= 0 else 0.0
    variance = model.variance[s, RANGE] + zero + distance**2 * _angle_variance(model, s)
    return model.offset[s] + distance * ray, float(np.sqrt(variance))


def _crossing(model, a, ray_a, b, ray_b):
    """The point nearest to both lines of sight, unless they are all but parallel or meet behind."""
    base, cosine = model.offset[b] - model.offset[a], ray_a @ ray_b
    sine2 = 1.0 - cosine**2
    if sine2 < 1e-4:
        return []
    along_a = (base @ ray_a - cosine * (base @ ray_b)) / sine2
    along_b = (cosine * (base @ ray_a) - base @ ray_b) / sine2
    if along_a <= 0.0 or along_b <= 0.0:
        return []
    variance = along_a**2 * _angle_variance(model, a) + along_b**2 * _angle_variance(model, b)
    middle = (model.offset[a] + along_a * ray_a + model.offset[b] + along_b * ray_b) / 2
    return [(middle, float(np.sqrt(variance / sine2)))]


def candidates(model, rows, begin, end, x, P) -> list[tuple[np.ndarray, np.ndarray]]:
    """States at the time of row ``begin`` around those fixes of the rows that most others support.

    Constant systematic errors keep what ``x, P`` know of them; the INS position error, which the lost state
    may have been leaning on, is open again.
    """
    t_s = (rows.t[begin:end] - rows.t[begin]) * 1e-9
    found = []
    for now in np.linspace(0.0, t_s[-1], SLICES):
        part = begin + np.flatnonzero(np.abs(t_s - now) <= t_s[-1] / SLICES)
        found += [
            (now, *fix) for fix in fixes(model, rows.sensor[part], rows.channel[part], rows.value[part])
        ]
    if not found:
        return []
    when = np.array([now for now, _, _ in found])
    where = np.array([position for _, position, _ in found])
    sigma = np.array([s for _, _, s in found])
    apart = np.linalg.norm(where[:, None] - where, axis=2)
    reach = 3 * (sigma[:, None] + sigma) + SPEED_SIGMA_MPS * np.abs(when[:, None] - when)
    support = (apart <= reach).sum(axis=1)
    known = CORE + np.flatnonzero(model.rate[CORE:] == 0.0)
    states = []
    for k in np.lexsort((sigma, -support))[:TRIED]:
        fresh_x, fresh_P = state(model, where[k], sigma[k] + SPEED_SIGMA_MPS * when[k] / WIDER)
        fresh_x[known] = x[known]
        fresh_P[np.ix_(known, known)] = P[np.ix_(known, known)]
        states.append((fresh_x, fresh_P))
    return states


def state(model, position, sigma) -> tuple[np.ndarray, np.ndarray]:
    """State (n,) and covariance (n, n) around a fix: at rest, with an open mind about speed."""
    n = len(model.prior)
    x, P = np.zeros(n), prior_covariance(model)
    x[:3] = position
    P[range(3), range(3)] = (WIDER * sigma) ** 2
    P[range(3, 6), range(3, 6)] = SPEED_SIGMA_MPS**2
    P[range(6, 9), range(6, 9)] = ACCELERATION_SIGMA_MPS2**2
    return x, P
