"""Runs of outliers: their level, what they cost, what is none, and that a channel recovers."""

import numpy as np
import pytest

from filters.models import runs
from filters.models.rows import RANGE
from filters.smoother import status
from filters.smoother.buffer import Rows
from tests.filters.smoother.kit import small
from tests.filters.smoother.test_status import open_

pytestmark = pytest.mark.decision


STEP_NS = 50_000_000


def followed(residuals, s=1.0, noise=1.0):
    """(memory (MEMORY,), P(good), log likelihood of each) of one channel, row by row."""
    memory = status.fresh_memory(1)[0, 0]
    out = [status.filtered(memory, r, s, noise, k * STEP_NS) for k, r in enumerate(residuals)]
    return memory, *np.array(out).T


def test_the_level_of_a_run_is_the_mean_of_its_rows():
    memory, good, _ = followed([0.1, 8.0, 9.0, 8.5, 8.5])
    assert max(good[1:]) < 0.01
    assert memory[runs.LEVEL] == pytest.approx(8.5, abs=0.2)
    assert memory[runs.LINE] == pytest.approx(8.5, abs=0.3)
    assert memory[runs.VARIANCE] < 0.7  # of its own noise, and what the level may have moved


def test_a_further_row_of_a_run_costs_little_and_one_elsewhere_much():
    on, off = (followed([0.1, 9.0, 9.3, 9.1, r])[2][-1] for r in (9.0, -9.0))
    assert status.log_good(0.0, 1.0) - on < 1.5
    assert status.log_good(0.0, 1.0) - off > 4.0


@pytest.mark.parametrize("rate", [0.0, 9.0])
@pytest.mark.parametrize("size", [30.0, 1e4])
def test_a_smooth_run_costs_the_same_however_large_it_is_in_sigmas(size, rate):
    """Of a mirror image the sharper instrument must not be the one that is believed."""
    noise = np.random.default_rng(3).normal(size=40)
    _, good, likelihood = followed([0.0, *(size + rate * np.arange(40) + noise)])
    assert max(good[2:]) < 0.01
    assert (status.log_good(0.0, 1.0) - likelihood[15:]).mean() < 2.0


def test_a_loose_run_and_a_smooth_one_are_told_apart():
    rng, k = np.random.default_rng(4), np.arange(25)
    loose, smooth = 60.0 * rng.uniform(0.8, 1.2, 25), 60.0 + 0.5 * k + rng.normal(size=25)
    assert followed(loose)[0][runs.SMOOTH] < 0.2
    assert followed(smooth)[0][runs.SMOOTH] > 0.8


def test_the_line_of_a_smooth_run_is_that_of_a_textbook_filter():
    """Level and rate of a run that has begun for certain: Kalman with white acceleration, in matrices."""
    rng, noise, fresh, dt = np.random.default_rng(5), 0.7, 0.3, 0.1
    m = np.zeros(runs.MEMORY)
    runs.follow(m, 20.0, noise, fresh, 1.0, 0.5, dt)
    x, P = np.array([20.0, 0.0]), np.diag([noise, 400.0])
    F, q = np.array([[1.0, dt], [0.0, 1.0]]), runs.BEND**2 * noise
    Q = q * np.array([[dt**3 / 3, dt**2 / 2], [dt**2 / 2, dt]]) + np.diag([fresh, 0.0])
    for r in 20.0 + np.arange(1, 8) + rng.normal(size=7):
        runs.follow(m, r, noise, fresh, 0.0, 0.5, dt)
        x, P = F @ x, F @ P @ F.T + Q
        gain = P[:, 0] / (P[0, 0] + noise)
        x, P = x + gain * (r - x[0]), P - np.outer(gain, P[0])
        assert m[[runs.LINE, runs.RATE]] == pytest.approx(x)
        assert m[[runs.SHARP, runs.BOTH, runs.STEEP]] == pytest.approx(P[[0, 0, 1], [0, 1, 1]])


def test_what_moves_the_prediction_moves_the_level_the_other_way():
    m = followed([0.0, 30.0, 30.0])[0]
    before = m.copy()
    runs.move(m, 2.0)
    assert before - m == pytest.approx(np.isin(np.arange(runs.MEMORY), (runs.LEVEL, runs.LINE)) * 2.0)


def test_a_run_of_a_vague_prediction_goes_on_at_its_level():
    """Rows of a channel that is not used share the prediction's error: 2 s off, and yet not good."""
    _, good, _ = followed([0.1, 12.0, 12.1, 11.9, 12.0, 12.1, 11.8], s=6.0, noise=1.0)
    assert good[-1] < 0.2


def test_rows_that_fit_are_no_run():
    """What is correlated, as an INS's errors are, has no level beyond its own noise."""
    _, good, _ = followed([2.5, *[1.0] * 10, *[-1.0] * 10])
    assert min(good[-15:]) > status.SURE


@pytest.mark.parametrize(
    "share",
    [
        1.0,
        0.3,
        0.03,
    ],
)
def test_a_channel_recovers_from_one_outlier(share):
    """One gross error, then hundreds of good rows, window by window; ``share`` is R / s²."""
    rng, window, cut, count = np.random.default_rng(0), 20, 5, 300
    rows = Rows(
        np.arange(count) * STEP_NS,
        np.zeros(count, "i2"),
        np.zeros(count, "i1"),
        *(np.zeros(count),) * 2,
        np.zeros((count, 3)),
    )
    own = small.fresh(rows)
    own.sigma[:], own.noise[:] = 1.0, share
    own.residual[:] = 0.5 * rng.normal(size=count)
    own.residual[30] = 30.0
    memory, seen = status.fresh_memory(1), []
    for k in range(0, count - window, cut):
        part, mine = Rows(*(c[k : k + window] for c in rows)), type(own)(*(c[k : k + window] for c in own))
        status.posterior(part, mine, memory.copy(), open_(part))
        status.advance(Rows(*(c[:cut] for c in part)), type(own)(*(c[:cut] for c in mine)), memory)
        seen += mine.weight[:cut].tolist()
    assert seen[30] < 0.01
    assert min(seen[-100:]) > status.SURE
    assert memory[0, RANGE, runs.CHANCE] < 0.02
