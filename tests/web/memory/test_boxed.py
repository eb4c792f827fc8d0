"""What is in a box: whose, how many of how many, and how far off, in numbers one can check."""

import numpy as np
import pytest

from tests.web.flight import SCENE
from tests.web.memory.made import verdict
from web.memory.boxed import boxed
from web.memory.claims import HOLD_NS
from web.memory.flight import SeenFlight

S = 1_000_000_000
INSIDE, OUTSIDE = (5.0, 5.0, 5.0), (500.0, 0.0, 0.0)


def near(places: np.ndarray) -> np.ndarray:
    return np.linalg.norm(places, axis=1) < 100.0


@pytest.fixture
def flight() -> SeenFlight:
    """Radar: 2 of 4 azimuths inside are refused, 1 range too; one more outlier outside, one place unknown."""
    flight = SeenFlight(SCENE)
    for k in range(4):
        word = "isolated" if k < 2 else "used"
        told = {"value": 359.0 + 3 * k, "predicted": 1.0, "sigma": 2.0}
        flight.take(verdict(k * S, "radar-west", "azimuth", word, INSIDE, **told), "")
    flight.take(verdict(0, "radar-west", "range", "isolated", INSIDE, value=12.0, predicted=10.0), "")
    flight.take(verdict(5 * S, "radar-west", "azimuth", "isolated", OUTSIDE), "")
    flight.take(verdict(6 * S, "radar-west", "azimuth", "isolated", None), "")
    flight.take(verdict(7 * S, "theo-north", "range", "used", INSIDE), "")
    return flight


@pytest.mark.parametrize("settled", [False, True])
def test_count_share_and_means_by_channel(flight, settled):
    if settled:
        flight.take(verdict(8 * S + HOLD_NS, "ins", "e", "used", OUTSIDE), "")
    flight.settle()
    found = boxed(flight, near)
    assert (len(found.outliers), found.measured) == (2, 5)
    azimuth, range_ = found.channels
    assert azimuth == ("radar-west", "azimuth", 2, 0.5, pytest.approx(-0.25), pytest.approx(-0.5))  # −2°, +1°
    assert range_ == ("radar-west", "range", 1, 0.25, pytest.approx(2.0), pytest.approx(2.0))


def test_where_nothing_is_refused_nothing_is_told(flight):
    found = boxed(flight, lambda places: np.zeros(len(places), bool))
    assert found == ([], 0, [])
    assert boxed(SeenFlight(SCENE), near) == ([], 0, [])


def test_what_has_no_prediction_is_counted_without_a_mean():
    flight = SeenFlight(SCENE)
    flight.take(verdict(0, "radar-west", "range", "invalid", INSIDE, predicted=None), "")
    only = boxed(flight, near).channels[0]
    assert only.values == 1
    assert np.isnan(only.sigmas)
