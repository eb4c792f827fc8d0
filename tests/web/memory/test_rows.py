"""Rows grow, are found by time, and stay bounded."""

import numpy as np

from web.memory.rows import GrowingRows

DTYPE = np.dtype([("t_ns", "i8"), ("value", "f8")])


def filled(n: int, most: int) -> GrowingRows:
    rows = GrowingRows(DTYPE, most)
    for i in range(n):
        rows.add((i, i / 2))
    return rows


def test_all_rows_are_kept_below_the_bound():
    rows = filled(3000, 5000)
    np.testing.assert_array_equal(rows.view["t_ns"], np.arange(3000))
    np.testing.assert_array_equal(rows.view["value"], np.arange(3000) / 2)


def test_between_has_both_ends():
    np.testing.assert_array_equal(filled(50, 100).between(10, 12)["t_ns"], [10, 11, 12])
    assert len(filled(50, 100).between(60, 70)) == 0


def test_beyond_the_bound_the_old_are_thinned_and_the_first_and_newest_stay():
    times = filled(1000, 100).view["t_ns"]
    assert len(times) <= 100
    assert (times[0], times[-1]) == (0, 999)
    assert (np.diff(times) > 0).all()
    assert np.diff(times)[-40:].max() == 1


def test_the_past_of_a_long_flight_is_thinned_evenly():
    times = filled(20_000, 1_000).view["t_ns"]
    kept, _ = np.histogram(times, bins=10, range=(0, 18_000))
    assert kept.min() >= 10
    assert kept.max() <= 2 * kept.min()


def test_memory_is_taken_once_and_never_again():
    rows = GrowingRows(DTYPE, 3_000)
    where = rows.view.__array_interface__["data"]
    for i in range(10_000):
        rows.add((i, 0.0))
    assert rows.view.__array_interface__["data"] == where


def test_cleared_rows_are_gone():
    rows = filled(10, 100)
    rows.clear()
    assert len(rows.view) == 0


def test_what_is_thinned_goes_on_being_counted():
    rows = GrowingRows(np.dtype([("t_ns", "i8"), ("stands_for", "i4")]), 16)
    for k in range(1_000):
        rows.add((k, 1))
    assert rows.view["stands_for"].sum() == 1_000
