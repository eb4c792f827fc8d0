"""Which channel slides away: too slowly for any single value to stand out, but all its values together do.

To every channel a slope is imputed, a constant drift from the window's beginning on. One more pass ahead over
the traced window gives the generalised least squares estimate of each, and how much likelier the window would
be with it: de Jong & Penzer 1998, *Diagnosing shocks in time series*.
"""

import numpy as np
from numba import njit

from filters.models.kernel import kernel
from filters.models.motion import CORE, carry
from filters.models.rows import CHANNELS


@njit(cache=True)
def gains(rows, begin, end, out, rate):
    """(s, 13) by how much −2 log likelihood of rows ``begin`` to ``end`` would fall if that channel slid.

    ``out`` is the trace of their pass ahead, ``rate`` the model's.
    """
    n, s = rate.size, rows.sensor[begin:end].max() + 1
    column = np.full((s, len(CHANNELS)), -1)
    for i in range(begin, end):
        column[rows.sensor[i], rows.channel[i]] = 0
    count = 0
    for a in range(s):
        for c in range(len(CHANNELS)):
            if column[a, c] == 0:
                column[a, c] = count
                count += 1
    score, information = np.zeros(count), np.zeros(count)
    _impute(rows, begin, end, out, rate, column, np.zeros((n, count)), np.zeros(count), score, information)
    found = np.zeros((s, len(CHANNELS)))
    for a in range(s):
        for c in range(len(CHANNELS)):
            k = column[a, c]
            if k >= 0 and information[k] > 0.0:
                found[a, c] = score[k] ** 2 / information[k]
    return found


@kernel
def _impute(rows, begin, end, out, rate, column, B, V, score, information):
    """``B`` (n, k) is what unit slopes do to the state, ``V`` (k,) what they do to an innovation."""
    n, count = B.shape
    for i in range(begin, end):
        k = i - begin
        if i > begin and rows.t[i] != rows.t[i - 1]:
            dt = (rows.t[i] - rows.t[i - 1]) * 1e-9
            carry(B, dt)
            for a in range(CORE, n):
                if rate[a] > 0.0:
                    keep = np.exp(-rate[a] * dt)
                    for b in range(count):
                        B[a, b] *= keep
        if rows.weight[i] == 0.0:
            continue
        for b in range(count):
            V[b] = 0.0
        for p in range(out.count[k]):
            for b in range(count):
                V[b] += out.gain[k, p] * B[out.index[k, p], b]
        V[column[rows.sensor[i], rows.channel[i]]] += (rows.t[i] - rows.t[begin]) * 1e-9
        S = out.S[k] + rows.noise[i] / rows.weight[i] - rows.noise[i]
        for b in range(count):
            score[b] += V[b] * out.v[k] / S
            information[b] += V[b] * V[b] / S
        for a in range(n):
            gain = out.m[k, a] / S
            for b in range(count):
                B[a, b] -= gain * V[b]
