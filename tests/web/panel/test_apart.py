"""The distance to the other course in words."""

import msgspec
import numpy as np

from tests.web.memory.test_other import STATE, S, course
from web.panel import apart

OTHER = course([S // 2, S, 2 * S], [(0, 0, 100)] * 3)


def test_without_another_course_nothing_is_said():
    assert apart.block(None, STATE, old=False) == ""


def test_the_sides_are_named():
    here = msgspec.structs.replace(
        STATE, t_ns=S, position_enu_m=(3.0, 4.0, 88.0), velocity_enu_mps=(30.0, 0.0, 0.0)
    )
    said = apart.block(OTHER, here, old=False)
    for text in ("truth.csv", "3.00 m ahead", "4.00 m to the left", "12.00 m below", "13.00 m"):
        assert text in said
    assert 'class="old"' in apart.block(OTHER, here, old=True)


def test_where_it_does_not_say_that_is_said():
    late = msgspec.structs.replace(STATE, t_ns=S * 1_000)
    for state in (late, None):
        assert "does not say" in apart.block(OTHER, state, old=False)
    assert np.isfinite(OTHER.places_m).all()
