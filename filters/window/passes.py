"""One pass ahead and one back over rows: the filter, the smoother and what all rows say of each.

Ahead: scalar sequential updates. Back: the modified Bryson-Frazier recursion in de Jong's form, without any
inverse: r and N carry what the later rows say, x_smooth = x + P r, P_smooth = P − P N P.
Sources: Bierman 1973 (*Fixed interval smoothing with discrete measurements*); de Jong 1989 (*Smoothing and
interpolation with the state-space model*); de Jong & Penzer 1998 for the deletion residual: with
e = v/S − Kᵀr and D = 1/S + KᵀNK, the residual of a row from all *others* is e/D, of variance 1/D.
"""

from typing import NamedTuple

import numpy as np

from filters.models.kernel import kernel
from filters.models.model import SLOTS, predict_row
from filters.models.motion import CORE, JOLT, jerk_slope, predict, pull_back
from filters.models.unscented import difference
from filters.models.update import update


class Given(NamedTuple):
    """What the passes have to know about rows in order of time; arrays (k,)."""

    t: np.ndarray  # ns
    sensor: np.ndarray
    channel: np.ndarray
    value: np.ndarray
    noise: np.ndarray  # variance
    jerk: np.ndarray  # density of the white jerk on the way to the row, m²/s⁵
    weight: np.ndarray  # 0 … 1; the noise is divided by it


class Trace(NamedTuple):
    """What the pass ahead leaves for the pass back, per row, and what the pass back finds."""

    index: np.ndarray  # (k, SLOTS) where the row's gradient is not zero
    gain: np.ndarray  # (k, SLOTS) the gradient there
    count: np.ndarray  # (k,) how many
    m: np.ndarray  # (k, n) P h
    v: np.ndarray  # (k,) innovation
    S: np.ndarray  # (k,) its variance at full weight
    off: np.ndarray  # (k,) value minus what all other rows predict
    sigma: np.ndarray  # (k,) 1-sigma of that
    next: np.ndarray  # (k,) bool, stands next to an outlier of its channel
    alike: np.ndarray  # (k,) bool, and may well belong to the same run
    crowd: np.ndarray  # (k,) bool, most before it do not fit
    x: np.ndarray  # (k, n) at the first row of each epoch: state before it, after the pass back smoothed
    P: np.ndarray  # (k, n, n) the same for the covariance; fewer entries keep fewer epochs


def keeping(out: Trace, keep: int) -> Trace:
    """The same with room for the states of the first ``keep`` rows, at least one. Smoothing is costly."""
    n = out.m.shape[1]
    return out._replace(x=np.zeros((max(keep, 1), n)), P=np.zeros((max(keep, 1), n, n)))


def trace(rows: int, n: int, keep: int) -> Trace:
    """Room for ``rows`` rows and ``n`` states, smoothed states for the first ``keep`` of the rows."""
    f = np.zeros
    return Trace(
        index=f((rows, SLOTS), np.int64),
        gain=f((rows, SLOTS)),
        count=f(rows, np.int64),
        m=f((rows, n)),
        v=f(rows),
        S=f(rows),
        off=f(rows),
        sigma=f(rows),
        next=f(rows, np.bool_),
        alike=f(rows, np.bool_),
        crowd=f(rows, np.bool_),
        x=f((keep, n)),
        P=f((keep, n, n)),
    )


@kernel
def ahead(model, rows, begin, end, x, P, t_ns, out, work):
    """Filter rows ``begin`` to ``end``, in place from ``x``, ``P`` at ``t_ns``; returns the time reached.

    ``rows`` is `Given`, or anything with the same columns.
    """
    n = x.size
    for i in range(begin, end):
        k = i - begin
        if rows.t[i] != t_ns or k == 0:
            predict(x, P, (rows.t[i] - t_ns) * 1e-9, rows.jerk[i], model.rate, model.prior)
            t_ns = rows.t[i]
            if k < out.x.shape[0]:
                for a in range(n):
                    out.x[k, a] = x[a]
                    for b in range(n):
                        out.P[k, a, b] = P[a, b]
        c = rows.channel[i]
        seen, variance = predict_row(model, rows.sensor[i], c, x, P, rows.jerk[i], out, k, work)
        out.v[k] = difference(c, rows.value[i], seen)
        out.S[k] = variance + rows.noise[i]
        if rows.weight[i] > 0.0:
            update(x, P, out.m[k], out.v[k], variance + rows.noise[i] / rows.weight[i])
    return t_ns


@kernel
def back(model, rows, begin, end, out, r, N, work):
    """Hold every row against all others; ``r`` (n,), ``N`` (n, n) say what came after, in place.

    Fills ``out.off`` and ``out.sigma``, and smooths the states that ``out`` keeps. ``work``: `model.scratch`.
    Returns the slope of −2 log likelihood by the density of the jerk, jolts left out (Koopman & Shephard
    1992, *Exact score for time series models in state space form*).
    """
    n, Nm, slope = r.size, work[0], 0.0
    for i in range(end - 1, begin - 1, -1):
        k = i - begin
        v, S = out.v[k], out.S[k]
        mr = mNm = 0.0
        for b in range(n):
            Nm[b] = 0.0
        for a in range(n):
            mr += out.m[k, a] * r[a]
            for b in range(n):
                Nm[b] += out.m[k, a] * N[a, b]
        for a in range(n):
            mNm += out.m[k, a] * Nm[a]
        if rows.weight[i] > 0.0:
            spare = rows.noise[i] / rows.weight[i] - rows.noise[i]
            S += spare
            e = (v - mr) / S
            D = 1.0 / S + mNm / (S * S)
            out.off[k] = e / D
            out.sigma[k] = np.sqrt(1.0 / D - spare)
            _condense(out.index, out.gain, out.count[k], k, e, D, S, r, N, Nm, work[1])
        else:
            out.off[k] = v - mr
            out.sigma[k] = np.sqrt(S - mNm)
        if i == begin or rows.t[i] != rows.t[i - 1]:
            if k < out.x.shape[0]:
                _smooth(out.x[k], out.P[k], r, N, work[1:])
            if i > begin:
                dt = (rows.t[i] - rows.t[i - 1]) * 1e-9
                if rows.jerk[i] < JOLT:
                    slope += jerk_slope(r, N, dt)
                pull_back(r, N, dt, model.rate)
    return slope


@kernel
def _condense(index, gain, count, k, e, D, S, r, N, Nm, h):
    """r ← r + h e;  N ← (I − K hᵀ)ᵀ N (I − K hᵀ) + h hᵀ / S, written as N − w hᵀ − h wᵀ, w = Nm/S − ½ D h."""
    n = r.size
    for a in range(n):
        h[a] = 0.0
    for p in range(count):
        h[index[k, p]] += gain[k, p]
    for a in range(n):
        r[a] += h[a] * e
        Nm[a] = Nm[a] / S - 0.5 * D * h[a]
    for a in range(n):
        for b in range(n):
            N[a, b] -= Nm[a] * h[b] + h[a] * Nm[b]


@kernel
def _smooth(x, P, r, N, work):
    """x + P r, and P − P N P in the core block, in place; ``work`` (CORE + 1, n) is scratch."""
    n = r.size
    row, loss = work[0], work[1:]
    for a in range(n):
        row[a] = 0.0
        for b in range(n):
            row[a] += P[a, b] * r[b]
    for a in range(n):
        x[a] += row[a]
    for a in range(CORE):
        for b in range(n):
            row[b] = 0.0
        for c in range(n):
            for b in range(n):
                row[b] += P[a, c] * N[c, b]
        for b in range(a, CORE):
            loss[a, b] = 0.0
            for c in range(n):
                loss[a, b] += row[c] * P[b, c]
    for a in range(CORE):
        for b in range(a, CORE):
            P[a, b] -= loss[a, b]
            P[b, a] = P[a, b]
