"""First decisions about fresh rows, and re-decisions of all rows in the window."""

import numpy as np
from numba import njit

from filters.models.kernel import exact
from filters.models.model import predict_row
from filters.models.motion import predict
from filters.models.rows import AE, RANGE_RATE
from filters.models.unscented import difference
from filters.models.update import update, weight
from filters.window import outlier
from filters.window.passes import ahead, back

REPEAT = 3  # passes over the window at most; one is enough while nothing changes
OUTBREAK = outlier.HARD**2
CONTINUED = 2.5
MEMORY = 0.2  # of each further row in a channel's share of misfits
CROWD = 0.5  # share of misfits on both sides of a row from which it fits by chance only
SETTLED = 0.2  # a change of weight that is no change


@njit(cache=True)
def admit(model, rows, begin, end, x, P, t_ns, jerk, variance, run, soft, hard, watched, out, work):
    """Filter one epoch's rows, each on first sight, in place; fills their weight, predicted and sigma.

    Where one looks wrong, those that agree best with the prediction go first and sharpen it for the rest:
    the sensors vote at the same instant. ``jerk`` and ``variance`` (s, 13) are those of motion and noise now,
    ``run`` each channel's `outlier.label` state; a sensor ``watched`` (s,) by others is judged more strictly
    within a run. The predicted state goes to ``out.x[0]``, ``out.P[0]``. Returns whether a row was used that
    ties the state down: any but an acceleration or a range rate.
    """
    predict(x, P, (rows.t[begin] - t_ns) * 1e-9, jerk, model.rate, model.prior)
    out.x[0], out.P[0] = x, P
    doubt = np.zeros(end - begin)
    for i in range(begin, end):
        s, c = rows.sensor[i], rows.channel[i]
        rows.noise[i], rows.jerk[i] = variance[s, c], jerk
        seen, spread = predict_row(model, s, c, x, P, jerk, out, 0, work)
        doubt[i - begin] = abs(difference(c, rows.value[i], seen)) / np.sqrt(spread + rows.noise[i])
    fixed = False
    order = np.argsort(doubt) if doubt.max() > soft else np.arange(end - begin)
    for k in order:
        i = begin + k
        s, c = rows.sensor[i], rows.channel[i]
        seen, spread = predict_row(model, s, c, x, P, jerk, out, 0, work)
        noise = rows.noise[i]
        v, sigma = difference(c, rows.value[i], seen), np.sqrt(spread + noise)
        after = watched[s] and run[s, c, 0] > 0.0
        limit = min(hard, outlier.AFTER) if after else hard
        w = weight(v / sigma, min(soft, limit), limit)
        if after and run[s, c, 0] > 1.0 and outlier.same_run(run[s, c, 1], v, np.sqrt(noise)):
            w = 0.0
        rows.weight[i], rows.off[i], rows.predicted[i], rows.sigma[i] = w, v, rows.value[i] - v, sigma
        rows.nis[i] = (v / sigma) ** 2
        if w > 0.0:
            update(x, P, out.m[0], v, spread + noise / w)
            fixed |= c < AE and c != RANGE_RATE
    return fixed


@njit(cache=True)
def settle(
    model, rows, begin, end, x0, P0, t0_ns, soft, hard, continued, watched, run, x, P, out, work, r, N, recent
):  # fmt: skip
    """Weigh rows ``begin`` to ``end`` again, each by what all the others say, from their weights as they are.

    ``x0, P0`` at ``t0_ns`` is the anchor; the head state goes to ``x``, ``P``. Returns the `cost` and its
    slope by the density of the jerk.
    """
    total = slope = 0.0
    for _ in range(REPEAT):
        x[:], P[:] = x0, P0
        ahead(model, rows, begin, end, x, P, t0_ns, out, work)
        r[:], N[:] = 0.0, 0.0
        slope = back(model, rows, begin, end, out, r, N, work)
        total = cost(rows, begin, end, continued, out, recent)
        if reweigh(rows, begin, end, soft, hard, watched, run, out, recent) < SETTLED:
            break
    return total, slope


@njit(cache=True)
def price(model, rows, begin, end, x0, P0, t0_ns, continued, x, P, out, work, recent):
    """`cost` of the window with its weights, noise and jerk as they are; nothing is judged."""
    x[:], P[:] = x0, P0
    ahead(model, rows, begin, end, x, P, t0_ns, out, work)
    return cost(rows, begin, end, continued, out, recent)


@exact
def cost(rows, begin, end, continued, out, recent):
    """−2 log likelihood of the window under its verdicts, up to a constant: the lower, the better the story.

    Used rows: innovations form, v²/S + ln(S/R). Refused ones: OUTBREAK to begin a run, ``continued`` for each
    further row.
    """
    total = 0.0
    before = recent[:, :, 0]
    before[:] = 0.0
    for i in range(begin, end):
        s, c, k = rows.sensor[i], rows.channel[i], i - begin
        out_of_use = rows.weight[i] == 0.0
        if out_of_use:
            total += continued if before[s, c] > 0.0 else OUTBREAK
        else:
            noise = rows.noise[i]
            S = out.S[k] + noise / rows.weight[i] - noise
            total += out.v[k] ** 2 / S + np.log(S / noise)
        before[s, c] = out_of_use
    return total


@exact
def reweigh(rows, begin, end, soft, hard, watched, run, out, recent):
    """New weights from the residuals against all other rows; returns the largest change.

    A row next to an outlier of its channel is under suspicion: AFTER sigmas instead of ``hard``; the sigma
    that counts is bounded, because it has grown only for want of the neighbours; and there has to be a jump
    from the outlier to it, or else it is the same run's next row that happens to fit. All this only where the
    sensor is ``watched`` (s,): alone, a sigma grows with good reason, and nobody can say that it is a run.
    Amid a crowd of misfits, a row that fits does so by chance: refused as well; ``run`` (s, 13, 2), as of
    `outlier.label`, says what went before. ``recent`` (s, 13, 3) is scratch: each channel's count of rows
    refused before, the last residual, and the share of misfits.
    """
    for k in range(end - begin):
        out.next[k], out.alike[k], out.crowd[k] = False, False, False
    for s in range(run.shape[0]):
        for c in range(run.shape[1]):
            recent[s, c, 2] = 1.0 if run[s, c, 0] >= outlier.RUN else 0.0
    for direction in (1, -1):
        recent[:, :, :2] = 0.0
        for j in range(begin, end):
            i = j if direction == 1 else begin + end - 1 - j
            s, c, k = rows.sensor[i], rows.channel[i], i - begin
            if not watched[s]:
                continue
            if recent[s, c, 0] > 0.0:
                out.next[k] = True
            if recent[s, c, 0] > 1.0:
                out.alike[k] |= outlier.same_run(recent[s, c, 1], out.off[k], np.sqrt(rows.noise[i]))
            if direction == 1:
                out.crowd[k] = recent[s, c, 2] > CROWD
            else:
                out.alike[k] |= out.crowd[k] and recent[s, c, 2] > CROWD
            misfit = abs(out.off[k]) > outlier.AFTER * out.sigma[k]
            recent[s, c, 2] += MEMORY * ((1.0 if misfit else 0.0) - recent[s, c, 2])
            recent[s, c, 0] = recent[s, c, 0] + 1.0 if rows.weight[i] == 0.0 else 0.0
            recent[s, c, 1] = out.off[k]
    change = 0.0
    for i in range(begin, end):
        k = i - begin
        limit, sigma = hard, out.sigma[k]
        if out.next[k]:
            limit = min(hard, outlier.AFTER)
            sigma = min(sigma, outlier.BOUND * np.sqrt(rows.noise[i]))
        w = 0.0 if out.alike[k] else weight(out.off[k] / sigma, min(soft, limit), limit)
        change = max(change, abs(w - rows.weight[i]))
        rows.weight[i] = w
        rows.off[i], rows.predicted[i], rows.sigma[i] = out.off[k], rows.value[i] - out.off[k], out.sigma[k]
        rows.nis[i] = out.v[k] ** 2 / out.S[k]
    return change
