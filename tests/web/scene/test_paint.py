"""What the track's colour says."""

import numpy as np

from tests.web.memory.test_flight import flown
from web.look import colours
from web.scene import paint
from web.scene.paint import PLAIN, UNITS, Scale, scale_of, values


def test_the_values_are_those_of_the_states():
    rows = flown(5.0).newest.view
    told = values(rows)
    np.testing.assert_allclose(told[:, 0], np.linalg.norm(rows["velocity_enu_mps"], axis=1))
    np.testing.assert_allclose(told[:, 2], np.sqrt(0.5 + 0.9 + 1.6))
    assert told.shape == (len(rows), len(UNITS))


def test_a_scale_stays_while_it_fits_and_moves_when_the_flight_leaves_it():
    rows = flown(20.0).newest.view
    whole = scale_of("height", rows)
    assert whole.low < np.median(rows["position_enu_m"][:, 2]) < whole.high
    assert scale_of("height", rows[:-2], whole) is whole
    assert scale_of("height", rows[:5], whole) != whole
    assert scale_of(PLAIN, rows) is None
    assert scale_of("height", rows[:0]) is None


def test_ends_take_the_ends_of_the_ramp_and_the_unknown_is_grey():
    told = np.zeros((4, 2, len(UNITS)))
    told[:, :, 0] = np.array([0.0, 10.0, 99.0, np.nan])[:, None]
    painted = paint.paint("speed", Scale(0.0, 10.0), told)
    np.testing.assert_array_equal(painted[0, 0], colours.RAMP[0])
    np.testing.assert_array_equal(painted[1, 1], colours.RAMP[-1])
    np.testing.assert_array_equal(painted[2, 0], colours.RAMP[-1])
    np.testing.assert_array_equal(painted[3, 0], colours.GROUND)
    plain = paint.paint(PLAIN, None, told)
    assert plain.shape == (4, 2, 3)
    assert (plain == colours.FILTERED).all()
