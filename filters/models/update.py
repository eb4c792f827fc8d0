"""One measured value taken into a state, and how much of it.

Weights follow IGG-III (Yang 1994, *Robust estimation for dependent observations*): full weight up to ``soft``
sigma, then (soft/u) ((hard − u)/(hard − soft))², nothing from ``hard`` on.
"""

import numpy as np

from filters.models.kernel import exact


@exact
def update(x, P, m, v, S):
    """Condition ``x`` and ``P`` on one innovation, in place: ``m`` = P h, ``S`` its variance with noise."""
    n = x.size
    scale = 1.0 / np.sqrt(S)
    for i in range(n):
        x[i] += m[i] * (v / S)
        s = m[i] * scale
        for j in range(n):
            P[i, j] -= s * (m[j] * scale)


@exact
def spread(P, m, v, S, w):
    """Add to ``P``, in place, what it is to be unsure whether an innovation counts: with probability ``w``.

    The states with it and without it are K v apart, K = m / S: w (1 − w) K v vᵀ Kᵀ, the spread of the
    innovations in probabilistic data association (Bar-Shalom & Tse 1975).
    """
    n = m.size
    e = np.sqrt(w * (1.0 - w)) * v / S
    for i in range(n):
        for j in range(n):
            P[i, j] += (m[i] * e) * (m[j] * e)


@exact
def weight(u, soft, hard):
    """IGG-III weight, 0 … 1, of a value ``u`` sigmas off."""
    u = abs(u)
    if u <= soft:
        return 1.0
    if u >= hard:
        return 0.0
    return (soft / u) * ((hard - u) / (hard - soft)) ** 2
