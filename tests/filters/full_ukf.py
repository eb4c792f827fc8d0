"""The textbook: an unscented Kalman filter with all 2n + 1 sigma points, in plain numpy, scalar by scalar.

Julier & Uhlmann 2004, *Unscented filtering and nonlinear estimation*; α = 1, β = 0, κ = 3 − n.
"""

import numpy as np

from filters.models.rows import AZIMUTH, ELEVATION, RANGE, RANGE_RATE, E


def transition(dt):
    """(9, 9) transition and noise for unit jerk density, by Van Loan's matrix exponential."""
    A = np.zeros((18, 18))
    A[3:9, :9] = 0
    F = np.zeros((9, 9))
    F[0:3, 3:6] = F[3:6, 6:9] = np.eye(3)
    G = np.zeros((9, 9))
    G[6:, 6:] = np.eye(3)
    A[:9, :9], A[:9, 9:], A[9:, 9:] = -F * dt, G * dt, F.T * dt
    term, M = np.eye(18), np.eye(18)
    for k in range(1, 12):
        term = term @ A / k
        M = M + term
    Phi = M[9:, 9:].T
    return Phi, Phi @ M[:9, 9:]


def value(sensor, channel, x):
    """Value of one channel of an instrument or an INS (without its bias), for a state (9,)."""
    if sensor.kind == "ins":
        return x[channel - E]
    p, v = sensor.rotation @ (x[:3] - sensor.offset_m), sensor.rotation @ x[3:6]
    return {
        RANGE: np.linalg.norm(p),
        AZIMUTH: np.arctan2(p[0], p[1]),
        ELEVATION: np.arctan2(p[2], np.hypot(p[0], p[1])),
        RANGE_RATE: p @ v / np.linalg.norm(p),
    }[channel]


def update(x, P, sensor, channel, measured):
    """One scalar update; returns (x, P, innovation, its variance)."""
    n = len(x)
    root = np.linalg.cholesky(P)
    points = np.vstack([x, x + np.sqrt(3.0) * root.T, x - np.sqrt(3.0) * root.T])
    W = np.full(2 * n + 1, 1 / 6)
    W[0] = 1 - n / 3
    z = np.array([value(sensor, channel, point) for point in points])
    wrap = (lambda a: (a + np.pi) % (2 * np.pi) - np.pi) if channel in (AZIMUTH, ELEVATION) else (lambda a: a)
    dz = wrap(z - z[0])
    mean = W @ dz
    S = W @ (dz - mean) ** 2 + sensor.sigma[channel] ** 2
    K = (W * (dz - mean)) @ (points - x) / S
    v = wrap(measured - z[0] - mean)
    return x + K * v, P - np.outer(K, K) * S, v, S
