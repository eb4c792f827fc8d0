"""The gated update: rows at first sight, before later ones can speak for or against them."""

from typing import NamedTuple

import numpy as np
from numba import njit

from filters.models.motion import CORE, predict
from filters.models.rows import AE, RANGE_RATE
from filters.models.runs import CHANCE, NEAR
from filters.models.state import predict_row
from filters.models.update import spread, update
from filters.models.update import weight as igg
from filters.smoother.status import (
    NEGLIGIBLE,
    PATCH_ROWS,
    common_cause,
    filtered,
    log_good,
    log_gross,
)

NEVER_NS = np.iinfo(np.int64).max  # as a time from which on
GATE = 3.5  # sigmas from which the order of simultaneous rows matters
SURPRISE = 7.0  # lost log likelihood that asks for a re-decision at once: odds of a thousand
MOST = 4.0  # … for which one row can be the cause: an outlier by itself is no reason
FADE = 0.9  # of the surprise from epoch to epoch


class Rule(NamedTuple):
    """How good a row is at first sight."""

    kind: int  # STATUS, IGG or M1
    soft: float  # sigmas up to which a row has full weight; IGG and M1
    hard: float  # … from which it has none


STATUS, IGG, M1 = range(3)
BY_STATUS = Rule(STATUS, 0.0, 0.0)


class EpochStates(NamedTuple):
    """The states epoch by epoch, predicted (``before``) and updated; arrays (e, …)."""

    t: np.ndarray  # ns
    fixed: np.ndarray  # bool, whether a row was used that ties the state down: no acceleration, no range rate
    before_x: np.ndarray  # (e, 9) predicted
    before_P: np.ndarray  # (e, 9, 9)
    x: np.ndarray  # (e, n) updated
    P: np.ndarray  # (e, 9, 9)


def epoch_states(epochs: int, n: int) -> EpochStates:
    """Room for so many ``epochs`` of ``n`` states."""
    f = np.zeros
    return EpochStates(
        f(epochs, "i8"), f(epochs, "?"), f((epochs, CORE)), f((epochs, CORE, CORE)), f((epochs, n)),
        f((epochs, CORE, CORE)),
    )  # fmt: skip


@njit(cache=True)
def admit(
    model, rows, own, begin, scale, psd, x, P, t_ns, memory, excluded, rule, surprise, quiet_ns, out, to, work
):  # fmt: skip
    """Filter rows epoch by epoch, in place; stops after the first epoch from ``quiet_ns`` on that surprises.

    Where a row of an epoch looks wrong, those that agree best with the prediction go first and sharpen it
    for the rest: the sensors vote at the same instant. What is made of the rows goes into ``own`` from
    ``begin`` on; ``scale`` (s, 13) is the logarithm of their noise variance over the stated one.
    ``memory`` (s, 13, MEMORY) are the statuses so far, see `status.filtered`. Rows of sensor ``excluded`` get
    no weight. The states go into ``to``. Returns (rows taken, epochs, the surprise reached).
    """
    count, epoch, i = len(rows.t), 0, 0
    misfit = np.zeros(count)
    for k in range(count):
        own.noise[begin + k] = rows.stated[k] * np.exp(scale[rows.sensor[k], rows.channel[k]])
        own.regime[begin + k] = 0
    while i < count:
        end = i + 1
        while end < count and rows.t[end] == rows.t[i]:
            end += 1
        predict(x, P, (rows.t[i] - t_ns) * 1e-9, psd, model.rate, model.prior)
        t_ns = rows.t[i]
        to.before_x[epoch], to.before_P[epoch] = x[:CORE], P[:CORE, :CORE]
        largest = 0.0
        for k in range(i, end):
            v, variance = predict_row(model, rows, k, x, P, psd, out, 0, work)
            misfit[k] = abs(v) / np.sqrt(variance + own.noise[begin + k])
            largest = max(largest, misfit[k])
        order = np.argsort(misfit[i:end]) if largest > GATE else np.arange(end - i)
        fixed, lost = False, 0.0
        for j in order:
            k = i + j
            s, c = rows.sensor[k], rows.channel[k]
            v, variance = predict_row(model, rows, k, x, P, psd, out, 0, work)
            noise = own.noise[begin + k]
            sigma = np.sqrt(variance + noise)
            w, likelihood = weigh(rule, memory, s, c, v, sigma, noise, t_ns)
            if s == excluded:
                w = 0.0
            else:
                lost += min(log_good(sigma, sigma) - likelihood, MOST) - MOST * memory[s, c, CHANCE]
            at = begin + k
            own.weight[at], own.residual[at], own.sigma[at], own.nis[at] = w, v, sigma, (v / sigma) ** 2
            if w > 0.0:
                if rule.kind == IGG:
                    update(x, P, out.m[0], v, variance + noise / w)
                else:  # the gain is w K
                    update(x, P, out.m[0], v, (variance + noise) / w)
                if rule.kind == STATUS:
                    spread(P, out.m[0], v, variance + noise, w)
                fixed |= c < AE and c != RANGE_RATE
        to.t[epoch], to.fixed[epoch] = t_ns, fixed
        to.x[epoch], to.P[epoch] = x, P[:CORE, :CORE]
        epoch += 1
        i = end
        surprise = max(FADE * surprise + lost, 0.0)
        if surprise > SURPRISE and t_ns >= quiet_ns:
            break
    return i, epoch, surprise


@njit(cache=True)
def weigh(rule, memory, s, c, v, sigma, noise, t_ns):
    """Weight of a row at first sight and its log likelihood; ``memory`` (s, 13, MEMORY) moves on in place."""
    m = memory[s, c]
    if rule.kind == STATUS:
        w, likelihood = filtered(m, v, sigma, noise, t_ns, common_cause(memory, s, c, t_ns))
        w *= 1.0 - m[NEAR]  # its sensor is astray
        return (w if w > NEGLIGIBLE else 0.0), likelihood
    w, likelihood = igg(v / sigma, rule.soft, rule.hard), max(log_good(v, sigma), log_gross(v, sigma))
    m[3] = m[3] + 1.0 if w < 1.0 else 0.0  # consecutive outliers
    if rule.kind == M1 and m[3] >= PATCH_ROWS:
        w = 0.0
    return w, likelihood
