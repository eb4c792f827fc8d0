"""How the target moves between rows: position, velocity, acceleration; white jerk and white acceleration.

State order (station ENU): x[0:3] position m, x[3:6] velocity m/s, x[6:9] acceleration m/s²; from x[9] on the
systematic errors, each a first-order Gauss-Markov process, or a constant.
White jerk is what a pilot does; white acceleration is what a gust does: it changes the velocity at once and
is gone. Each has its density for the horizontal axes and for the vertical one: psd (4,) is
(jerk horizontal, jerk vertical) in m²/s⁵ and (acceleration horizontal, acceleration vertical) in m²/s³.
Source of transition and noise: Bar-Shalom, Li, Kirubarajan, *Estimation with Applications to Tracking and
Navigation* (2001), 6.2.2 and 6.2.3 (white acceleration and white jerk, discretised exactly), 8.2
(Gauss-Markov).
"""

import numpy as np

from filters.models.kernel import exact, kernel

CORE, MOTIONS = 9, 4  # entries of the state, and densities, of the motion
PSD = np.array([10.0, 10.0, 0.3, 0.3])  # to begin with: 3 m/s³ held for a second; light turbulence
LOWEST = np.array([0.05, 0.05, 1e-4, 1e-4])  # hovering in still air
HIGHEST = np.array([3e3, 3e3, 50.0, 50.0])  # aerobatics; 25 m/s² from sample to sample at 12 Hz


def densities(psd: np.ndarray, factor: np.ndarray) -> np.ndarray:
    """(n − 5,) of all that moves: ``psd`` (4,), and ``factor`` (n − 9,) of the errors' variances."""
    return np.concatenate([psd, factor])


@exact
def predict(x, P, dt, psd, rate, variance):
    """Move ``x`` (n,) and ``P`` (n, n) ahead by ``dt`` seconds, in place.

    ``psd`` (n − 5,): see `densities`. ``rate`` (n,) is 1/τ of each systematic error, 0 for a constant;
    ``variance`` (n,) the stationary one.
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
            P[i, i] += psd[i - CORE + MOTIONS] * variance[i] * (1.0 - keep * keep)
    _add_noise(P, dt, psd)
    if rate[2] > 0.0:  # a height that was told beforehand: see `state.with_height`
        P[2, 2] = max(P[2, 2], min(P[2, 2] + 2.0 * rate[2] * variance[2] * dt, variance[2]))


@exact
def carry(B, dt):
    """B ← F B for the core's rows of ``B`` (n, k), in place: position, velocity, acceleration by ``dt``."""
    half = 0.5 * dt * dt
    for i in range(3):
        for j in range(B.shape[1]):
            B[i, j] += dt * B[i + 3, j] + half * B[i + 6, j]
            B[i + 3, j] += dt * B[i + 6, j]


@exact
def _add_noise(P, dt, psd):
    """White jerk and acceleration over ``dt``: Bar-Shalom et al., eqs. 6.2.3-9 and 6.2.2-9, per axis."""
    d2 = dt * dt
    for i in range(3):
        jerk, push = (psd[1], psd[3]) if i == 2 else (psd[0], psd[2])
        pv = jerk * d2 * d2 / 8 + push * d2 / 2
        pa, va = jerk * d2 * dt / 6, jerk * d2 / 2
        P[i, i] += jerk * d2 * d2 * dt / 20 + push * d2 * dt / 3
        P[i, i + 3] += pv
        P[i + 3, i] += pv
        P[i, i + 6] += pa
        P[i + 6, i] += pa
        P[i + 3, i + 3] += jerk * d2 * dt / 3 + push * dt
        P[i + 3, i + 6] += va
        P[i + 6, i + 3] += va
        P[i + 6, i + 6] += jerk * dt


@kernel
def drift(P, psd, i, dt):
    """Variance by which entry ``i`` of position, velocity, acceleration leaves what is expected in ``dt``.

    Of its rate, as unsure as in ``P``, and of the noise of `predict`; axes by themselves.
    """
    jerk, push = (psd[1], psd[3]) if i % 3 == 2 else (psd[0], psd[2])
    d2 = dt * dt
    if i < 3:
        rate = P[i + 3, i + 3] + dt * P[i + 3, i + 6] + 0.25 * d2 * P[i + 6, i + 6]
        return d2 * rate + jerk * d2 * d2 * dt / 20 + push * d2 * dt / 3
    if i < 6:
        return d2 * P[i + 3, i + 3] + jerk * d2 * dt / 3 + push * dt
    return jerk * dt


@kernel
def score(r, N, dt, psd, found):
    """Add what one step of ``dt`` says about the logarithm of each density to ``found`` (2, 4).

    With Q = psd · U the noise of the step: slope ½ (rᵀ Q r − tr Q N); expected information ½ tr(Q N Q N)
    (Koopman & Shephard 1992, *Exact score for time series models in state space form*).
    """
    slope, information = found[0], found[1]
    d2 = dt * dt
    jpp, jpv, jpa, jvv, jva, jaa = d2 * d2 * dt / 20, d2 * d2 / 8, d2 * dt / 6, d2 * dt / 3, d2 / 2, dt
    gpp, gpv, gvv = d2 * dt / 3, d2 / 2, dt
    for p in range(3):
        v, a, k = p + 3, p + 6, 1 if p == 2 else 0
        npp, npv, npa, nvv, nva, naa = N[p, p], N[p, v], N[p, a], N[v, v], N[v, a], N[a, a]
        quad = jpp * r[p] * r[p] + jvv * r[v] * r[v] + jaa * r[a] * r[a]
        quad += 2 * (jpv * r[p] * r[v] + jpa * r[p] * r[a] + jva * r[v] * r[a])
        # M = U N of this axis, 3 by 3
        m00, m01, m02 = _row(jpp, jpv, jpa, npp, npv, npa, nvv, nva, naa)
        m10, m11, m12 = _row(jpv, jvv, jva, npp, npv, npa, nvv, nva, naa)
        m20, m21, m22 = _row(jpa, jva, jaa, npp, npv, npa, nvv, nva, naa)
        trace = m00 + m11 + m22
        square = m00 * m00 + m11 * m11 + m22 * m22 + 2 * (m01 * m10 + m02 * m20 + m12 * m21)
        slope[k] += 0.5 * psd[k] * (quad - trace)
        information[k] += 0.5 * psd[k] * psd[k] * square
        quad = gpp * r[p] * r[p] + gvv * r[v] * r[v] + 2 * gpv * r[p] * r[v]
        m00, m01, m02 = _row(gpp, gpv, 0.0, npp, npv, npa, nvv, nva, naa)
        m10, m11, m12 = _row(gpv, gvv, 0.0, npp, npv, npa, nvv, nva, naa)
        square = m00 * m00 + m11 * m11 + 2 * m01 * m10
        slope[k + 2] += 0.5 * psd[k + 2] * (quad - m00 - m11)
        information[k + 2] += 0.5 * psd[k + 2] * psd[k + 2] * square


@kernel
def score_errors(r, N, dt, psd, rate, variance, found):
    """The same about each systematic error's variance, to ``found`` (2, n − 9)."""
    for i in range(CORE, r.size):
        if rate[i] > 0.0:
            keep = np.exp(-rate[i] * dt)
            noise = psd[i - CORE + MOTIONS] * variance[i] * (1.0 - keep * keep)
            found[0, i - CORE] += 0.5 * noise * (r[i] * r[i] - N[i, i])
            found[1, i - CORE] += 0.5 * noise * noise * N[i, i] * N[i, i]


@kernel
def _row(a, b, c, npp, npv, npa, nvv, nva, naa):
    """(a, b, c) times the symmetric 3 by 3 matrix of the other arguments."""
    return a * npp + b * npv + c * npa, a * npv + b * nvv + c * nva, a * npa + b * nva + c * naa


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
