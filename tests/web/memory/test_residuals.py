"""Residuals in sigmas, and who said what at an instant."""

import math

import numpy as np
import pytest

from tests.web.memory.made import claim, verdict
from web.memory.residuals import Residuals, others_then, sigmas_off

S = 1_000_000_000


@pytest.mark.parametrize(
    ("channel", "value", "predicted", "sigmas"),
    [("range", 103.0, 100.0, 6.0), ("azimuth", 359.0, 1.0, -4.0), ("range", None, 1.0, math.nan)],
)
def test_how_far_a_value_is_off(channel, value, predicted, sigmas):
    off = sigmas_off(verdict(channel=channel, value=value, predicted=predicted, sigma=0.5))
    np.testing.assert_equal(off, sigmas)


def test_columns_by_channel_and_raw_height_and_speed():
    residuals = Residuals()
    residuals.add(claim(1 * S, "ins", {"ve": (3.0, 3.0, 1.0), "vn": (4.0, 2.0, 1.0), "vu": (0.0, 0.0, 1.0)}))
    residuals.add(claim(2 * S, "ins", {"e": (9.0, 1.0, 2.0, "patch")}, position=(9.0, 0.0, 77.0)))
    assert residuals.of("ins", "vn", 0, 9 * S)["sigmas"].tolist() == [2.0]
    assert residuals.of("ins", "e", 0, 9 * S)["kind"].tolist() == [2]
    raw = residuals.raw("ins", 0, 9 * S)
    assert raw["speed_mps"][0] == 5.0
    assert np.isnan(raw["speed_mps"][1])
    assert raw["place_m"][:, 2].tolist() == [3.0, 77.0]


def test_the_others_are_heard_at_their_nearest_instant_by_their_worst_channel():
    residuals = Residuals()
    for t_s, off in ((1.0, 0.1), (2.0, 2.5)):
        residuals.add(
            claim(round(t_s * S), "theo", {"azimuth": (off, 0.0, 1.0), "elevation": (0.2, 0.0, 1.0)})
        )
    waiting = [claim(round(2.2 * S), "far", {"range": (50.0, 0.0, 1.0, "isolated")})]
    asked = claim(round(2.1 * S), "radar", {"range": (9.0, 0.0, 1.0, "isolated")})
    far, theo = others_then(residuals, waiting, asked, S)
    assert (theo.sensor, theo.channel, theo.sigmas, theo.kind) == ("theo", "azimuth", 2.5, "accepted")
    assert abs(theo.apart_s - 0.1) < 1e-9
    assert (far.sensor, far.sigmas, far.kind) == ("far", 50.0, "isolated")


def test_whoever_spoke_too_far_away_said_nothing_then():
    residuals = Residuals()
    residuals.add(claim(0, "theo", {"azimuth": (0.0, 0.0, 1.0)}))
    assert others_then(residuals, [], claim(9 * S, "radar", {"range": (9.0, 0.0, 1.0)}), S) == []
