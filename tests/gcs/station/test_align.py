"""Alignment: order, repeats, and how long a row waits."""

import numpy as np

from filters.models.rows import ROW
from gcs.station.align import Align

MS = 1_000_000


def rows(*items):
    """ROWs from (id, t in ms, sensor, channel)."""
    return np.array([(i, t * MS, s, c, 0.0, 0.0) for i, t, s, c in items], dtype=ROW)


def test_releases_in_time_order_and_names_repeats():
    align = Align(hold_s=0.1)
    align.add(rows((0, 30, 1, 0), (1, 10, 1, 0), (2, 20, 2, 0), (3, 10, 1, 0), (4, 10, 1, 1)))
    ready, repeats = align.release(25 * MS)
    assert ready["id"].tolist() == [1, 4, 2]
    assert repeats.tolist() == [3]
    align.add(rows((5, 20, 2, 0), (6, 40, 2, 0)))
    ready, repeats = align.release(100 * MS)
    assert ready["id"].tolist() == [0, 6]
    assert repeats.tolist() == [5]


def test_late_rows_are_handed_on():
    align = Align(hold_s=0.1)
    align.add(rows((0, 100, 1, 0)))
    align.release(100 * MS)
    align.add(rows((1, 50, 2, 0)))
    assert align.release(100 * MS)[0]["id"].tolist() == [1]


def test_waits_for_the_source_that_is_due_and_no_longer_than_hold():
    align = Align(hold_s=0.1)
    for k in range(3):  # two sources at 10 Hz, in step
        align.add(rows((2 * k, 100 * k, 1, 0)), 100 * k * MS)
        align.add(rows((2 * k + 1, 100 * k, 2, 0)), 100 * k * MS)
    assert align.due_ns(200 * MS) >= 200 * MS  # both have passed 200 ms
    align.add(rows((6, 300, 1, 0)), 300 * MS)
    assert align.due_ns(305 * MS) < 300 * MS  # the other one is due before
    align.add(rows((7, 300, 2, 0)), 310 * MS)
    assert align.due_ns(310 * MS) >= 300 * MS
    align.add(rows((8, 400, 1, 0)), 400 * MS)
    assert align.due_ns(499 * MS) < 400 * MS
    assert align.due_ns(500 * MS) >= 400 * MS  # hold_s is over


def test_a_silent_source_is_not_waited_for():
    align = Align(hold_s=10.0)
    for k in range(3):
        align.add(rows((2 * k, 100 * k, 1, 0)), 100 * k * MS)
        align.add(rows((2 * k + 1, 100 * k, 2, 0)), 100 * k * MS)
    for k in range(3, 20):
        align.add(rows((10 + k, 100 * k, 1, 0)), 100 * k * MS)
    assert align.due_ns(1900 * MS) >= 1900 * MS


def both_steady():
    """What has heard two sources ten times each, 50 ms apart."""
    align = Align(hold_s=0.3)
    for k in range(10):
        for sensor in (1, 2):
            align.add(rows((2 * k + sensor, 50 * k, sensor, 0)), 50 * k * MS)
    return align


def test_a_source_that_has_missed_its_turn_is_not_waited_for():
    """As one that was refused for flooding: from then on nobody's rows wait, not each for ``hold_s`` anew."""
    align = both_steady()
    align.add(rows((30, 500, 1, 0)), 500 * MS)
    assert align.due_ns(501 * MS) < 500 * MS
    align.add(rows((31, 801, 1, 0)), 801 * MS)
    assert align.due_ns(802 * MS) >= 801 * MS


def test_nobody_waits_for_a_source_that_is_refused_until_it_is_taken_again():
    align = both_steady()
    align.pass_over(2)
    align.pass_over(3)  # nobody that is known
    align.add(rows((30, 500, 1, 0)), 500 * MS)
    assert align.due_ns(501 * MS) >= 500 * MS
    align.add(rows((31, 500, 2, 0)), 502 * MS)
    align.add(rows((32, 550, 1, 0)), 550 * MS)
    assert align.due_ns(551 * MS) < 550 * MS


def test_a_steady_source_is_waited_for_just_before_it_is_due_and_an_unsteady_one_from_then_on_as_before():
    steady, shaky = Align(hold_s=0.3), Align(hold_s=0.3)
    for k in range(100):
        steady.add(rows((k, 100 * k, 1, 0)), 100 * k * MS)
        shaky.add(rows((k, 100 * k + (10 if k % 2 else -10), 1, 0)), 100 * k * MS)
    assert 9_999 * MS < steady.due_ns(9_950 * MS) < 10_000 * MS
    assert shaky.due_ns(9_950 * MS) == 9_910 * MS + int(0.9 * shaky._beats[1].interval_ns)
