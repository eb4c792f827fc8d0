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
