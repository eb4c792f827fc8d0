"""What autopilots mean, and what some of them get wrong."""

import warnings

import numpy as np
import pytest

from bridges.mavlink import autopilot


def test_a_climb_rate_of_the_wrong_sign_is_noticed():
    t_s = np.arange(0.0, 60.0, 0.4)
    height, climb = 300.0 + 40.0 * np.sin(t_s / 8.0), 5.0 * np.cos(t_s / 8.0)
    t_ns = np.round(t_s * 1e9).astype(np.int64)
    assert not autopilot.vz_is_upward(t_ns, height, climb)
    assert autopilot.vz_is_upward(t_ns, height, -climb)


def test_a_hovering_vehicle_says_nothing_about_the_sign():
    rng = np.random.default_rng(1)
    t_ns = np.arange(200) * 400_000_000
    height, climb = 300.0 + rng.normal(0.0, 0.1, 200), rng.normal(0.0, 0.3, 200)
    assert not autopilot.vz_is_upward(t_ns, height, climb)


def test_coordinated_turn_accelerates_sideways_only():
    bank, g = np.radians(40.0), autopilot.GRAVITY_MPS2
    force = np.array([0.0, 0.0, -g / np.cos(bank)])
    for heading in np.radians([0.0, 90.0, 200.0]):
        a = autopilot.acceleration_enu(force, np.array([bank, 0.0, heading]), np.zeros(3), 0.0)
        right = np.array([np.cos(heading), -np.sin(heading), 0.0])
        assert a == pytest.approx(g * np.tan(bank) * right, abs=1e-12)


def test_body_rates_carry_the_attitude_on():
    roll_rate, age = 1.2, 0.08
    force = np.array([0.3, -0.4, -9.7])
    late = autopilot.acceleration_enu(force, np.array([0.1, 0, 0]), np.array([roll_rate, 0, 0]), age)
    exact = autopilot.acceleration_enu(force, np.array([0.1 + roll_rate * age, 0, 0]), np.zeros(3), 0.0)
    assert late == pytest.approx(exact, abs=2e-3)


def test_climb_is_positive_up():
    force = np.array([0.0, 0.0, -autopilot.GRAVITY_MPS2 - 2.0])
    assert autopilot.acceleration_enu(force, np.zeros(3), np.zeros(3), 0.0) == pytest.approx([0, 0, 2.0])


def test_geoid_separation_needs_a_fix_and_a_sender_that_knows():
    alt = np.full(4, 488_000)
    fix_type, ellipsoid = np.array([1, 3, 3, 3]), np.array([535_300, 0, 535_300, -9_000_000])
    separation = autopilot.geoid_separation_m(fix_type, alt, ellipsoid)
    assert separation == pytest.approx([np.nan, np.nan, 47.3, np.nan], nan_ok=True)


def test_a_wind_from_a_direction_that_is_no_number_is_none_and_warns_nobody():
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        assert np.isnan(autopilot.wind_en(np.float32(np.inf), np.float32(3.0))).all()
        assert np.isnan(autopilot.wind_en(np.full(2, np.inf), np.full(2, 3.0))).all()
