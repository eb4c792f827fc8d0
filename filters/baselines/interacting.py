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


class Mind(NamedTuple):
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
def follow(model, rows, t_ns, psds, imq, mind, told, out, work):
    """Filter rows (k,) from ``mind`` at ``t_ns``, in place, until the lock is lost; fills ``told``.

    Returns (rows taken, epochs, why it ended early: LOST, SILENT or 0).
    """
    evidence, epoch = np.zeros(len(psds)), 0
    for i in range(len(rows.t)):
        position = rows.channel[i] < VE and rows.channel[i] != RANGE_RATE
        if i == 0 or rows.t[i] != t_ns:
            silence = rows.t[i] - mind.lock[0]
            if silence > LOST_NS and mind.lock[1] >= LOST_ROWS:
                return i, epoch, LOST
            if silence > SILENT_NS:
                return i, epoch, SILENT
            dt = (rows.t[i] - t_ns) * 1e-9
            mix(mind, dt)
            for k in range(len(psds)):
                motion.predict(mind.x[k], mind.P[k], dt, psds[k], model.rate, model.prior)
            evidence[:] = 0.0
            t_ns = rows.t[i]
        noise = rows.stated[i]
        for k in range(len(psds)):
            chance = mind.chance[k]
            v, variance = models.predict_row(model, rows, i, mind.x[k], mind.P[k], psds[k], out, 0, work)
            u2 = v * v / (variance + noise)
            w = _imq(v * v / noise) if imq else _huber(u2)
            S = variance + noise / w
            update(mind.x[k], mind.P[k], out.m[0], v, S)
            evidence[k] -= 0.5 * (v * v / S + np.log(S))
            told.weight[i] += chance * w
            told.residual[i] += chance * v
            told.sigma[i] += chance * np.sqrt(variance + noise)
            told.nis[i] += chance * u2
        if position and told.weight[i] >= BELIEVED:
            mind.lock[0], mind.lock[1] = t_ns, 0
        elif position:
            mind.lock[1] += 1
        if i + 1 == len(rows.t) or rows.t[i + 1] != t_ns:
            mind.chance[:] *= np.exp(evidence - evidence.max())
            mind.chance[:] /= mind.chance.sum()
            blend(mind, mind.chance, told.x[epoch], told.P[epoch])
            epoch += 1
    return len(rows.t), epoch, 0


@njit(cache=True)
def _imq(u2):
    return 1.0 / (1.0 + u2 / IMQ_SIGMAS**2)


@njit(cache=True)
def _huber(u2):
    return 1.0 if u2 <= SOFT_GATE**2 else SOFT_GATE**2 / u2


@njit(cache=True)
def mix(mind, dt):
    """Each filter begins from what all of them may have become in ``dt`` seconds, in place."""
    m = len(mind.chance)
    if m == 1:
        return
    leave = 0.5 - 0.5 * np.exp(-2.0 * dt / STAY_S)
    before = Mind(mind.x.copy(), mind.P.copy(), mind.chance.copy(), mind.lock)
    for j in range(m):
        share = before.chance * leave / (m - 1)
        share[j] = before.chance[j] * (1.0 - leave)
        mind.chance[j] = share.sum()
        blend(before, share / share.sum(), mind.x[j], mind.P[j])


@njit(cache=True)
def blend(mind, share, x, P):
    """Mean and covariance of the mixture, in place of ``x`` (n,), ``P`` (n, n)."""
    x[:], P[:] = 0.0, 0.0
    for k in range(len(share)):
        x += share[k] * mind.x[k]
    for k in range(len(share)):
        off = mind.x[k] - x
        P += share[k] * (mind.P[k] + np.outer(off, off))
