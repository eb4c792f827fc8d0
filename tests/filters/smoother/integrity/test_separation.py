"""How far the newest state would move without each sensor, as the estimator tells it."""

import numpy as np
import pytest

from filters import methods
from filters.models.rows import AZIMUTH
from filters.smoother.estimator import LOOK_NS
from tests.filters.smoother.kit import small
from tests.filters.smoother.kit.flights import SENSORS, same


def told(rows, parts=1, sensors=SENSORS, method="default"):
    """(track, separation) of ``rows`` in so many parts, cut between two epochs."""
    estimator = methods.make(method, sensors)
    ends = np.flatnonzero(np.diff(rows["t_ns"]))[:: max(1, len(rows) // parts)] + 1
    steps = [estimator.step(part) for part in np.split(rows, ends)] + [estimator.finish()]
    return (np.concatenate([step[k] for step in steps]) for k in (0, 3))


@pytest.fixture(scope="module")
def rows():
    return small.fly(SENSORS, 6.0)


@pytest.fixture(scope="module")
def flown(rows):
    return tuple(told(rows))


def test_each_sensor_is_told_of_once_a_look(flown):
    track, found = flown
    assert np.isin(found["t_ns"], track["t_ns"]).all()
    for sensor in range(len(SENSORS)):
        cells = found["t_ns"][found["sensor"] == sensor] // LOOK_NS
        assert (np.diff(cells) == 1).all()
        assert len(cells) > 12


def test_pieces_do_not_matter(rows, flown):
    assert same(flown[1], tuple(told(rows, parts=40))[1])


def test_honest_sensors_are_near_and_inside_the_protection_level(flown):
    track, found = flown
    at = np.searchsorted(track["t_ns"], found["t_ns"])
    assert (found["horizontal_m"] < 4.0 * found["sigma_h_m"]).all()
    assert (found["vertical_m"] < 4.0 * found["sigma_v_m"]).all()
    assert (found["horizontal_m"] <= track["protection_h_m"][at]).all()
    assert (found["vertical_m"] <= track["protection_v_m"][at]).all()


def test_what_comes_late_tells_no_cell_again(rows):
    late = np.concatenate([np.flatnonzero(rows["sensor"] != 2), np.flatnonzero(rows["sensor"] == 2)])
    arrival_ns = rows["t_ns"] + np.where(rows["sensor"] == 2, 400_000_000, 0)
    late = late[np.argsort(arrival_ns[late], kind="stable")]
    estimator = methods.make("default", SENSORS)
    found = np.concatenate([estimator.step(part).separation for part in np.array_split(rows[late], 60)])
    for sensor in range(len(SENSORS)):
        assert (np.diff(found["t_ns"][found["sensor"] == sensor] // LOOK_NS) > 0).all()


@pytest.mark.parametrize("seed", range(3))
def test_with_a_liar_among_three_each_state_without_one_is_right(seed):
    """Three theodolites of equal worth; the last one's azimuths are off by eight sigma, 10 m.

    Without one of the others its range and elevation are good; which of two azimuths is, the ranges tell.
    """
    places = ((0.0, -300.0, 0.0), (900.0, 900.0, 0.0), (-400.0, 1200.0, 0.0))
    sensors = [small.theodolite(f"t{k}", at, r=2.0, az=2e-3, el=2e-3) for k, at in enumerate(places)]
    rows = small.fly(sensors, 6.0, hz=20.0, seed=seed)
    rows["value"][(rows["sensor"] == 2) & (rows["channel"] == AZIMUTH)] += 16e-3
    _, found = told(rows, sensors=sensors)
    metres = [np.median(found["horizontal_m"][found["sensor"] == k]) for k in range(3)]
    assert metres[2] < 0.5
    assert max(metres) < 1.5


def test_clocks_that_float_move_nothing():
    """All three clocks are estimated, and one is 90 ms late: the same 3 m of flight for each state."""
    places = ((0.0, -300.0, 0.0), (900.0, 900.0, 0.0), (-400.0, 1200.0, 0.0))
    sensors = [small.theodolite(f"t{k}", at, estimate=("clock",)) for k, at in enumerate(places)]
    rows = small.fly(sensors, 6.0, hz=20.0)
    rows["t_ns"][rows["sensor"] == 2] += 90_000_000
    _, found = told(rows[np.argsort(rows["t_ns"], kind="stable")], sensors=sensors)
    later = found["horizontal_m"][found["t_ns"] > 4e9]
    assert later.max() < 0.5


def test_a_sensor_that_was_never_heard_has_none(rows):
    _, found = told(rows[rows["sensor"] != 3])
    assert set(found["sensor"].tolist()) == {0, 1, 2}


def test_where_there_is_no_state_without_a_sensor_there_is_none():
    sensors = [small.theodolite(), small.theodolite("angles", (500.0, 0.0, 0.0), az=1e-4, el=1e-4)]
    _, found = told(small.fly(sensors, 4.0), sensors=sensors)
    assert set(found["sensor"].tolist()) == {1}  # without the one that has a range there is no state


def test_other_methods_tell_none(rows):
    for method in ("igg", "wolf"):
        assert not len(tuple(told(rows[:400], method=method))[1])
