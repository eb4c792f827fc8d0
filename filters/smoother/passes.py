"""One pass forward and one backward over rows: the filter, the smoother and what all rows say of each.

Forward: scalar sequential updates. Backward: the modified Bryson-Frazier recursion in de Jong's form, without
any inverse: r and N carry what the later rows say, x_smooth = x + P r, P_smooth = P − P N P.
Sources: Bierman 1973 (*Fixed interval smoothing with discrete measurements*); de Jong 1989 (*Smoothing and
interpolation with the state-space model*); de Jong & Penzer 1998 for the deletion residual: with
e = v/S − Kᵀr and D = 1/S + KᵀNK, the residual of a row from all *others* is e/D, of variance 1/D.
"""

from typing import NamedTuple

import numpy as np

from filters.models.kernel import kernel
from filters.models.motion import CORE, MOTIONS, drift, predict, pull_back, score, score_errors
from filters.models.runs import FRESH
from filters.models.state import SLOTS, predict_row
from filters.models.update import update


class Trace(NamedTuple):
    """What the forward pass leaves for the backward pass, per row, and what the backward pass finds."""

    index: np.ndarray  # (k, SLOTS) where the row's gradient is not zero
    gain: np.ndarray  # (k, SLOTS) the gradient there
    count: np.ndarray  # (k,) how many
    m: np.ndarray  # (k, n) P h
    v: np.ndarray  # (k,) innovation
    S: np.ndarray  # (k,) its variance at full weight
    at: np.ndarray  # (k, n) the state before the row
    moved: np.ndarray  # (k,) by which updates have moved its prediction since its channel's row before
    fresh: np.ndarray  # (k,) variance by which the motion may have since then
    x: np.ndarray  # (e, n) at the first row of each epoch: state before it, after the pass back smoothed
    P: np.ndarray  # (e, n, n) the same for the covariance; fewer entries keep fewer rows' epochs


class Scores(NamedTuple):
    """Slope and expected information of the log likelihood by the logarithm of each density."""

    kept: np.ndarray  # (2, 2, 4) of motion.PSD, by the kept rows of each regime
    rest: np.ndarray  # (2, 4) the same by the other rows of regime 0
    errors: np.ndarray  # (2, n − 9) about the variances of the systematic errors, by the kept rows


def trace(rows: int, n: int, keep: int) -> Trace:
    """Room for ``rows`` rows and ``n`` states, with smoothed states for the first ``keep`` of the rows."""
    f = np.zeros
    return Trace(
        index=f((rows, SLOTS), np.int64),
        gain=f((rows, SLOTS)),
        count=f(rows, np.int64),
        m=f((rows, n)),
        v=f(rows),
        S=f(rows),
        at=f((rows, n)),
        moved=f(rows),
        fresh=f(rows),
        x=f((max(keep, 1), n)),
        P=f((max(keep, 1), n, n)),
    )


def scores(n: int) -> Scores:
    """All zero, of ``n`` states."""
    return Scores(np.zeros((2, 2, 4)), np.zeros((2, 4)), np.zeros((2, n - CORE)))


@kernel
def forward(model, rows, own, densities, x, P, t_ns, keep, out, work):
    """Filter all rows, in place from ``x``, ``P`` at ``t_ns``; returns the time reached.

    ``own`` is their `buffer.Outcome`, whose ``regime`` points into ``densities`` (·, n − 5), see
    `motion.densities`. The states before the epochs that begin within the first ``keep`` rows stay in
    ``out``.
    """
    n = x.size
    for k in range(rows.t.size):
        psd = densities[own.regime[k]]
        if rows.t[k] != t_ns or k == 0:
            predict(x, P, (rows.t[k] - t_ns) * 1e-9, psd, model.rate, model.prior)
            t_ns = rows.t[k]
            if k < keep:
                for a in range(n):
                    out.x[k, a] = x[a]
                    for b in range(n):
                        out.P[k, a, b] = P[a, b]
        v, variance = predict_row(model, rows, k, x, P, psd, out, k, work)
        out.v[k], out.S[k] = v, variance + own.noise[k]
        out.moved[k], out.fresh[k] = _since_last(model, rows, k, x, P, psd, variance, out)
        if own.weight[k] > 0.0:
            update(x, P, out.m[k], v, variance + own.noise[k] / own.weight[k])
    return t_ns


@kernel
def _since_last(model, rows, k, x, P, psd, variance, out):
    """What happened to the prediction of row ``k``, of ``variance``, since its channel's row before.

    (by how much updates have moved it, variance by which the motion may have gone elsewhere): with h the
    row's gradient and F, Q of `predict`, hᵀ(F⁻¹ x − x₋), and entry by entry hᵀ((F − I) P (F − I)ᵀ + Q) h. The
    innovation of a value that stays off by a constant falls by the one, give or take the other: what was
    wrong with the velocity then is known now.
    """
    n, j = x.size, k - 1
    for a in range(n):
        out.at[k, a] = x[a]
    while j >= 0 and (rows.channel[j] != rows.channel[k] or rows.sensor[j] != rows.sensor[k]):
        j -= 1
    if j < 0:
        return 0.0, FRESH * variance
    dt = (rows.t[k] - rows.t[j]) * 1e-9
    half, moved, fresh = 0.5 * dt * dt, 0.0, 0.0
    for p in range(out.count[k]):
        a, g = out.index[k, p], out.gain[k, p]
        now, before, unsure = x[a], out.at[j, a], 0.0
        if a < 3:
            now -= dt * x[a + 3] - half * x[a + 6]
        elif a < 6:
            now -= dt * x[a + 3]
        elif a >= CORE:
            before *= np.exp(-model.rate[a] * dt)
            unsure = psd[a - CORE + MOTIONS] * model.prior[a] * (1.0 - np.exp(-2.0 * model.rate[a] * dt))
        moved += g * (now - before)
        if a < CORE:
            unsure = drift(P, psd, a, dt)
        fresh += g * g * unsure
    return moved, fresh


@kernel
def backward(model, rows, own, densities, keep, out, r, N, found, work):
    """Hold every row against all others; ``r`` (n,), ``N`` (n, n) say what came after, in place.

    Fills ``own.residual`` and ``own.sigma``, smooths the states that ``out`` keeps, and adds up in ``found``
    the `Scores`. ``work``: `scratch`.
    """
    n, Nm = r.size, work[0]
    for k in range(rows.t.size - 1, -1, -1):
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
        if own.weight[k] > 0.0:
            noise = own.noise[k] / own.weight[k]
            spare = noise - own.noise[k]
            S += spare
            e = (v - mr) / S
            D = 1.0 / S + mNm / (S * S)
            own.residual[k] = e / D
            own.sigma[k] = np.sqrt(max(1.0 / D - spare, own.noise[k]))
            _condense(out.index, out.gain, out.count[k], k, e, D, S, r, N, Nm, work[1])
        else:
            own.residual[k] = v - mr
            own.sigma[k] = np.sqrt(max(S - mNm, own.noise[k]))
        if k == 0 or rows.t[k] != rows.t[k - 1]:
            if k < keep:
                _smooth(out.x[k], out.P[k], r, N, work[1:])
            if k > 0:
                dt = (rows.t[k] - rows.t[k - 1]) * 1e-9
                regime = own.regime[k]
                if k < keep:
                    score(r, N, dt, densities[regime], found.kept[regime % 2])
                    score_errors(r, N, dt, densities[regime], model.rate, model.prior, found.errors)
                elif regime == 0:
                    score(r, N, dt, densities[regime], found.rest)
                pull_back(r, N, dt, model.rate)


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
