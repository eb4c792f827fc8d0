"""Outlier handling of the GA-BP-UKF paper ("GA-BPNN anti-outlier UKF for flight-test trajectories").

Innovation d and its standard deviation σ per component, both from the prediction; normal is |d| ≤ C σ.
An isolated outlier keeps a part β < 1 of its gain, the smaller the larger the innovation. Consecutive
outliers of a component are counted: from the ``outlier.RUN``-th on they are a patch, and the prediction
replaces the measurement (β = 0). How β follows |d|/σ is left open there: IGG-III's weight is taken.
"""

import numpy as np
from numba import njit

from filters.models.model import predict_row
from filters.models.motion import predict
from filters.models.rows import ISOLATED, PATCH, USED
from filters.models.unscented import difference
from filters.models.update import update, weight
from filters.window import outlier

C = 4.0  # sigmas; at 3, a curved first prediction loses its target once in 50 starts
NOTHING = 8.0  # sigmas from which β = 0


@njit(cache=True)
def admit(model, rows, begin, end, x, P, t_ns, jerk, variance, run, soft, hard, watched, out, work):
    """Filter one epoch's rows in place, as `decide.admit` does: ``soft`` is C, ``hard`` is where β reaches 0.

    ``jerk`` and ``variance`` (s, 13) are those of motion and noise; ``run`` (s, 13, 2) counts each channel's
    consecutive outliers, kept by `label`; ``watched`` means nothing here. Fills the rows' columns, weight by
    β, and puts the predicted state into ``out.x[0]``, ``out.P[0]``.
    The covariance goes with the gain: βK is the best gain for a noise that makes the innovation S/β.
    """
    predict(x, P, (rows.t[begin] - t_ns) * 1e-9, jerk, model.rate, model.prior)
    out.x[0], out.P[0] = x, P
    for i in range(begin, end):
        s, c = rows.sensor[i], rows.channel[i]
        rows.noise[i], rows.jerk[i] = variance[s, c], jerk
        seen, spread = predict_row(model, s, c, x, P, jerk, out, 0, work)
        d, sigma = difference(c, rows.value[i], seen), np.sqrt(spread + rows.noise[i])
        beta = weight(d / sigma, soft, hard)
        if beta < 1.0 and run[s, c, 0] + 1 >= outlier.RUN:
            beta = 0.0
        rows.weight[i], rows.off[i], rows.predicted[i], rows.sigma[i] = beta, d, rows.value[i] - d, sigma
        rows.nis[i] = (d / sigma) ** 2
    for i in range(begin, end):
        if rows.weight[i] > 0.0:
            s, c = rows.sensor[i], rows.channel[i]
            seen, spread = predict_row(model, s, c, x, P, jerk, out, 0, work)
            v = difference(c, rows.value[i], seen)
            update(x, P, out.m[0], v, (spread + rows.noise[i]) / rows.weight[i])


@njit(cache=True)
def label(sensor, channel, weight, off, verdict, reason, begin, end, run, alone):
    """Name rows ``begin`` to ``end`` by their β, count outliers in ``run``, in place; as `outlier.label`.

    M1 asks no other sensor: ``alone`` is not read. When a run becomes a patch, its first members are renamed.
    """
    for i in range(begin, end):
        s, c = sensor[i], channel[i]
        run[s, c, 0] = run[s, c, 0] + 1.0 if weight[i] < 1.0 else 0.0
        run[s, c, 1] = off[i]
        if run[s, c, 0] == 0.0:
            verdict[i], reason[i] = USED, outlier.NONE
        elif run[s, c, 0] < outlier.RUN:
            verdict[i], reason[i] = ISOLATED, outlier.INNOVATION
        else:
            verdict[i], reason[i] = PATCH, outlier.IN_RUN
        if run[s, c, 0] == outlier.RUN:
            left, k = outlier.RUN - 1, i - 1
            while left > 0 and k >= 0:
                if sensor[k] == s and channel[k] == c:
                    left -= 1
                    verdict[k], reason[k] = PATCH, outlier.IN_RUN
                k -= 1
