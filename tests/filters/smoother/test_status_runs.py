"""Runs of outliers: their level, what they cost, what is none, and that a channel recovers."""

import numpy as np
import pytest

from filters.models.rows import RANGE
from filters.smoother import status
from filters.smoother.buffer import Rows
from tests.filters.smoother.kit import small
from tests.filters.smoother.test_status import open_

pytestmark = pytest.mark.decision


def followed(residuals, s=1.0, noise=1.0):
    """(memory (6,), P(good) of each) of one channel, row by row."""
    memory = status.fresh_memory(1)[0, 0]
    return memory, [status.filtered(memory, r, s, noise)[0] for r in residuals]


def test_the_level_of_a_run_is_the_mean_of_its_rows():
    memory, good = followed([0.1, 8.0, 9.0, 8.5, 8.5])
    assert max(good[1:]) < 0.01
    assert memory[3] == pytest.approx(8.5, abs=0.2)
    assert memory[5] < 0.7  # of its own noise, and what the level may have moved


def test_a_further_row_of_a_run_costs_little_and_one_elsewhere_much():
    on, off = (status.log_run(r, 1.0, 1.0, 9.0, 0.3) for r in (9.0, -9.0))
    assert status.log_good(0.0, 1.0) - on < 1.0
    assert status.log_good(0.0, 1.0) - off > 4.0


def test_a_run_of_a_vague_prediction_goes_on_at_its_level():
    """Rows of a channel that is not used share the prediction's error: 2 s off, and yet not good."""
    _, good = followed([0.1, 12.0, 12.1, 11.9, 12.0, 12.1, 11.8], s=6.0, noise=1.0)
    assert good[-1] < 0.2


def test_rows_that_fit_are_no_run():
    """What is correlated, as an INS's errors are, has no level beyond its own noise."""
    _, good = followed([2.5, *[1.0] * 10, *[-1.0] * 10])
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
        np.arange(count),
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
    assert memory[0, RANGE, 4] < 0.02
