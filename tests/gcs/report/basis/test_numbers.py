"""The report's statistics against numbers one can see."""

import numpy as np
import pytest

from gcs.report.basis import numbers

S = 1_000_000_000


def test_no_peak_is_lost_by_thinning():
    rng = np.random.default_rng(1)
    y = rng.normal(size=20_000)
    y[[37, 9_999, 19_998]] = 50.0, -60.0, 70.0
    y[5_000:5_010] = np.nan
    at = numbers.thin(500, y)
    assert len(at) < 600
    assert set(at) >= {0, 37, 9_999, 19_998, 19_999}
    assert np.isnan(y[at]).any()  # the line breaks where it broke
    assert (np.diff(at) > 0).all()
    assert numbers.thin(500, y[:400]).tolist() == list(range(400))


def test_thinning_keeps_the_extremes_of_each_column():
    x, y = np.zeros(1000), np.zeros(1000)
    x[123], y[456] = -1.0, 1.0
    assert {123, 456} <= set(numbers.thin(50, x, y).tolist())


def test_a_sample_keeps_the_middle_of_a_cloud():
    y = np.random.default_rng(2).normal(size=30_000)
    y[777] = 30.0
    at = numbers.sample(600, y)
    assert 777 in at
    assert 300 < len(at) <= 620
    assert np.mean(np.abs(y[at]) < 1.0) > 0.4  # the extremes of each stretch alone have next to none


@pytest.mark.parametrize(
    ("velocity", "expected"),
    [((0, 10), (2, 1)), ((10, 0), (1, -2)), ((0, -10), (-2, -1)), ((-10, 0), (-1, 2))],
)
def test_along_is_ahead_and_across_is_to_the_right(velocity, expected):
    """A difference of 1 m east and 2 m north."""
    found = numbers.along_across_up(np.array([[1.0, 2.0, 3.0]]), np.array([[*velocity, 0.0]], float))
    assert found[0].tolist() == pytest.approx([*expected, 3.0])


def test_who_stands_has_no_course():
    found = numbers.along_across_up(np.ones((1, 3)), np.array([[0.3, 0.3, 0.0]]))
    assert np.isnan(found[0, :2]).all()
    assert found[0, 2] == 1.0


def test_between_known_times_but_not_across_a_pause():
    known = np.array([0, 1, 2, 10]) * S
    x = numbers.at_times(
        np.array([-1, 0.5, 2, 5, 11]) * S, known, np.array([[0.0], [2.0], [4.0], [9.0]]), 2.0
    )
    assert x[:, 0].tolist() == pytest.approx([np.nan, 1.0, 4.0, np.nan, np.nan], nan_ok=True)


def test_gaps_are_pauses_beyond_the_usual():
    t = np.array([0.0, 0.1, 0.2, 0.3, 1.3, 1.4, 1.8]) * S
    assert [(gap.begin_ns / S, gap.seconds) for gap in numbers.gaps(t.astype(np.int64))] == [(0.3, 1.0)]
    assert numbers.gaps(np.array([5])) == []


def test_a_slow_log_is_no_row_of_pauses():
    """0.36 s usual, 1.4 s now and then, as in a log of 2013."""
    t = np.cumsum([0.36, 0.36, 0.36, 1.4, 0.36, 0.36, 6.6]) * S
    assert numbers.longest_s(t.astype(np.int64)) == pytest.approx(1.8)
    assert numbers.longest_s(np.array([5])) == numbers.LONGEST_STEP_S


def test_a_share_is_one_of_time():
    t = np.array([0.0, 0.1, 0.2, 1.2, 60.0]) * S
    holds = np.array([False, False, True, False, False])
    assert numbers.time_share(t, holds) == pytest.approx(1.0 / 2.2)  # a pause counts for a second at most


def test_the_longest_run():
    t = np.arange(8) * S
    holds = np.array([1, 0, 1, 1, 1, 0, 1, 1], bool)
    assert numbers.longest_run(t, holds) == (3, 2 * S, 4 * S)
    assert numbers.longest_run(t, np.zeros(8, bool)) is None


def test_whiteness_tells_memory_from_none():
    rng = np.random.default_rng(3)
    white = rng.normal(size=5_000)
    slow = np.convolve(white, np.ones(4) / 4)
    assert abs(numbers.whiteness(white).lag1) < 2 * numbers.whiteness(white).band
    assert numbers.whiteness(slow).lag1 == pytest.approx(0.75, abs=0.03)
    assert numbers.whiteness(white[:5]) is None
