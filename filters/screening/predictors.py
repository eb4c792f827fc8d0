"""What one channel remembers of itself, and the two ways it predicts its next value: line and α-β tracker."""

from typing import NamedTuple

import numpy as np
from numba import njit

CLIP, BETA = 1.5, 0.7785  # Huber's C and E[min(u², C²)] of a standard normal u
FIVE = 5
STRAIGHT = 1.3  # σ: values that scatter more about their line are no line
EVEN = 1.5  # values whose spacing varies more than this are no set for a fourth difference


class ChannelState(NamedTuple):
    """All that one channel remembers; arrays, changed in place."""

    t: np.ndarray  # (window,) s, the last good values (any while starting), oldest first
    x: np.ndarray  # (window,) their values, unwrapped
    residual: np.ndarray  # (window,) the last residuals over their growth
    refused: np.ndarray  # (window,) which of them were not good
    count: np.ndarray  # (4,) int: running, values held since the start, residuals so far, restarts
    track: np.ndarray  # (3,) α-β level and rate, σ̂


RUNNING, HELD, RESIDUALS, RESTARTS = range(4)
LEVEL, RATE, SIGMA = range(3)


@njit(cache=True)
def by_line(state, t, always):
    """Prediction by the line through the last five, and the 1-sigma of its residual in σ of one value.

    Farther ahead than one value the slope of five is too poor: there, or ``always``, the line goes through
    all good values remembered, if they lie on one.
    """
    n = len(state.t)
    if state.count[HELD] >= n and (always or t - state.t[-1] > EVEN * interval(state)):
        predicted, growth, slope = _line(state.t, state.x, t)
        sigma = state.track[SIGMA]
        scatter = _scatter(state.t - t, state.x - predicted, slope, CLIP * sigma if always else np.inf)
        if scatter <= STRAIGHT * sigma:
            return predicted, growth
    predicted, growth, _ = _line(state.t[-FIVE:], state.x[-FIVE:], t)
    return predicted, growth


@njit(cache=True)
def _line(times, x, t):
    """Least-squares line: its value at ``t``, the growth there, and its slope."""
    n, mean_t, mean_x = len(x), times.mean(), x.mean()
    spread = moment = 0.0
    for k in range(n):
        since = times[k] - mean_t
        spread += since * since
        moment += since * (x[k] - mean_x)
    slope = moment / spread
    return mean_x + slope * (t - mean_t), np.sqrt(1.0 + 1.0 / n + (t - mean_t) ** 2 / spread), slope


@njit(cache=True)
def _scatter(since, off, slope, most):
    """The values' scatter about their line; with a finite ``most``, of a residual, Huber's as for the noise.

    One outlier that was let through does not make the line a bent one so, and five values a worse one.
    """
    total = 0.0
    for k in range(len(off)):
        total += min(abs(off[k] - slope * since[k]), most) ** 2
    return np.sqrt(total / (len(off) - 2) / (BETA if most < np.inf else 1.0))


@njit(cache=True)
def by_tracker(state, t, alpha):
    """The same by the α-β tracker, whose variances in balance are Kalata's (1984)."""
    beta = alpha**2 / (2.0 - alpha)
    dt = t - state.t[-1]
    steps = dt / interval(state)
    scale = alpha * (4.0 - 2.0 * alpha - beta)
    level = (2.0 * alpha**2 - 3.0 * alpha * beta + 2.0 * beta) / scale
    cross, rate = beta * (2.0 * alpha - beta) / scale, 2.0 * beta**2 / scale
    growth = np.sqrt(1.0 + level + 2.0 * steps * cross + steps**2 * rate)
    return state.track[LEVEL] + dt * state.track[RATE], growth


@njit(cache=True)
def push(state, t, x):
    """A value joins those remembered; the oldest goes."""
    for k in range(len(state.t) - 1):
        state.t[k], state.x[k] = state.t[k + 1], state.x[k + 1]
    state.t[-1], state.x[-1] = t, x
    state.count[HELD] += 1


@njit(cache=True)
def spacing(state):
    """Shortest, longest and median of the four steps between the last five, s."""
    shortest, longest, total = np.inf, 0.0, state.t[-1] - state.t[-FIVE]
    for k in range(len(state.t) - FIVE + 1, len(state.t)):
        step = state.t[k] - state.t[k - 1]
        shortest, longest = min(shortest, step), max(longest, step)
    return shortest, longest, (total - shortest - longest) / 2.0


@njit(cache=True)
def interval(state):
    """Seconds between values, as the last five have it."""
    return spacing(state)[2]
