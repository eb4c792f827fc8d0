"""The first fix: on the target, with an honest sigma, and none where there is none."""

import numpy as np
import pytest

from filters.models import model
from filters.models.rows import AZIMUTH, ELEVATION, RANGE
from filters.window import start
from tests.filters.full_ukf import value
from tests.filters.scenes import sensors

pytestmark = pytest.mark.decision

TARGET = np.array([150.0, 220.0, 130.0, 0, 0, 0, 0, 0, 0])


def said(used, wanted):
    return zip(*[(s, c, value(used[s], c, TARGET)) for s, c in wanted], strict=True)


@pytest.mark.parametrize(
    "wanted",
    [
        [(0, RANGE), (0, AZIMUTH), (0, ELEVATION)],
        [(0, AZIMUTH), (0, ELEVATION), (1, AZIMUTH), (1, ELEVATION)],
    ],
    ids=["polar", "two bearings"],
)
def test_a_fix_is_on_the_target(wanted):
    used = sensors(["theo-a", "theo-b"])
    (position, sigma), *_ = start.fixes(model.build(used, 1.0, 1.0, 1.0), *said(used, wanted))
    assert np.allclose(position, TARGET[:3], atol=1e-6)
    assert 0.0 < sigma < 5.0


def test_one_bearing_is_no_fix():
    used = sensors(["theo-a", "theo-b"])
    assert start.fixes(model.build(used, 1.0, 1.0, 1.0), *said(used, [(0, AZIMUTH), (0, ELEVATION)])) == []
