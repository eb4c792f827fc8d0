"""One raw channel watched alone: outliers found and replaced before any trajectory model.

Self-adaptive linear prediction:

1. Start: the last five values are a good set when |Δ⁴x| ≤ ``start`` σ, Δ⁴x = x₁ − 4x₂ + 6x₃ − 4x₄ + x₅.
2. Run: the line through the last five values predicts the next one. At a steady rate that is
   x̂₆ = Σ (3i − 7)/10 xᵢ; here the values keep their own times, so that lost ones do no harm. A value farther
   than ``threshold`` σ from its prediction is an outlier, and the prediction takes its place.
3. Noise: σ̂² from the last ``window`` residuals by Huber's Proposal 2, Σ min(Δu², C²σ²) = (n − 1) β σ²
   (Huber 1964; with C = 1.5, β = 0.7785 this is the paper's Σ₁ Δu² / ((n − 1) β − N_H C²)).

What the formulas leave open. A residual is divided by the prediction's own error growth, so σ is the
channel's noise, and a prediction far ahead is not trusted like a near one. Through a run of outliers the line
goes through all ``window`` good values, if they lie on one: the slope of five alone lost itself 20 times in
the paper's record, with thousands of false alarms instead of one. Refused residuals enter the noise window
only while they are at most a quarter of it, what Huber's estimate stands. And when nothing was good for
``reach`` samples the prediction is lost: the search for a good set begins again, a restart.

``long-line-adaptive`` goes a step further than the paper. It always predicts by the line through all
``window`` good values: √(1 + 4/30) σ off instead of √2.1 σ, and one outlier let through moves it by an
eighth of its size instead of four fifths. Of a run of refused residuals only the first enters the noise
window, and what ends the run must fit better than others. So it finds outliers down to 6 σ; but 30 values
must lie on a line: it is for steady flight.

What one channel cannot see: a slow error, and a run that is as smooth as the flight itself.
"""

from typing import NamedTuple

import numpy as np
from numba import njit

from filters.screening.predictors import (
    BETA,
    CLIP,
    EVEN,
    FIVE,
    HELD,
    LEVEL,
    RATE,
    RESIDUALS,
    RESTARTS,
    RUNNING,
    SIGMA,
    ChannelState,
    by_line,
    by_tracker,
    interval,
    push,
    spacing,
)

STARTING, GOOD, OUTLIER, MISSING = range(4)
FLAGS = ("starting", "good", "outlier", "missing")
METHODS = ("linear-adaptive", "alpha-beta-adaptive", "linear-fixed", "alpha-beta-fixed", "long-line-adaptive")
PREDICTORS = ("alpha-beta", "linear", "long-line")
TRACKER, LAST_FIVE, ALL_HELD = range(len(PREDICTORS))
LEAST_SHARE = 0.1  # a channel is never ten times better than its sensor says: quantised values repeat
AFTER = 3.5  # σ of a residual right after a refused one: a run must not end with an outlier that nearly fits
YOUNG_REACH = 8.0  # samples; a fourth difference may let an outlier into the first five


class Thresholds(NamedTuple):
    """One channel's thresholds, in σ of its noise."""

    sigma: float  # noise assumed at the start; for good with a fixed threshold. Units of the channel
    start: float = 15.0  # of a fourth difference: 10 to 15
    threshold: float = 5.0  # of a residual: 3 to 5; three raises a false alarm at every 300th value
    window: int = 30  # residuals that tell the noise: 16 to 30
    reach: float = 40.0  # samples that a prediction is good for
    alpha: float = 0.3  # the α-β predictor's gains; β = α²/(2 − α) (Benedict & Bordner 1962)
    period: float = 0.0  # the channel repeats: 2π rad or 360°; 0 does not


class Screened(NamedTuple):
    """n values of one channel, each judged by what came before it."""

    flag: np.ndarray  # (n,) index into FLAGS
    predicted: np.ndarray  # (n,) NaN where there was no prediction
    cleaned: np.ndarray  # (n,) the value where good, its prediction where not
    sigma: np.ndarray  # (n,) noise estimate then
    restarts: int


class Channel:
    """One channel as it comes in. ``step`` gives what ``screen`` gives for the whole column."""

    def __init__(self, settings: Thresholds, method: str = METHODS[0]):
        self._settings, self._method = plain(settings), _choice(method)
        self._state = _new(settings)

    def step(self, t_s: float, value: float) -> tuple[int, float, float, float]:
        """(flag, predicted, cleaned, sigma) of one value, at ``t_s`` seconds after the one before."""
        return step(self._state, t_s, value, self._settings, *self._method)

    @property
    def restarts(self) -> int:
        return int(self._state.count[RESTARTS])


def screen(t_s: np.ndarray, values: np.ndarray, settings: Thresholds, method: str = METHODS[0]) -> Screened:
    """Screen a column: (n,) ascending seconds, (n,) values, NaN where there is none.

    Raises ValueError for a name that is not in ``METHODS``.
    """
    state, n = _new(settings), len(values)
    out = Screened(np.empty(n, np.int8), np.empty(n), np.empty(n), np.empty(n), 0)
    _column(
        state,
        np.asarray(t_s, float),
        np.asarray(values, float),
        plain(settings),
        *_choice(method),
        out,
    )
    return out._replace(restarts=int(state.count[RESTARTS]))


def _choice(method: str) -> tuple[int, bool]:
    """(index into PREDICTORS, adaptive threshold)."""
    if method not in METHODS:
        raise ValueError(f"unknown method {method!r}; choose one of {', '.join(METHODS)}")
    predictor, kind = method.rsplit("-", 1)
    return PREDICTORS.index(predictor), kind == "adaptive"


def plain(settings: Thresholds) -> Thresholds:
    """Floats and one int: one compiled version for all."""
    return Thresholds(*map(float, settings))._replace(window=int(settings.window))


def _new(settings: Thresholds) -> ChannelState:
    n = settings.window
    track = np.array([0.0, 0.0, settings.sigma])
    return ChannelState(
        np.zeros(n), np.zeros(n), np.zeros(n), np.zeros(n, np.bool_), np.zeros(4, np.int64), track
    )


@njit(cache=True)
def _column(state, t, values, settings, predictor, adaptive, out):
    for k in range(len(values)):
        out.flag[k], out.predicted[k], out.cleaned[k], out.sigma[k] = step(
            state, t[k], values[k], settings, predictor, adaptive
        )


@njit(cache=True)
def step(state, t, value, settings, predictor, adaptive):
    """Judge one value. Returns (flag, predicted, cleaned, sigma)."""
    period = settings.period
    reach = settings.reach if state.count[HELD] >= len(state.t) else min(settings.reach, YOUNG_REACH)
    if state.count[RUNNING] and t - state.t[-1] > reach * interval(state):
        state.count[RUNNING], state.count[HELD] = 0, 0
        state.count[RESTARTS] += 1
    if not state.count[RUNNING]:
        return _start(state, t, value, settings)
    if predictor == TRACKER:
        predicted, growth = by_tracker(state, t, settings.alpha)
    else:
        predicted, growth = by_line(state, t, predictor == ALL_HELD)
    shown = predicted % period if period > 0.0 else predicted
    if np.isnan(value):
        return MISSING, shown, shown, state.track[SIGMA]
    residual = _wrapped(value - predicted, period)
    sigma = state.track[SIGMA] if adaptive else settings.sigma
    after = predictor == ALL_HELD and _last_refused(state)
    limit = min(settings.threshold, AFTER) if after else settings.threshold
    good = abs(residual) <= limit * sigma * growth
    if good:
        _accept(state, t, predicted + residual, residual, settings.alpha)
    _remember(state, residual / growth, not good, predictor == ALL_HELD, settings.sigma)
    return (GOOD, shown, value, sigma) if good else (OUTLIER, shown, shown, sigma)


@njit(cache=True)
def _start(state, t, value, settings):
    """Look for five values in a row that a cubic explains."""
    sigma, period = settings.sigma, settings.period
    if np.isnan(value):
        return MISSING, np.nan, np.nan, sigma
    before = state.x[-1]
    push(state, t, before + _wrapped(value - before, period) if state.count[HELD] else value)
    x = state.x[-FIVE:]
    fourth = x[0] - 4.0 * x[1] + 6.0 * x[2] - 4.0 * x[3] + x[4]
    shortest, longest, _ = spacing(state)
    even = longest <= EVEN * shortest
    if state.count[HELD] < FIVE or not even or abs(fourth) > settings.start * sigma:
        return STARTING, np.nan, np.nan, sigma
    state.count[RUNNING], state.count[RESIDUALS] = 1, 0
    state.refused[:] = False
    state.track[SIGMA], state.track[LEVEL] = sigma, x[-1]
    state.track[RATE] = (2.0 * (x[4] - x[0]) + x[3] - x[1]) / (10.0 * interval(state))
    return GOOD, np.nan, value, sigma


@njit(cache=True)
def _accept(state, t, x, residual, alpha):
    """A good value joins the line and the tracker."""
    dt = t - state.t[-1]
    state.track[LEVEL] = x - (1.0 - alpha) * residual
    state.track[RATE] += alpha**2 / (2.0 - alpha) * residual / dt
    push(state, t, x)


@njit(cache=True)
def _remember(state, residual, refused, once, sigma):
    """Let a residual into the noise window, and estimate the noise anew once the window is full.

    ``once``: of a run of refused ones no more than the first.
    """
    n = len(state.residual)
    if refused and (4 * (state.refused.sum() + 1) > n or (once and _last_refused(state))):
        return
    place = state.count[RESIDUALS] % n
    state.residual[place], state.refused[place] = residual, refused
    state.count[RESIDUALS] += 1
    if state.count[RESIDUALS] < n:
        return
    variance = state.track[SIGMA] ** 2
    for _ in range(8):  # a contraction by about 0.4 each time
        total = 0.0
        for u in state.residual:
            total += min(u * u, CLIP**2 * variance)
        variance = total / ((n - 1) * BETA)
    state.track[SIGMA] = max(np.sqrt(variance), LEAST_SHARE * sigma)


@njit(cache=True)
def _last_refused(state):
    """Whether the newest residual in the noise window was refused."""
    return state.refused[(state.count[RESIDUALS] - 1) % len(state.refused)]


@njit(cache=True)
def _wrapped(difference, period):
    return difference - period * np.round(difference / period) if period > 0.0 else difference
