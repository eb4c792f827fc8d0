"""What the GA-BP-UKF paper compares itself with, and two more everybody knows.

The trajectory filters share one shape: measurements (n, 3) of range m, azimuth, elevation rad once a step and
the start's state (9,) and covariance in; `Filtered` out. The channel filters take one channel (n,) each.
"""

from typing import NamedTuple

import numpy as np
from numba import njit

from filters.models.motion import CORE, predict

WAVELET = "db4"  # as smooth as a trajectory's derivative, and short
LEVELS = 4
FORGET = 0.98  # Sage-Husa: about 50 samples of memory
FLOOR = 1e-3  # share of the nominal variance that an adapted one never falls below


class Filtered(NamedTuple):
    """A filter's states at n steps, station ENU."""

    x0: np.ndarray  # (n, 9) predicted
    P0: np.ndarray  # (n, 9, 9)
    x1: np.ndarray  # (n, 9) updated
    P1: np.ndarray  # (n, 9, 9)


def room(n: int) -> Filtered:
    """Empty `Filtered` of ``n`` steps."""
    return Filtered(*(np.zeros((n, CORE, CORE) if square else (n, CORE)) for square in (0, 1, 0, 1)))


def white_jerk(jerk_psd: float) -> np.ndarray:
    """(4,) densities as `motion.PSD`: the same jerk on all axes, m²/s⁵, and no gusts."""
    return np.array([jerk_psd, jerk_psd, 0.0, 0.0])


def ekf(
    z: np.ndarray, sigma: np.ndarray, x: np.ndarray, P: np.ndarray, step_s: float, jerk_psd: float
) -> Filtered:
    """Extended Kalman filter: the measurement linearised at the prediction (Bar-Shalom et al. 2001, 10.3)."""
    out, x, P, still = room(len(z)), x.copy(), P.copy(), np.zeros(CORE)
    for k in range(len(z)):
        predict(x, P, step_s, white_jerk(jerk_psd), still, still)
        out.x0[k], out.P0[k] = x, P
        J = jacobian(x[:3])
        S = J @ P @ J.T + np.diag(sigma**2)
        K = np.linalg.solve(S, J @ P).T
        x, P = x + K @ difference(z[k], observe(x[:3])), P - K @ S @ K.T
        out.x1[k], out.P1[k] = x, P
    return out


def classic_ukf(
    z: np.ndarray, sigma: np.ndarray, x: np.ndarray, P: np.ndarray, step_s: float, jerk_psd: float
) -> Filtered:
    """filterpy's unscented Kalman filter with Merwe's points (α 0.1, β 2, κ 3 − n), no outlier handling."""
    from filterpy.kalman import MerweScaledSigmaPoints, UnscentedKalmanFilter

    still, F, Q = np.zeros(CORE), np.eye(CORE), np.zeros((CORE, CORE))
    predict(np.zeros(CORE), Q, step_s, white_jerk(jerk_psd), still, still)
    for axis in range(3):
        F[axis, axis + 3] = F[axis + 3, axis + 6] = step_s
        F[axis, axis + 6] = step_s**2 / 2
    points = MerweScaledSigmaPoints(CORE, 0.1, 2.0, 3.0 - CORE)
    ukf = UnscentedKalmanFilter(
        CORE, 3, step_s, lambda s: observe(s[:3]), lambda s, dt: F @ s, points, residual_z=difference
    )
    ukf.x, ukf.P, ukf.Q, ukf.R = x.copy(), P.copy(), Q, np.diag(sigma**2)
    out = room(len(z))
    for k in range(len(z)):
        ukf.predict()
        out.x0[k], out.P0[k] = ukf.x, ukf.P
        ukf.update(z[k])
        out.x1[k], out.P1[k] = ukf.x, ukf.P
    return out


def observe(p: np.ndarray) -> np.ndarray:
    """Range m, azimuth, elevation rad of ``p`` (…, 3)."""
    flat = np.hypot(p[..., 0], p[..., 1])
    return np.stack(
        [np.hypot(flat, p[..., 2]), np.arctan2(p[..., 0], p[..., 1]), np.arctan2(p[..., 2], flat)], axis=-1
    )


def jacobian(p: np.ndarray) -> np.ndarray:
    """(3, 9) derivative of `observe` at ``p`` (3,) by the state."""
    x, y, z = p
    flat = np.hypot(x, y)
    r = np.hypot(flat, z)
    J = np.zeros((3, CORE))
    J[0, :3] = p / r
    J[1, :2] = y / flat**2, -x / flat**2
    J[2, :3] = -x * z / (flat * r * r), -y * z / (flat * r * r), flat / r**2
    return J


def difference(a: np.ndarray, b: np.ndarray) -> np.ndarray:
    """a − b of (…, 3) range, azimuth, elevation; angles the short way round."""
    d = a - b
    d[..., 1:] = wrap_all(d[..., 1:])
    return d


def wrap_all(angle: np.ndarray) -> np.ndarray:
    """Angles in [−π, π)."""
    return (angle + np.pi) % (2 * np.pi) - np.pi


def adaptive_wavelet(z: np.ndarray, sigma: float, step_s: float, accel_psd: float) -> np.ndarray:
    """Adaptive Kalman filter of one channel, then wavelet shrinkage: the paper's real-data baseline.

    Soft universal threshold σ̂ √(2 ln n), σ̂ from the finest details (Donoho & Johnstone 1994).
    """
    import pywt

    parts = pywt.wavedec(sage_husa(z, sigma, step_s, accel_psd), WAVELET, level=LEVELS)
    noise = np.median(np.abs(parts[-1])) / 0.6745
    limit = noise * np.sqrt(2.0 * np.log(len(z)))
    shrunk = [parts[0]] + [pywt.threshold(part, limit, "soft") for part in parts[1:]]
    return pywt.waverec(shrunk, WAVELET)[: len(z)]


@njit(cache=True)
def sage_husa(z, sigma, step_s, accel_psd):
    """Constant-velocity Kalman filter of ``z`` (n,) whose measurement variance follows its innovations.

    R ← (1 − d) R + d (v² − p), d = (1 − b)/(1 − b^k) (Sage & Husa 1969). ``accel_psd`` in unit²/s³.
    """
    x, rate = z[0], 0.0
    nominal = sigma * sigma
    R, pp, pv, vv = nominal, nominal, 0.0, 2.0 * nominal / step_s**2
    out = z.copy()
    for k in range(1, len(z)):
        x += step_s * rate
        pp += step_s * (2.0 * pv + step_s * vv) + accel_psd * step_s**3 / 3.0
        pv += step_s * vv + accel_psd * step_s**2 / 2.0
        vv += accel_psd * step_s
        v = z[k] - x
        d = (1.0 - FORGET) / (1.0 - FORGET ** (k + 1))
        R = max((1.0 - d) * R + d * (v * v - pp), FLOOR * nominal)
        S = pp + R
        x += pp / S * v
        rate += pv / S * v
        vv -= pv * pv / S
        pv -= pp * pv / S
        pp -= pp * pp / S
        out[k] = x
    return out


def alpha_beta(z: np.ndarray, step_s: float, alpha: float) -> np.ndarray:
    """filterpy's g-h filter of one channel (n,); h = g²/(2 − g) (Benedict & Bordner 1962)."""
    from filterpy.gh import GHFilter

    gh = GHFilter(x=z[0], dx=0.0, dt=step_s, g=alpha, h=alpha**2 / (2.0 - alpha))
    return np.array([z[0]] + [gh.update(value)[0] for value in z[1:]])
