"""Protection levels: how wrong the state may be although any one sensor lies.

Solution separation (Brown & McBurney 1988; Blanch et al. 2015, *Baseline advanced RAIM user algorithm*): for
each sensor, a second estimator goes on without it. Where that sensor lies, the error is at most the distance
between the two states plus the error of the one without it, which is K of its own sigmas at the stated risk.

    level = max over sensors ( |x − x₍₋ₛ₎| + K σ₍₋ₛ₎ )

The distances themselves are told too: each says how much the state rests on that sensor.
"""

import math

import numpy as np

from filters.models.kernel import kernel
from filters.models.rows import SEPARATION

RISK = 1e-5  # of an error beyond the level, shared by all sensors
LEVEL_K = 4.75  # sigmas: two-sided normal at RISK / 5 sensors


def enter(track: np.ndarray, apart: list[tuple[np.ndarray, np.ndarray] | None]) -> np.ndarray:
    """Fill the protection levels of ``track`` (k,) TRACK, in place.

    ``apart`` has for each sensor the states (k, ≥3) and covariances (k, ≥3, ≥3) without it, None where there
    is no state without it: then there is no bound. Returns (k,) bool, the test of solution separation: where
    one of those states is more than K of its own sigmas away.
    """
    elsewhere, levels = np.zeros(len(track), bool), np.zeros((2, len(track)))
    if not apart or any(one is None for one in apart):
        levels[:] = np.inf
    else:
        x, P = np.ascontiguousarray(track["x"]), np.ascontiguousarray(track["P"])
        for one in ((x, P), *apart):  # of itself it is no distance away
            _raise(x, *one, levels, elsewhere)
    track["protection_h_m"], track["protection_v_m"] = levels
    return elsewhere


@kernel
def _raise(x, other, P, levels, elsewhere):
    """Raise ``levels`` (2, k) of states ``x`` to what those without a sensor, ``other`` and ``P``, allow."""
    for k in range(len(x)):
        a, b, c = x[k, 0] - other[k, 0], x[k, 1] - other[k, 1], x[k, 2] - other[k, 2]
        gap_h, gap_v = math.sqrt(a * a + b * b), abs(c)
        bound_h, bound_v = LEVEL_K * _horizontal(P[k]), LEVEL_K * _sigma(P[k, 2, 2])
        levels[0, k], levels[1, k] = max(levels[0, k], gap_h + bound_h), max(levels[1, k], gap_v + bound_v)
        elsewhere[k] |= gap_h > bound_h or gap_v > bound_v


@kernel
def _horizontal(P):
    """1 sigma in the horizontal direction known least."""
    a, b, c = P[0, 0], P[1, 1], P[0, 1]
    return _sigma(0.5 * (a + b) + math.sqrt(0.25 * (a - b) * (a - b) + c * c))


@kernel
def _sigma(variance):
    """Of a variance that rounding has spoilt nothing is known, so it bounds nothing."""
    return math.sqrt(variance) if variance >= 0.0 else math.inf


def separation(track: np.ndarray, sensor: int, position: np.ndarray, covariance: np.ndarray) -> np.ndarray:
    """(k,) SEPARATION of ``track`` (k,) TRACK from the states (k, ≥3), (k, ≥3, ≥3) without ``sensor``."""
    out = np.zeros(len(track), SEPARATION)
    out["t_ns"], out["sensor"] = track["t_ns"], sensor
    gap = track["x"][:, :3] - position[:, :3]
    out["horizontal_m"], out["vertical_m"] = np.hypot(gap[:, 0], gap[:, 1]), np.abs(gap[:, 2])
    out["sigma_h_m"] = [_horizontal(P) for P in covariance]
    out["sigma_v_m"] = np.sqrt(covariance[:, 2, 2])
    return out
