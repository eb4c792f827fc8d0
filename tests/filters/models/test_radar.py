"""The range rate is the derivative of the range along the path."""

import numpy as np
import pytest

from filters.models import radar
from tests.filters.smoother.kit.differences import derivatives

pytestmark = pytest.mark.decision


@pytest.mark.parametrize("p", [(100.0, -30.0, 5.0), (-4e3, 1.0, 900.0), (0.0, 0.0, 7.0)])
def test_range_rate_is_the_derivative_of_the_range(p):
    v = np.array([12.0, -7.0, 30.0])
    found = derivatives(lambda t: np.linalg.norm(np.array(p) + t * v), np.zeros(1), 1e-5)[0]
    assert radar.range_rate(p, tuple(v)) == pytest.approx(found, rel=1e-6)


def test_going_away_is_positive_and_around_is_zero():
    assert radar.range_rate((0.0, 10.0, 0.0), (0.0, 3.0, 0.0)) == pytest.approx(3.0)
    assert radar.range_rate((0.0, 10.0, 0.0), (5.0, 0.0, -2.0)) == 0.0
