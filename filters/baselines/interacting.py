"""Filters side by side with the weights of the literature, row by row, until the lock is lost."""

from typing import NamedTuple

import numpy as np
from numba import njit

from filters.models import motion
from filters.models import state as models
from filters.models.rows import RANGE_RATE, VE
from filters.models.update import update

IMQ_SIGMAS = 3.0  # c: a value so far off has half its weight; 2 to 4 make little difference
SOFT_GATE = 3.0  # sigmas of the innovation
STAY_S = 2.0  # a manoeuvre lasts about so long, and so does the calm
BELIEVED = 0.1  # weight of a position from which on it counts as believed
LOST_NS, LOST_ROWS = 2_000_000_000, 10  # no position believed for so long, and so many that were not: lost
SILENT_NS = 10_000_000_000  # so long without a position believed is a gap that no filter bridges
LOST, SILENT = 1, 2
REASONS = {LOST: "no position believed for 2 s", SILENT: "nothing heard of its place for 10 s"}


class Mixture(NamedTuple):
    """m filters side by side and how much each is believed."""

    x: np.ndarray  # (m, n)
    P: np.ndarray  # (m, n, n)
    chance: np.ndarray  # (m,) sums to 1
    lock: np.ndarray  # (2,) time of the newest position believed, ns; positions not believed since


class Followed(NamedTuple):
    """What was made of k rows: arrays (k,), and of the states after each epoch."""

    weight: np.ndarray
    residual: np.ndarray
    sigma: np.ndarray
    nis: np.ndarray
    x: np.ndarray  # (e, n)
    P: np.ndarray  # (e, n, n)


@njit(cache=True)
def follow(model, rows, t_ns, psds, imq, mixture, judged, out, work):
    """Filter rows (k,) from ``mixture`` at ``t_ns``, in place, until the lock is lost; fills ``judged``.

    Returns (rows taken, epochs, why it ended early: LOST, SILENT or 0).
    """
    evidence, epoch = np.zeros(len(psds)), 0
    for i in range(len(rows.t)):
        position = rows.channel[i] < VE and rows.channel[i] != RANGE_RATE
        if i == 0 or rows.t[i] != t_ns:
            silence = rows.t[i] - mixture.lock[0]
            if silence > LOST_NS and mixture.lock[1] >= LOST_ROWS:
                return i, epoch, LOST
            if silence > SILENT_NS:
                return i, epoch, SILENT
            dt = (rows.t[i] - t_ns) * 1e-9
            mix(mixture, dt)
            for k in range(len(psds)):
                motion.predict(mixture.x[k], mixture.P[k], dt, psds[k], model.rate, model.prior)
            evidence[:] = 0.0
            t_ns = rows.t[i]
        noise = rows.stated[i]
        for k in range(len(psds)):
            chance = mixture.chance[k]
            v, variance = models.predict_row(
                model, rows, i, mixture.x[k], mixture.P[k], psds[k], out, 0, work
            )
            u2 = v * v / (variance + noise)
            w = _imq(v * v / noise) if imq else _huber(u2)
            S = variance + noise / w
            update(mixture.x[k], mixture.P[k], out.m[0], v, S)
            evidence[k] -= 0.5 * (v * v / S + np.log(S))
            judged.weight[i] += chance * w
            judged.residual[i] += chance * v
            judged.sigma[i] += chance * np.sqrt(variance + noise)
            judged.nis[i] += chance * u2
        if position and judged.weight[i] >= BELIEVED:
            mixture.lock[0], mixture.lock[1] = t_ns, 0
        elif position:
            mixture.lock[1] += 1
        if i + 1 == len(rows.t) or rows.t[i + 1] != t_ns:
            mixture.chance[:] *= np.exp(evidence - evidence.max())
            mixture.chance[:] /= mixture.chance.sum()
            blend(mixture, mixture.chance, judged.x[epoch], judged.P[epoch])
            epoch += 1
    return len(rows.t), epoch, 0


@njit(cache=True)
def _imq(u2):
    return 1.0 / (1.0 + u2 / IMQ_SIGMAS**2)


@njit(cache=True)
def _huber(u2):
    return 1.0 if u2 <= SOFT_GATE**2 else SOFT_GATE**2 / u2


@njit(cache=True)
def mix(mixture, dt):
    """Each filter begins from what all of them may have become in ``dt`` seconds, in place."""
    m = len(mixture.chance)
    if m == 1:
        return
    leave = 0.5 - 0.5 * np.exp(-2.0 * dt / STAY_S)
    before = Mixture(mixture.x.copy(), mixture.P.copy(), mixture.chance.copy(), mixture.lock)
    for j in range(m):
        share = before.chance * leave / (m - 1)
        share[j] = before.chance[j] * (1.0 - leave)
        mixture.chance[j] = share.sum()
        blend(before, share / share.sum(), mixture.x[j], mixture.P[j])


@njit(cache=True)
def blend(mixture, share, x, P):
    """Mean and covariance of the mixture, in place of ``x`` (n,), ``P`` (n, n)."""
    x[:], P[:] = 0.0, 0.0
    for k in range(len(share)):
        x += share[k] * mixture.x[k]
    for k in range(len(share)):
        off = mixture.x[k] - x
        P += share[k] * (mixture.P[k] + np.outer(off, off))
