"""Robust adaptive filter for one wind component seen through coloured noise.

Model (time-varying autoregression, every noise with a memory of its own):

    x(k+1) = φ x(k) + η(k+1),  η(k+1) = η(k) + w,  w ~ N(0, drift_var)      wind, m/s
    z(k)   = x(k) + γ(k),      γ(k+1) = ψ γ(k) + v,  v ~ N(0, noise_var)    measured wind, m/s

``φ`` is itself unknown and a slow random walk, so the state is X = (x, η, φ), linearised at its estimate.
The measurement noise loses its memory by differencing, L(k) = z(k+1) − ψ z(k) = A X(k) + e(k) with
A = HΦ − ψH. The same w is then in the dynamics and in e: J = ΓQΓᵀHᵀ/R_e takes it out, Φ* = Φ − JA,
Q* = ΓQΓᵀ − J R_e Jᵀ (Bryson & Henrikson 1968; Bar-Shalom, Li & Kirubarajan 2001, 8.3).

With ψ = 1 the noise is a random walk and nothing but the start holds the level of x: a differenced
measurement says how the wind changed, not what it is. ψ < 1 keeps it observable, ψ = 0 is white noise.

Three filters share this model: ``kalman`` believes everything; ``sage-husa`` estimates the noise from its
own innovations (Sage & Husa 1969, with fading memory); ``arf`` weighs the measurement by its residual
(IGG-III, Yang 1994) and frees the prediction where the measurements agree against it (Yang, He & Xu 2001).
"""

from typing import NamedTuple

import numpy as np
from numba import njit

from filters.models.update import update
from filters.models.update import weight as weight_of

METHODS = ("kalman", "sage-husa", "arf")
KALMAN, SAGE_HUSA, ARF = range(len(METHODS))
FADING = 0.97  # Sage-Husa: memory of about 33 measurements
ALPHA_FLOOR = 0.05  # one scalar cannot carry three states: the prediction keeps a twentieth of its weight
LEAST_NOISE = 0.05  # Sage-Husa: share of the assumed noise below which no estimate falls
VOTERS = 5  # accepted measurements whose median speaks against the prediction
LEAST_VOTE = 0.02  # weight of a measurement that is one of them; what is hardly believed frees no prediction


class Wind1D(NamedTuple):
    """What is assumed about one wind component, and how sceptical ``arf`` is."""

    drift_var: float = 0.01  # (m/s)² a step
    noise_var: float = 2.0  # (m/s)² a step
    noise_memory: float = 0.5  # ψ: 1 a random walk, 0 white
    phi: float = 1.0  # at the start
    phi_sigma: float = 0.1  # of it
    phi_walk: float = 1e-3  # 1-sigma a step
    start_sigma: float = 3.0  # m/s, of the first measurement
    k0: float = 2.0  # standardised residuals up to here have full weight
    k1: float = 5.0  # and beyond here none
    c0: float = 1.0  # the same for the prediction against the measurements' median
    c1: float = 5.0
    patience: float = 15.0  # so many refusals in a row, and it is the prediction that is wrong


class Estimate(NamedTuple):
    """n estimates, each from the measurements up to then."""

    x: np.ndarray  # (n,) m/s
    sigma: np.ndarray  # (n,) m/s
    phi: np.ndarray  # (n,)
    weight: np.ndarray  # (n,) of the measurement, 0 … 1


def estimate(z: np.ndarray, method: str = "arf", model: Wind1D = Wind1D()) -> Estimate:  # noqa: B008
    """One wind component, (n,) m/s at steady steps, NaN where there is no measurement.

    Raises ValueError for a name that is not in ``METHODS``.
    """
    if method not in METHODS:
        raise ValueError(f"unknown method {method!r}; choose one of {', '.join(METHODS)}")
    z = np.asarray(z, float)
    return Estimate(*_run(z, METHODS.index(method), Wind1D(*map(float, model))))


@njit(cache=True)
def _run(z, method, model):
    n = len(z)
    x_out, sigma_out, phi_out = np.full(n, np.nan), np.full(n, np.nan), np.full(n, np.nan)
    weight_out = np.zeros(n)
    first = 0
    while first < n and np.isnan(z[first]):
        first += 1
    if first == n:
        return x_out, sigma_out, phi_out, weight_out
    X = np.array([z[first], 0.0, model.phi])
    P = np.zeros((3, 3))
    P[0, 0], P[1, 1], P[2, 2] = model.start_sigma**2, model.drift_var, model.phi_sigma**2
    # carried from step to step: reference z(k), its variance as a stand-in, estimated noise, steps, refusals,
    # variance that the gate had
    memory = np.array([z[first], 0.0, model.noise_var, 0.0, 0.0, np.inf])
    voters = np.full(VOTERS, np.nan)
    x_out[first], sigma_out[first], phi_out[first], weight_out[first] = X[0], model.start_sigma, X[2], 1.0
    for k in range(first + 1, n):
        weight_out[k] = _step(X, P, memory, voters, z[k], method, model)
        x_out[k], sigma_out[k], phi_out[k] = X[0], np.sqrt(P[0, 0]), X[2]
    return x_out, sigma_out, phi_out, weight_out


@njit(cache=True)
def _step(X, P, memory, voters, z, method, model):
    """From X(k) to X(k+1) in place with z(k+1); returns the weight that z had."""
    psi = model.noise_memory
    Phi = np.array([[X[2], 1.0, X[0]], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0]])
    # difference: L = z − ψ z_ref, predicted with the non-linear model
    A = Phi[0].copy()
    A[0] -= psi
    stand_in = psi * psi * memory[1]
    R = model.drift_var + model.noise_var
    predicted = X[2] * X[0] + X[1] + psi * (memory[0] - X[0])
    innovation = 0.0 if np.isnan(z) else z - predicted
    weight = 0.0 if np.isnan(z) else 1.0
    if method == ARF and weight > 0.0:
        weight = _weigh(X, P, A, R + stand_in, z, innovation, memory, voters, model)
    elif method == SAGE_HUSA and weight > 0.0:
        R = model.drift_var + _observed_noise(P, A, innovation, memory, model)
    # update X(k), then go on with what w has in both noises taken out: J = ΓQΓᵀHᵀ/R_e, Φ* = Φ − JA
    spread = times(P, A) @ A
    drift = model.drift_var
    if weight > 0.0:
        R_used = (R + stand_in) / weight
        J = drift / R_used
        update(X, P, times(P, A), innovation, spread + R_used)
        left = innovation * R_used / (spread + R_used)  # what the updated state does not explain
        Phi[0] -= J * A
        Phi[1] -= J * A
        drift -= J * J * R_used
        pulled = J * left
    else:
        pulled = 0.0
    if weight == 0.0 and not np.isnan(z):
        # refused: the wind stays where it was, for η would carry it on with no measurement to hold it
        predicted += X[0] - (X[2] * X[0] + X[1])
    else:
        X[0] = X[2] * X[0] + X[1] + pulled
        X[1] += pulled
    X[2] = min(max(X[2], 0.0), 1.0)  # a wind that grows by itself is none
    P[:] = sandwich(Phi, P)
    P[:2, :2] += drift
    P[2, 2] += model.phi_walk**2
    # a doubted measurement leaves a stand-in between itself and its prediction, as unsure as that is
    memory[0] = predicted + weight * innovation
    memory[1] = (1.0 - weight) * (spread + R + stand_in)
    if np.isnan(z):
        memory[5] = np.inf  # in a gap the wind may go anywhere: the gate is the covariance's own again
    return weight


@njit(cache=True)
def _observed_noise(P, A, innovation, memory, model):
    """Sage-Husa: the noise variance that the innovations show, with fading memory."""
    memory[3] += 1.0
    d = (1.0 - FADING) / (1.0 - FADING ** (memory[3] + 1.0))
    seen = innovation**2 - times(P, A) @ A
    memory[2] = max((1.0 - d) * memory[2] + d * seen, LEAST_NOISE * model.noise_var)
    return memory[2]


@njit(cache=True)
def _weigh(X, P, A, R, z, innovation, memory, voters, model):
    """IGG-III weight of a measurement; the prediction's own where the measurements agree against it.

    Outliers have no vote: what moves the median of the accepted is the wind. After too many refusals it is
    the prediction that is given up. Through a run of refusals the covariance grows, the gate does not: an
    outlier must not come to fit because those before it were refused.
    """
    variance = times(P, A) @ A + R
    if memory[4] > 0.0:
        variance = min(variance, memory[5])
    memory[5] = variance
    weight = weight_of(innovation / np.sqrt(variance), model.k0, model.k1)
    memory[4] = memory[4] + 1.0 if weight == 0.0 else 0.0
    if memory[4] > model.patience:
        memory[4] = 0.0
        P[0, 0] += innovation**2
        return 1.0
    if weight > LEAST_VOTE:
        voters[:-1] = voters[1:].copy()
        voters[-1] = z
    if weight > LEAST_VOTE and not np.isnan(voters[0]):
        level_var = model.noise_var / max(1.0 - model.noise_memory**2, 0.1)
        ahead = np.array([X[2], 1.0, X[0]])
        variance = times(P, ahead) @ ahead + model.drift_var + np.pi / 2 * level_var / VOTERS
        delta = (np.sort(voters)[VOTERS // 2] - X[2] * X[0] - X[1]) / np.sqrt(variance)
        P[0, 0] /= max(weight_of(delta, model.c0, model.c1), ALPHA_FLOOR)
    return weight


@njit(cache=True)
def times(P, a):
    """P a, (n,)."""
    out = np.zeros(len(a))
    for i in range(len(a)):
        for j in range(len(a)):
            out[i] += P[i, j] * a[j]
    return out


@njit(cache=True)
def sandwich(F, P):
    """F P Fᵀ, (n, n), symmetric to the last bit. Loops compile and run faster than BLAS at this size."""
    n = len(F)
    half, out = np.zeros((n, n)), np.zeros((n, n))
    for i in range(n):
        for j in range(n):
            for k in range(n):
                half[i, j] += F[i, k] * P[k, j]
    for i in range(n):
        for j in range(i + 1):
            for k in range(n):
                out[i, j] += half[i, k] * F[j, k]
            out[j, i] = out[i, j]
    return out
