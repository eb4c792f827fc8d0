"""Range, azimuth, elevation by closed form, their derivatives by differences."""

from fractions import Fraction

import numpy as np
import pytest

from filters.models import theodolite
from filters.models.rows import AZIMUTH, ELEVATION, RANGE
from tests.filters.smoother.kit.differences import derivatives

pytestmark = pytest.mark.decision

POINTS = [(300.0, 400.0, 50.0), (-20.0, 1500.0, -3.0), (5.0, -7.0, 200.0), (-4000.0, -1.0, 900.0)]
BEND = theodolite.REFRACTION["optical"] / (2 * theodolite.EARTH_RADIUS_M)


@pytest.mark.parametrize(
    ("p", "azimuth_deg", "elevation_deg"),
    [
        ((0, 10, 0), 0, 0),
        ((10, 0, 0), 90, 0),
        ((0, -10, 0), 180, 0),
        ((-10, 0, 0), -90, 0),
        ((3, 4, 5), 36.8699, 45),
    ],
)
def test_east_is_90_degrees_and_up_is_positive(p, azimuth_deg, elevation_deg):
    p = tuple(map(float, p))
    assert theodolite.observe(RANGE, p, 0.0) == pytest.approx(np.linalg.norm(p))
    assert np.degrees(theodolite.observe(AZIMUTH, p, 0.0)) == pytest.approx(azimuth_deg, abs=1e-4)
    assert np.degrees(theodolite.observe(ELEVATION, p, 0.0)) == pytest.approx(elevation_deg, abs=1e-4)


def test_refraction_lifts_a_target_by_k_d_over_2_r():
    plain, bent = (theodolite.observe(ELEVATION, (0.0, 10e3, 0.0), b) for b in (0.0, BEND))
    assert bent - plain == pytest.approx(0.13 * 10e3 / (2 * 6371e3))
    assert theodolite.observe(AZIMUTH, POINTS[0], BEND) == theodolite.observe(AZIMUTH, POINTS[0], 0.0)


@pytest.mark.parametrize("channel", [RANGE, AZIMUTH, ELEVATION])
@pytest.mark.parametrize("p", POINTS)
def test_gradient_is_the_derivative(channel, p):
    found = derivatives(lambda q: theodolite.observe(channel, tuple(q), BEND), np.array(p), 1e-3)
    assert np.allclose(theodolite.gradient(channel, p, BEND), found, rtol=1e-6, atol=1e-8)


@pytest.mark.parametrize("channel", [RANGE, AZIMUTH, ELEVATION])
@pytest.mark.parametrize("size", [1e-6, 1.0, 100.0, 1e5])
def test_step_is_the_difference(channel, size):
    rng = np.random.default_rng(1)
    for p in POINTS:
        e = tuple(size * rng.normal(size=3))
        moved = tuple(a + b for a, b in zip(p, e, strict=True))
        found = theodolite.step(channel, p, e, BEND)
        plain = theodolite.observe(channel, moved, BEND) - theodolite.observe(channel, p, BEND)
        if channel == AZIMUTH:
            plain = (plain + np.pi) % (2 * np.pi) - np.pi
        assert found == pytest.approx(plain, rel=1e-9, abs=1e-11 if channel != RANGE else 1e-9)


def test_step_keeps_all_digits_of_a_tiny_move():
    """|p + e|² − |p|² in whole numbers, where the plain difference has four digits left."""
    p, e = (3e4, 4e4, 1e3), (2.0**-30, -(2.0**-29), 2.0**-28)
    gain = sum((Fraction(a) + Fraction(b)) ** 2 - Fraction(a) ** 2 for a, b in zip(p, e, strict=True))
    assert theodolite.step(RANGE, p, e, 0.0) == pytest.approx(
        float(gain) / (2 * np.linalg.norm(p)), rel=1e-12
    )


def test_step_across_the_south_goes_the_short_way():
    p, e = (1.0, -1000.0, 0.0), (-2.0, 0.0, 0.0)
    assert theodolite.step(AZIMUTH, p, e, 0.0) == pytest.approx(2e-3, rel=1e-5)
