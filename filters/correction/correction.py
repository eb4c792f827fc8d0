"""The learned part: a small network that reads in the filter's own correction what is still wrong.

Input and output follow the GA-BP-UKF paper: in goes X(k+1|k+1) − X(k+1|k), out comes an estimate of
X_true − X(k+1|k+1). Both are put in a form that does not depend on geometry, rate or noise, so that one
network serves all: turned into along-track, right and up (by the predicted velocity), and divided by the
filter's own 1-sigma there, the input by that of the prediction, the output by that of the updated state.

    e = gain · fade · (W₂ tanh(W₁ u + b₁) + b₂)

``fade`` is 1 while every |uᵢ| is within the range seen in training, 0 from twice that on, linear between.
"""

import math
from typing import NamedTuple

import numpy as np
from numba import njit

from filters.models.motion import CORE


class Network(NamedTuple):
    """One hidden layer; ``h`` units."""

    w1: np.ndarray  # (h, 9)
    b1: np.ndarray  # (h,)
    w2: np.ndarray  # (9, h)
    b2: np.ndarray  # (9,)
    limit: np.ndarray  # (9,) largest |u| seen in training
    gain: np.ndarray  # (9,) 0 … 1, what flights not trained on left of each output


def length(hidden: int) -> int:
    """Number of weights and thresholds of a network with ``hidden`` units."""
    return hidden * (2 * CORE + 1) + CORE


def unpack(weights: np.ndarray, hidden: int) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
    """(w1, b1, w2, b2) of weights in a row, (…, length); leading axes are kept."""
    ends = np.cumsum([hidden * CORE, hidden, CORE * hidden])
    w1, b1, w2, b2 = np.split(weights, ends, axis=-1)
    lead = weights.shape[:-1]
    return w1.reshape(*lead, hidden, CORE), b1, w2.reshape(*lead, CORE, hidden), b2


@njit(cache=True)
def heading(x):
    """Sine and cosine of the course over ground of state ``x``; north for a target at rest."""
    speed = math.hypot(x[3], x[4])
    return (x[3] / speed, x[4] / speed) if speed > 0.0 else (0.0, 1.0)


@njit(cache=True)
def turned(vector, s, c, out):
    """``vector`` (9,) station ENU as along-track, right, up, three times, into ``out``."""
    for i in (0, 3, 6):
        out[i] = s * vector[i] + c * vector[i + 1]
        out[i + 1] = c * vector[i] - s * vector[i + 1]
        out[i + 2] = vector[i + 2]


@njit(cache=True)
def sigmas(P, s, c, out):
    """1-sigma along-track, right, up of position, velocity, acceleration under ``P``, into ``out`` (9,)."""
    for i in (0, 3, 6):
        ee, nn, en = P[i, i], P[i + 1, i + 1], P[i, i + 1]
        out[i] = math.sqrt(s * s * ee + 2.0 * s * c * en + c * c * nn)
        out[i + 1] = math.sqrt(c * c * ee - 2.0 * s * c * en + s * s * nn)
        out[i + 2] = math.sqrt(P[i + 2, i + 2])


@njit(cache=True)
def samples(x0, P0, x1, P1, truth):
    """Network inputs and desired outputs, both (k, 9), of k updates.

    ``x0``, ``P0`` predicted, ``x1``, ``P1`` updated, ``truth`` true: (k, n) and (k, n, n), n ≥ 9,
    station ENU.
    """
    k = len(x0)
    u, e = np.empty((k, CORE)), np.empty((k, CORE))
    sigma = np.empty(CORE)
    for i in range(k):
        s, c = heading(x0[i])
        turned(x1[i, :CORE] - x0[i, :CORE], s, c, u[i])
        sigmas(P0[i], s, c, sigma)
        u[i] /= sigma
        turned(truth[i, :CORE] - x1[i, :CORE], s, c, e[i])
        sigmas(P1[i], s, c, sigma)
        e[i] /= sigma
    return u, e


@njit(cache=True)
def sigmas_of(x0, P):
    """`sigmas` of k covariances (k, n, n), along the courses of ``x0`` (k, n): (k, 9)."""
    out = np.empty((len(x0), CORE))
    for i in range(len(x0)):
        s, c = heading(x0[i])
        sigmas(P[i], s, c, out[i])
    return out


@njit(cache=True, fastmath=True)
def respond(net, u, e):
    """The network's output for inputs ``u`` (9,), in sigmas, into ``e`` (9,)."""
    beyond = 0.0
    for i in range(CORE):
        beyond = max(beyond, abs(u[i]) / net.limit[i] - 1.0)
    fade = 1.0 - beyond
    e[:] = 0.0
    if fade <= 0.0:
        return
    for j in range(net.b1.size):
        total = net.b1[j]
        for i in range(CORE):
            total += net.w1[j, i] * u[i]
        hidden = math.tanh(total)
        for i in range(CORE):
            e[i] += net.w2[i, j] * hidden
    for i in range(CORE):
        e[i] = fade * net.gain[i] * (e[i] + net.b2[i])


@njit(cache=True)
def respond_all(net, u):
    """`respond` for ``u`` (k, 9): (k, 9)."""
    out = np.empty_like(u)
    for i in range(len(u)):
        respond(net, u[i], out[i])
    return out


@njit(cache=True, fastmath=True)
def correct(net, x0, P0, x1, P1, out):
    """The corrected state into ``out`` (9,) from ``x0``, ``P0`` predicted and ``x1``, ``P1`` updated."""
    u, sigma, e = np.empty(CORE), np.empty(CORE), np.empty(CORE)
    s, c = heading(x0)
    for i in range(CORE):
        e[i] = x1[i] - x0[i]
    turned(e, s, c, u)
    sigmas(P0, s, c, sigma)
    for i in range(CORE):
        u[i] /= sigma[i]
    respond(net, u, e)
    sigmas(P1, s, c, sigma)
    for i in range(CORE):
        e[i] *= sigma[i]
    turned(e, s, c, u)  # the turn is its own inverse
    for i in range(CORE):
        out[i] = x1[i] + u[i]


def off(x0: np.ndarray, P0: np.ndarray, x1: np.ndarray, P1: np.ndarray) -> np.ndarray:
    """No correction: the updated state ``x1`` as it is."""
    return x1


class Correction:
    """A network at work."""

    def __init__(self, net: Network):
        self.net = net
        self._out = np.empty(CORE)

    def __call__(self, x0: np.ndarray, P0: np.ndarray, x1: np.ndarray, P1: np.ndarray) -> np.ndarray:
        """Corrected state (9,), station ENU, valid until the next call; arguments as in `correct`."""
        correct(self.net, x0, P0, x1, P1, self._out)
        return self._out
