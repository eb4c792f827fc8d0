"""Protection levels: how wrong the state may be although any one sensor lies.

Solution separation (Brown & McBurney 1988; Blanch et al. 2015, *Baseline advanced RAIM user algorithm*): for
each sensor, a second estimator goes on without it. Where that sensor lies, the error is at most the distance
between the two states plus the error of the one without it, which is K of its own sigmas at the stated risk.

    level = max over sensors ( |x − x₍₋ₛ₎| + K σ₍₋ₛ₎ )

The distances themselves are told too: each says how much the state rests on that sensor.
"""

import numpy as np

from filters.models.rows import SEPARATION

RISK = 1e-5  # of an error beyond the level, shared by all sensors
LEVEL_K = 4.75  # sigmas: two-sided normal at RISK / 5 sensors


def enter(track: np.ndarray, apart: list[tuple[np.ndarray, np.ndarray] | None]) -> np.ndarray:
    """Fill the protection levels of ``track`` (k,) TRACK, in place.

    ``apart`` has for each sensor the positions (k, 3) and covariances (k, 3, 3) without it, None where there
    is no state without it: then there is no bound. Returns (k,) bool, the test of solution separation: where
    one of those states is more than K of its own sigmas away.
    """
    if not apart or any(one is None for one in apart):
        track["protection_h_m"] = track["protection_v_m"] = np.inf
        return np.zeros(len(track), bool)
    own = track["x"][:, :3], track["P"][:, :3, :3]  # of itself it is no distance away
    position, covariance = (np.stack(both) for both in zip(own, *apart, strict=True))
    gap_h, gap_v = _distances(track["x"], position)
    sigma_h, sigma_v = _sigmas(covariance)
    track["protection_h_m"] = (gap_h + LEVEL_K * sigma_h).max(axis=0)
    track["protection_v_m"] = (gap_v + LEVEL_K * sigma_v).max(axis=0)
    return ((gap_h > LEVEL_K * sigma_h) | (gap_v > LEVEL_K * sigma_v)).any(axis=0)


def separation(track: np.ndarray, sensor: int, position: np.ndarray, covariance: np.ndarray) -> np.ndarray:
    """(k,) SEPARATION of ``track`` (k,) TRACK from the positions (k, 3), (k, 3, 3) without ``sensor``."""
    out = np.zeros(len(track), SEPARATION)
    out["t_ns"], out["sensor"] = track["t_ns"], sensor
    out["horizontal_m"], out["vertical_m"] = _distances(track["x"], position)
    out["sigma_h_m"], out["sigma_v_m"] = _sigmas(covariance)
    return out


def _distances(x: np.ndarray, position: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Horizontally (…, k) and in height (…, k), between states (k, ≥3) and positions (…, k, 3)."""
    gap = x[:, :3] - position
    return np.hypot(gap[..., 0], gap[..., 1]), np.abs(gap[..., 2])


def _sigmas(covariance: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Largest horizontal 1-sigma (…, k) and vertical one (…, k) of position covariances (…, k, 3, 3)."""
    a, b, c = covariance[..., 0, 0], covariance[..., 1, 1], covariance[..., 0, 1]
    largest = 0.5 * (a + b) + np.sqrt(0.25 * (a - b) ** 2 + c**2)
    return np.sqrt(largest), np.sqrt(covariance[..., 2, 2])
