"""What autopilots mean, and what some of them get wrong."""

import numpy as np

from bridges import autopilot


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
