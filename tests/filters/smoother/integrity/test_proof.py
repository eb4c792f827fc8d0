"""Who confirms a state, and spans of time."""

import numpy as np
import pytest

from filters.models.rows import RANGE, U
from filters.smoother.integrity import proof
from tests.filters.smoother.kit import small

pytestmark = pytest.mark.decision

INS, A, _, _ = small.four()


def test_who_confirms_where_the_target_is_has_more_than_half_of_its_rows_used():
    rows = small.fly([INS, A], 1.0)
    sensor, channel = rows["sensor"], rows["channel"]
    assert proof.witnesses(sensor, channel, channel >= 0) == (2, 2)
    one_of_three = (sensor == 0) | (channel == RANGE)
    assert proof.witnesses(sensor, channel, one_of_three) == (1, 2)
    velocities = (sensor == 1) | (channel > U)  # they tell of no place
    assert proof.witnesses(sensor, channel, velocities) == (1, 2)
    assert proof.witnesses(sensor[:0], channel[:0], velocities[:0]) == (0, 0)


def test_spans_that_meet_are_one():
    spans = proof.with_span((), 0, 10)
    assert proof.with_span(spans, 10, 20) == ((0, 20),)
    assert proof.with_span(spans, 5, 8) == ((0, 10),)
    assert proof.with_span(spans, 11, 20) == ((0, 10), (11, 20))


def test_a_span_ends_before_its_end():
    assert proof.within(((0, 10), (20, 30)), np.array([-1, 0, 9, 10, 20, 30])).tolist() == [
        False, True, True, False, True, False,
    ]  # fmt: skip
