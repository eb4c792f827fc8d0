"""The course of one clock against one path: decisions of its own, each beside a clock that is known."""

import numpy as np

from gcs.station.sources.courses import FINE_NS, Path, S, Sightings, course, cut, misses_m

SIGMA = np.array([1.0, 1.0, 1.0])


def at(t_s):
    """(n, 3) a course of 25 m/s with turns; it never comes to the same place twice."""
    return np.column_stack([20.0 * t_s, 200.0 * np.sin(t_s / 12.0), 100.0 + 0.0 * t_s])


def path(begin_s=0.0, end_s=60.0):
    t_s = np.arange(begin_s, end_s, 0.1)
    return Path(np.rint(t_s * S).astype(np.int64), at(t_s))


def seen(ahead_s, end_s=60.0, bad=()):
    """What says where it is ten times a second; in the seconds ``bad`` it is elsewhere."""
    t_s = np.arange(0.0, end_s, 0.1)
    values = at(t_s) + np.random.default_rng(1).normal(size=(len(t_s), 3))
    values[np.isin(t_s.astype(int), bad)] += 80.0
    stamps = np.rint((t_s + ahead_s(t_s)) * S).astype(np.int64)
    return Sightings(stamps, values, SIGMA, polar=False), t_s


def found_s(of_path, sightings):
    """(m,) the offset of each row."""
    pieces = cut(sightings.t_ns)
    return course(of_path, sightings, pieces)[pieces.of_row] / S


def test_a_clock_that_is_right_is_so_whatever_its_outliers():
    sightings, _ = seen(lambda t: 0.0 * t, bad=(7, 20, 21, 44))
    assert (np.abs(found_s(path(), sightings)) < 0.06).all()


def test_a_jump_and_its_end_are_found_to_the_piece():
    sightings, t_s = seen(lambda t: np.where((t >= 20) & (t < 31), -7.0, 0.0), bad=(25,))
    ahead = np.where((t_s >= 20) & (t_s < 31), -7.0, 0.0)
    sure = (np.abs(t_s - 20.0) > 0.5) & (np.abs(t_s - 31.0) > 0.5)
    assert (np.abs(found_s(path(), sightings) - ahead)[sure] < 0.06).all()


def test_beyond_the_ends_of_the_path_a_clock_is_what_it_was():
    """Ten seconds of stamps are before the path's first: there an offset of zero contradicts nothing."""
    sightings, _ = seen(lambda t: np.full_like(t, -10.0))
    assert (np.abs(found_s(path(), sightings) + 10.0) < 0.06).all()
    early, _ = seen(lambda t: 0.0 * t)
    assert (np.abs(found_s(path(20.0, 50.0), early)) < 0.06).all()


def test_a_drift_is_followed_step_by_step():
    sightings, t_s = seen(lambda t: 0.02 * t)
    assert (np.abs(found_s(path(), sightings) - 0.02 * t_s) < 2.5 * FINE_NS / S).all()


def test_less_than_five_pieces_elsewhere_are_no_jump():
    """A run of outliers that happens to lie on the path of another time."""
    sightings, t_s = seen(lambda t: 0.0 * t)
    short = (t_s >= 30.0) & (t_s < 31.0)
    values = sightings.values.copy()
    values[short] = at(t_s[short] + 12.0)
    assert (np.abs(found_s(path(), sightings._replace(values=values))) < 0.06).all()


def test_who_stands_still_has_no_offset():
    sightings, _ = seen(lambda t: np.full_like(t, 5.0))
    still = sightings._replace(values=np.tile([10.0, 20.0, 30.0], (len(sightings.t_ns), 1)))
    there = path()._replace(p=np.tile([10.0, 20.0, 30.0], (600, 1)))
    assert (found_s(there, still) == 0.0).all()


def test_pieces_are_cut_in_the_order_of_the_file():
    pieces = cut(np.array([0, 1, S, S + 1, 0, 1]))
    assert pieces.of_row.tolist() == [0, 0, 1, 1, 2, 2]
    assert pieces.t_ns.tolist() == [0, S, 0]
    values = np.array([[1.0], [3.0], [np.nan], [5.0], [np.nan], [np.nan]])
    np.testing.assert_array_equal(pieces.medians(values)[:, 0], [1.0, 5.0, np.nan])


def test_an_instrument_sees_the_path_at_its_own_time_without_a_miss():
    t_s = np.arange(0.0, 20.0, 0.05)
    e, n, u = (at(t_s) - [0.0, -500.0, 20.0]).T
    level = np.hypot(e, n)
    values = np.column_stack([np.hypot(level, u), np.arctan2(e, n), np.arctan2(u, level)])
    place = np.array([0.0, -500.0, 20.0])
    theodolite = Sightings(np.rint(t_s * S).astype(np.int64), values, SIGMA, place, np.eye(3))
    pieces = cut(theodolite.t_ns)
    assert np.nanmax(np.abs(misses_m(path(), theodolite, pieces))) < 0.01
    own = theodolite.path()
    np.testing.assert_allclose(own.p[20:-20], at(t_s)[20:-20], atol=0.2)  # a second of a turn, smoothed
