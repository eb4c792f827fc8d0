"""First decisions about fresh rows, and re-decisions of all rows in the window."""

import numpy as np
from numba import njit

from filters import outlier
from filters.model import predict_row
from filters.motion import predict
from filters.unscented import difference
from filters.window import ahead, back, update

REPEAT = 4  # passes over the window at most; one is enough while nothing changes
SETTLED = 0.05  # a change of weight that is no change


@njit(cache=True)
def admit(model, rows, begin, end, x, P, t_ns, run, soft, hard, out, work):
    """Filter one epoch's rows, each on first sight, in place; fills their weight, predicted and sigma.

    The predicted state goes to ``out.x[0]``, ``out.P[0]``.

    Where one looks wrong, those that agree best with the prediction go first and sharpen it for the rest:
    the sensors vote at the same instant. ``run`` (s, 13) counts each channel's consecutive outliers.
    """
    predict(x, P, (rows.t[begin] - t_ns) * 1e-9, model.jerk_psd, model.rate, model.prior)
    out.x[0], out.P[0] = x, P
    index, gain, m = out.index[0], out.gain[0], out.m[0]
    doubt = np.zeros(end - begin)
    for i in range(begin, end):
        s, c = rows.sensor[i], rows.channel[i]
        seen, variance, _ = predict_row(model, s, c, x, P, index, gain, m, work)
        doubt[i - begin] = abs(difference(c, rows.value[i], seen)) / np.sqrt(variance + model.variance[s, c])
    order = np.argsort(doubt) if doubt.max() > soft else np.arange(end - begin)
    for k in order:
        i = begin + k
        s, c = rows.sensor[i], rows.channel[i]
        seen, variance, _ = predict_row(model, s, c, x, P, index, gain, m, work)
        noise = model.variance[s, c]
        v, sigma = difference(c, rows.value[i], seen), np.sqrt(variance + noise)
        limit = min(hard, outlier.AFTER) if run[s, c] > 0 else hard
        w = outlier.weight(v / sigma, min(soft, limit), limit)
        rows.weight[i], rows.predicted[i], rows.sigma[i] = w, rows.value[i] - v, sigma
        rows.nis[i] = (v / sigma) ** 2
        run[s, c] = run[s, c] + 1 if w == 0.0 else 0
        if w > 0.0:
            update(x, P, m, v, variance + noise / w)


@njit(cache=True)
def redecide(model, rows, begin, end, x0, P0, t0_ns, soft, hard, x, P, out, work, r, N):
    """Weigh rows ``begin`` to ``end`` again, each by what all the others say; head state into ``x``, ``P``."""
    for _ in range(REPEAT):
        x[:], P[:] = x0, P0
        ahead(
            model, rows.t, rows.sensor, rows.channel, rows.value, rows.weight, begin, end, x, P, t0_ns, out, work
        )  # fmt: skip
        r[:], N[:] = 0.0, 0.0
        back(model, rows.t, rows.sensor, rows.channel, rows.weight, begin, end, out, r, N, work)
        change = 0.0
        for i in range(begin, end):
            k = i - begin
            w = outlier.weight(out.off[k] / out.sigma[k], soft, hard)
            change = max(change, abs(w - rows.weight[i]))
            rows.weight[i] = w
            rows.predicted[i], rows.sigma[i] = rows.value[i] - out.off[k], out.sigma[k]
            rows.nis[i] = out.v[k] ** 2 / out.S[k]
        if change < SETTLED:
            break
