import numpy as np
import pytest

from filters.simulation import autopilot
from filters.simulation.autopilot import Autopilot, Glitch
from filters.simulation.scenario import Truth
from filters.simulation.simulate import PATCH

PERFECT = Autopilot(
    latency_s=(0.0, 0.0, 0.0), slow_m=0.0, quick_m=0.0, velocity_mps=0.0, swing_s=0.0, vibration_mps2=0.0,
    level_rad=0.0, steps=(1e-9, 1e-9),
)  # fmt: skip


def straight(seconds: float = 200.0, speed: float = 30.0) -> Truth:
    t_s = np.arange(0.0, seconds, 0.1)
    v = np.tile([speed, 0.0, 0.0], (len(t_s), 1))
    return Truth(t_s, t_s[:, None] * v + [0.0, 0.0, 100.0], v, np.zeros_like(v))


def errors(about: Autopilot, faults=(), truth=None, seed: int = 1):
    seen = autopilot.ins(truth or straight(), np.random.default_rng(seed), about, faults)
    return seen, seen.values - seen.clean


def test_a_perfect_one_says_the_truth_at_two_rates():
    seen, off = errors(PERFECT)
    assert np.nanmax(np.abs(off)) < 1e-6
    states, imus = np.isfinite(seen.values[:, 0]), np.isfinite(seen.values[:, 6])
    assert not (states & imus).any()
    assert imus.sum() / states.sum() == pytest.approx(2.5, rel=0.02)
    assert (np.diff(seen.t_ns) >= 0).all()


def test_position_is_late_by_its_own_delay():
    _, off = errors(PERFECT._replace(latency_s=(0.1, 0.0, 0.0)))
    assert np.nanmedian(off[5:, 0]) == pytest.approx(-3.0, abs=1e-3)
    assert np.nanmax(np.abs(off[:, 3:6])) < 1e-6


def test_errors_are_slow_not_white():
    _, off = errors(Autopilot(), truth=straight(1000.0, 0.0))
    position, velocity = off[np.isfinite(off[:, 0])][:, 1], off[np.isfinite(off[:, 0])][:, 4]
    for error, least in ((position, 0.99), (velocity, 0.9)):
        assert np.corrcoef(error[1:], error[:-1])[0, 1] > least
    assert velocity.std() == pytest.approx(Autopilot().velocity_mps, rel=0.2)


def test_velocity_lags_in_a_manoeuvre():
    t_s = np.arange(0.0, 20.0, 0.01)
    a = np.tile([10.0, 0.0, 0.0], (len(t_s), 1))
    truth = Truth(t_s, 0.5 * t_s[:, None] ** 2 * a, t_s[:, None] * a, a)
    _, off = errors(PERFECT._replace(swing_s=0.05), truth=truth)
    assert np.nanmedian(off[:, 3]) == pytest.approx(-0.5, abs=1e-3)


def test_vibration_comes_and_goes():
    _, off = errors(PERFECT._replace(vibration_mps2=1.0), truth=straight(400.0))
    shake = off[np.isfinite(off[:, 6])][:, 6]
    level = shake[: len(shake) // 100 * 100].reshape(-1, 100).std(axis=1)
    assert 0.7 < np.median(level) < 1.4
    assert level.max() > 1.8 * level.min()


def test_it_follows_a_jump_and_comes_back():
    jump = Glitch(50.0, 20.0, jump_m=(0.0, 40.0, 0.0))
    seen, off = errors(PERFECT._replace(slow_m=0.5), (jump,))
    since_s = (seen.t_ns - seen.t_ns[0]) * 1e-9
    during, after = (since_s > 60.0) & (since_s < 69.0), since_s > 85.0
    assert np.nanmedian(off[during, 1]) == pytest.approx(40.0, abs=2.0)
    assert np.nanmax(np.abs(off[after, 1])) < 4.0
    states = during & np.isfinite(seen.values[:, 0])
    assert (seen.labels[states, :3] == PATCH).all()
    assert not seen.labels[after].any()
    assert not seen.labels[:, 3:].any()


def test_it_drifts_without_a_fix():
    silence = Glitch(50.0, 40.0, drift_mps2=(0.02, 0.0, 0.0))
    off = autopilot.followed(np.arange(0.0, 150.0, 0.1), (silence,), 1.0)
    assert 12.0 < off[890, 0] < 16.0  # ½ · 0.02 · 39², a second behind
    assert abs(off[-1, 0]) < 1e-3


def test_faults_are_drawn_from_the_seed():
    first, second = (autopilot.glitches(3600.0, 5.0, np.random.default_rng(4)) for _ in range(2))
    assert first == second
    assert all(fault.begin_s >= 10.0 for fault in first)
