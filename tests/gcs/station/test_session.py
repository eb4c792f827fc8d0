"""What a session tells: states that say something, and of the rest how many there were."""

import numpy as np
import pytest

from filters.models.rows import TRACK
from gcs.station.session import GUESS_M, says_something


def state(**changes) -> np.ndarray:
    row = np.zeros(1, TRACK)
    row["P"][0] = np.eye(9)
    for field, (at, value) in changes.items():
        row[field][0][at] = value
    return row


def test_a_state_says_something():
    assert says_something(state()).tolist() == [True]
    assert says_something(state(x=(0, 90_000.0))).tolist() == [True]
    assert says_something(np.zeros(0, TRACK)).tolist() == []


@pytest.mark.parametrize(
    "changes",
    [
        {"x": (2, np.nan)},
        {"x": (7, np.inf)},
        {"x": (0, 5e6)},
        {"x": (4, -9e3)},
        {"P": ((1, 2), np.nan)},
        {"P": ((8, 8), np.inf)},
        {"P": ((4, 4), -1e-9)},
        {"P": ((1, 1), (1.1 * GUESS_M) ** 2)},
    ],
)
def test_what_is_no_state_is_none(changes):
    both = np.concatenate([state(), state(**changes)])
    assert says_something(both).tolist() == [True, False]
