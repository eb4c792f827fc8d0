"""The two predictions of one channel against a least-squares fit and drawn noise."""

import numpy as np
import pytest

from filters.screening import predictors
from filters.screening.predictors import ChannelState, by_line, by_tracker, push

pytestmark = pytest.mark.decision

WINDOW, STEP_S = 30, 0.05
SINCE_S = STEP_S * np.arange(WINDOW)
NOISE = np.random.default_rng(1).normal(size=WINDOW)


def remembered(x: np.ndarray, t_s: np.ndarray = SINCE_S, sigma: float = 1.0) -> ChannelState:
    """A channel that has held these values (window,) from its start on."""
    state = ChannelState(
        np.zeros(WINDOW), np.zeros(WINDOW), np.zeros(WINDOW), np.zeros(WINDOW, bool), np.zeros(4, np.int64),
        np.array([0.0, 0.0, sigma]),
    )  # fmt: skip
    for pair in zip(t_s, x, strict=True):
        push(state, *pair)
    return state


@pytest.mark.parametrize("always", [False, True])
@pytest.mark.parametrize("ahead", [1, 6])
def test_line_is_the_fit_through_five_or_all(ahead, always):
    """One value ahead five will do; farther ahead, or where asked for, all that is remembered counts."""
    x, t_s = 7.0 + 20.0 * SINCE_S + NOISE, SINCE_S[-1] + ahead * STEP_S
    held = WINDOW if always or ahead > 1 else predictors.FIVE
    expected = np.polyval(np.polyfit(SINCE_S[-held:] - t_s, x[-held:], 1), 0.0)
    assert by_line(remembered(x), t_s, always)[0] == pytest.approx(expected, abs=1e-9)


@pytest.mark.parametrize(("always", "expected"), [(False, np.sqrt(2.1)), (True, None)])
def test_growth_of_the_line_is_that_of_its_weights(always, expected):
    """A prediction w · x of white noise: 1 + w · w; by the last five the paper's 1 + 1/5 + 9/10."""
    t_s, small = SINCE_S[-1] + STEP_S, 1e-3  # of a sigma: still a line
    weights = np.array([by_line(remembered(one), t_s, always)[0] for one in small * np.eye(WINDOW)]) / small
    growth = by_line(remembered(np.zeros(WINDOW)), t_s, always)[1]
    assert growth == pytest.approx(expected or np.sqrt(1.0 + weights @ weights))
    assert np.count_nonzero(np.abs(weights) > 1e-9) >= (20 if always else 4)


def test_a_bend_is_no_line():
    """Values that turn are predicted by the last five, which have turned already."""
    x = 40.0 * np.abs(SINCE_S - SINCE_S[15])
    assert by_line(remembered(x), SINCE_S[-1] + 6 * STEP_S, True)[0] == pytest.approx(
        x[-1] + 40.0 * 6 * STEP_S, abs=1e-9
    )


@pytest.mark.parametrize("ahead", [1, 4])
def test_growth_of_the_tracker_is_the_scatter_of_its_prediction(ahead):
    """The variances of an α-β tracker that has run long on white noise."""
    alpha = 0.4
    beta = alpha**2 / (2.0 - alpha)
    drawn = np.random.default_rng(2).normal(0.0, 1.0, (20_000, 60))
    level, rate = np.zeros((2, len(drawn)))
    for value in drawn.T:
        level = level + STEP_S * rate
        off = value - level
        level, rate = level + alpha * off, rate + beta * off / STEP_S
    predicted = np.sqrt(1.0 + (level + ahead * STEP_S * rate).var())
    state = remembered(np.zeros(WINDOW))
    state.track[:2] = 3.0, 2.0
    found = by_tracker(state, SINCE_S[-1] + ahead * STEP_S, alpha)
    assert found == (pytest.approx(3.0 + 2.0 * ahead * STEP_S), pytest.approx(predicted, rel=0.01))


def test_the_oldest_value_goes():
    state = remembered(np.arange(30.0))
    push(state, 9.0, 99.0)
    assert (state.x[0], state.x[-2], state.x[-1], state.t[-1]) == (1.0, 29.0, 99.0, 9.0)
    assert state.count[predictors.HELD] == WINDOW + 1


def test_spacing_is_of_the_last_five():
    t_s = np.r_[np.zeros(26), 1.0, 1.5, 2.0, 4.0]
    state = remembered(np.zeros(WINDOW), t_s)
    assert predictors.spacing(state) == pytest.approx((0.5, 2.0, 0.75))
    assert predictors.interval(state) == pytest.approx(0.75)  # the median of 0.5, 0.5, 1 and 2
