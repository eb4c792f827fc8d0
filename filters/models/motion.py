"""How the target moves between rows: position, velocity, acceleration, driven by white jerk.

State order (station ENU): x[0:3] position m, x[3:6] velocity m/s, x[6:9] acceleration m/s²; from x[9] on the
systematic errors, each either constant or a first-order Gauss-Markov process.
Source of transition and noise: Bar-Shalom, Li, Kirubarajan, *Estimation with Applications to Tracking and
Navigation* (2001), 6.2.3 (white-noise jerk, discretised exactly) and 8.2 (Gauss-Markov).
"""

import numpy as np

from filters.models.kernel import exact, kernel

CORE = 9
JERK_PSD = 10.0  # m²/s⁵ per axis, to begin with: 3 m/s³ held for about a second is ordinary
CALMEST, WILDEST = 0.05, 2000.0  # m²/s⁵: hovering in still air; a light aircraft in gusts
JOLT = 3e5  # m²/s⁵ while the motion changes abruptly: a launch, a collision
STEP = 3.0  # from one density to the next
SURER = 3.0  # by which the window's cost, −2 log likelihood, has to fall for such a step


@exact
def predict(x, P, dt, jerk_psd, rate, variance):
    """Move ``x`` (n,) and ``P`` (n, n) ahead by ``dt`` seconds, in place.

    ``rate`` (n,) is 1/τ of each systematic error, 0 for a constant; ``variance`` (n,) the stationary one.
    """
    n = x.size
    half = 0.5 * dt * dt
    for i in range(3):
        x[i] += dt * x[i + 3] + half * x[i + 6]
        x[i + 3] += dt * x[i + 6]
    carry(P, dt)
    for i in range(n):
        for j in range(3):
            P[i, j] += dt * P[i, j + 3] + half * P[i, j + 6]
            P[i, j + 3] += dt * P[i, j + 6]
    for i in range(CORE):
        for j in range(i):
            P[i, j] = P[j, i]
    for i in range(CORE, n):
        if rate[i] > 0.0:
            keep = np.exp(-rate[i] * dt)
            x[i] *= keep
            for j in range(n):
                P[i, j] *= keep
                P[j, i] *= keep
            P[i, i] += variance[i] * (1.0 - keep * keep)
    _add_noise(P, dt, jerk_psd)


@exact
def carry(B, dt):
    """B ← F B for the core's rows of ``B`` (n, k), in place: position, velocity, acceleration by ``dt``."""
    half = 0.5 * dt * dt
    for i in range(3):
        for j in range(B.shape[1]):
            B[i, j] += dt * B[i + 3, j] + half * B[i + 6, j]
            B[i + 3, j] += dt * B[i + 6, j]


@exact
def _add_noise(P, dt, jerk_psd):
    """White jerk over ``dt``: Bar-Shalom et al., eq. 6.2.3-9, per axis."""
    d2 = dt * dt
    pp, pv, pa = (d2 * d2 * dt / 20, d2 * d2 / 8, d2 * dt / 6)
    vv, va, aa = (d2 * dt / 3, d2 / 2, dt)
    for i in range(3):
        P[i, i] += jerk_psd * pp
        P[i, i + 3] += jerk_psd * pv
        P[i + 3, i] += jerk_psd * pv
        P[i, i + 6] += jerk_psd * pa
        P[i + 6, i] += jerk_psd * pa
        P[i + 3, i + 3] += jerk_psd * vv
        P[i + 3, i + 6] += jerk_psd * va
        P[i + 6, i + 3] += jerk_psd * va
        P[i + 6, i + 6] += jerk_psd * aa


@kernel
def jerk_slope(r, N, dt):
    """tr(Q N) − rᵀ Q r, Q the noise of unit white jerk over ``dt``."""
    d2, slope = dt * dt, 0.0
    for p in range(3):
        v, a = p + 3, p + 6
        slope += d2 * d2 * dt / 20 * (N[p, p] - r[p] * r[p]) + d2 * d2 / 4 * (N[p, v] - r[p] * r[v])
        slope += d2 * dt / 3 * (N[p, a] - r[p] * r[a] + N[v, v] - r[v] * r[v])
        slope += d2 * (N[v, a] - r[v] * r[a]) + dt * (N[a, a] - r[a] * r[a])
    return slope


@kernel
def pull_back(r, N, dt, rate):
    """Carry what later rows say back by ``dt`` seconds, in place: r ← Fᵀ r, N ← Fᵀ N F, F of `predict`."""
    n = r.size
    half = 0.5 * dt * dt
    for i in range(3):
        r[i + 6] += dt * r[i + 3] + half * r[i]
        r[i + 3] += dt * r[i]
    for i in range(3):
        for j in range(n):
            N[i + 6, j] += dt * N[i + 3, j] + half * N[i, j]
            N[i + 3, j] += dt * N[i, j]
    for i in range(n):
        for j in range(3):
            N[i, j + 6] += dt * N[i, j + 3] + half * N[i, j]
            N[i, j + 3] += dt * N[i, j]
    for i in range(CORE):
        for j in range(i):
            N[i, j] = N[j, i]
    for i in range(CORE, n):
        if rate[i] > 0.0:
            keep = np.exp(-rate[i] * dt)
            r[i] *= keep
            for j in range(n):
                N[i, j] *= keep
                N[j, i] *= keep
