import numpy as np
import pytest

from filters.models.rows import AZIMUTH, ELEVATION, RANGE, Sensor
from filters.simulation import faults, scenario
from filters.simulation.faults import Faults
from filters.simulation.scenario import Truth
from filters.simulation.simulate import PATCH, T0_NS, polar

SIGMA = np.array([1.0, 1e-4, 1e-4, np.nan, *[np.nan] * 9])
THEODOLITE = Sensor("theo", "theodolite", SIGMA, np.array([800.0, -300.0, 0.0]))


def flown(seconds: float = 60.0, level: str = "normal") -> Truth:
    return scenario.flight(seconds, 100.0, level, np.random.default_rng(2))


def off(about: Faults, truth: Truth | None = None, sensor: Sensor = THEODOLITE):
    """(observation, values − true values), the noise of the seed taken off."""
    truth = truth or flown()
    seen = faults.instrument(truth, sensor, 20.0, np.random.default_rng(7), about)
    plain = faults.instrument(truth, sensor, 20.0, np.random.default_rng(7))
    difference = seen.values - plain.values
    difference[:, AZIMUTH] = (difference[:, AZIMUTH] + np.pi) % (2 * np.pi) - np.pi
    return seen, difference


def test_without_faults_there_is_noise_only():
    seen = faults.instrument(flown(), THEODOLITE, 20.0, np.random.default_rng(7))
    noise = (seen.values - seen.clean)[:, [RANGE, ELEVATION]] / SIGMA[[RANGE, ELEVATION]]
    assert noise.std() == pytest.approx(1.0, rel=0.05)
    assert np.isnan(seen.values[:, 3]).all()
    assert not seen.labels.any()


def test_a_tilted_mount_is_a_turned_frame():
    tilt = (2e-4, -3e-4)
    seen, difference = off(Faults(tilt=tilt))
    truth = flown()
    t_s = (seen.t_ns - T0_NS) * 1e-9
    p = scenario.at(truth, t_s)[0] - THEODOLITE.offset_m
    turned = p - np.cross([*tilt, 0.0], p)
    exact = polar(turned, np.ones_like(p)) - polar(p, np.ones_like(p))
    assert difference[:, AZIMUTH] == pytest.approx(exact[:, AZIMUTH], abs=2e-6)
    assert difference[:, ELEVATION] == pytest.approx(exact[:, ELEVATION], abs=1e-6)


def test_crooked_axes_depend_on_the_elevation():
    clean = np.array([[1000.0, 1.0, 0.0, 0.0], [1000.0, 1.0, np.radians(60.0), 0.0]])
    still = np.zeros((2, 2))
    collimation = faults.lasting(clean, still, Faults(collimation=1e-4))[:, AZIMUTH]
    trunnion = faults.lasting(clean, still, Faults(trunnion=1e-4))[:, AZIMUTH]
    assert collimation == pytest.approx([1e-4, 2e-4])
    assert trunnion == pytest.approx([0.0, 1e-4 * np.sqrt(3.0)])


def test_an_eccentric_circle_repeats_after_a_turn():
    azimuth = np.linspace(0.0, 2 * np.pi, 9)
    clean = np.column_stack([np.full(9, 500.0), azimuth, np.zeros(9), np.zeros(9)])
    found = faults.lasting(clean, np.zeros((9, 2)), Faults(eccentricity=(1e-4, 0.0)))[:, AZIMUTH]
    assert found == pytest.approx(1e-4 * np.sin(azimuth))


def test_a_servo_lags_with_the_rate():
    truth = flown()
    seen, difference = off(Faults(lag_s=0.05), truth)
    t_s = (seen.t_ns - T0_NS) * 1e-9
    rate = faults.angular_rate(truth, THEODOLITE, t_s)
    assert np.abs(rate).max() > 0.01
    assert difference[:, AZIMUTH] == pytest.approx(-0.05 * rate[:, 0], abs=1e-9)


def test_each_channel_has_its_own_stamp():
    t_s = np.arange(0.0, 20.0, 0.1)
    v = np.tile([0.0, 40.0, 0.0], (len(t_s), 1))
    truth = Truth(t_s, [800.0, 500.0, 0.0] + t_s[:, None] * v, v, np.zeros_like(v))
    _, difference = off(Faults(delay_s=(0.1, 0.0, 0.0, 0.0)), truth)
    assert np.median(difference[:, RANGE]) == pytest.approx(-4.0, rel=1e-3)
    assert np.abs(difference[:, [AZIMUTH, ELEVATION]]).max() < 1e-12


def test_a_clock_drifts():
    seen, plain = (
        faults.instrument(flown(), THEODOLITE, 20.0, np.random.default_rng(7), about)
        for about in (Faults(clock_s=0.2, drift=1e-3), Faults())
    )
    late_s = (seen.t_ns - plain.t_ns) * 1e-9
    assert late_s[0] == pytest.approx(0.2, abs=1e-3)
    assert late_s[-1] == pytest.approx(0.26, abs=1e-3)


def test_the_echo_lives_at_low_elevation_only():
    elevation = np.radians(np.linspace(0.05, 10.0, 2000))
    clean = np.column_stack([np.full(2000, 5e3), np.zeros(2000), elevation, np.zeros(2000)])
    swing = faults.echo(clean, Faults(echo=1.0))[:, ELEVATION]
    low = elevation < np.radians(0.5)
    assert np.abs(swing[low]).max() > np.radians(0.2)
    assert np.abs(swing[elevation > np.radians(3.0)]).max() < 1e-5
    assert (swing[low] > 0).any()
    assert (swing[low] < 0).any()


def test_a_stuck_bit_is_a_step_for_some_of_the_time():
    seen, difference = off(Faults(encoder_step=1e-3, encoder_share=0.3), flown(600.0))
    stuck = np.abs(difference[:, AZIMUTH]) > 5e-4
    assert 0.15 < stuck.mean() < 0.45
    assert (seen.labels[stuck, AZIMUTH] == PATCH).all()
    assert not seen.labels[:, [RANGE, ELEVATION]].any()


def test_what_is_lost_comes_back_from_the_side():
    seen, difference = off(Faults(loss_rate_hz=0.1), flown(300.0))
    lost = np.isnan(seen.values[:, RANGE])
    assert 0.02 < lost.mean() < 0.5
    first = np.flatnonzero(lost[:-1] & ~lost[1:]) + 1
    assert np.abs(difference[first][:, [AZIMUTH, ELEVATION]]).max() > 1e-3
    assert (seen.labels[first] == PATCH).any()
    assert not seen.labels[lost].any()


def test_it_loses_a_target_that_turns_too_fast():
    t_s = np.arange(0.0, 60.0, 0.1)
    v = np.tile([40.0, 0.0, 0.0], (len(t_s), 1))
    truth = Truth(t_s, [-1200.0, 60.0, 50.0] + t_s[:, None] * v, v, np.zeros_like(v))
    here = THEODOLITE._replace(offset_m=np.zeros(3))
    seen, _ = off(Faults(loses_radps=0.2, loss_s=(2.0, 3.0)), truth, here)
    lost_s = (seen.t_ns[np.isnan(seen.values[:, RANGE])] - T0_NS) * 1e-9
    assert len(lost_s)
    assert 25.0 < lost_s.min() < 35.0  # it passes at 30 s


def test_the_same_seed_gives_the_same_values():
    first, second = (
        faults.instrument(
            flown(), THEODOLITE, 20.0, np.random.default_rng(1), Faults(loss_rate_hz=0.1, echo=1.0)
        )
        for _ in range(2)
    )
    assert np.array_equal(first.values, second.values, equal_nan=True)
