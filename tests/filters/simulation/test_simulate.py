"""The simulation against finite differences, closed forms and its own promises."""

import numpy as np
import pytest

from filters.models.rows import AZIMUTH, RANGE, Sensor
from filters.simulation import scenario, simulate

SIGMA = np.full(13, np.nan)
SIGMA[:3] = 1.0, 5e-5, 5e-5
LASER = Sensor("laser", "theodolite", SIGMA, np.array([800.0, 300.0, 20.0]))


def rng(seed=1):
    return np.random.default_rng(seed)


@pytest.fixture(scope="module")
def truth():
    return scenario.flight(120, 50, "aggressive", rng())


def test_polar_by_hand():
    p, v = np.array([[30.0, 40.0, 0.0], [-1.0, 0.0, 1.0]]), np.array([[3.0, 4.0, 9.0], [0.0, 5.0, 0.0]])
    expected = [[50.0, np.arctan2(3, 4), 0.0, 5.0], [np.sqrt(2), 1.5 * np.pi, np.pi / 4, 0.0]]
    np.testing.assert_allclose(simulate.polar(p, v), expected, atol=1e-12)


@pytest.mark.parametrize(("kind", "rise_m"), [("optical", 1.02), ("radar", 1.96)])
def test_refraction_at_ten_kilometres(kind, rise_m):
    p = np.array([[0.0, 10_000.0, 0.0]])
    assert simulate.polar(p, p, kind)[0, 2] * 10_000 == pytest.approx(rise_m, abs=0.01)


def test_noise_zero_error_and_clock(truth):
    errors = simulate.InstrumentErrors(zero=(5.0, 1e-3, -1e-3, 0.0), clock_offset_s=0.12, jitter_s=0.002)
    seen = simulate.instrument(truth, LASER, 20, rng(), errors)
    residual = (seen.values - seen.clean)[:, :3]
    off = (residual.mean(axis=0) - errors.zero[:3]) / SIGMA[:3] * np.sqrt(len(residual))
    assert np.abs(off).max() < 4
    np.testing.assert_allclose(residual.std(axis=0), SIGMA[:3], rtol=0.06)
    assert np.isnan(seen.values[:, 3]).all()
    # the truth 0.12 s before the stamp fits, the truth at the stamp does not
    t_s = (seen.t_ns - simulate.T0_NS) * 1e-9
    misfit = [
        np.std(np.linalg.norm(scenario.at(truth, t_s - c)[0] - LASER.offset_m, axis=1) - seen.clean[:, 0])
        for c in (0.12, 0.0)
    ]
    assert misfit[0] < 0.1 < 1.0 < misfit[1]


def test_rotation_and_offset_of_the_sensor(truth):
    quarter = np.array([[0.0, 1.0, 0.0], [-1.0, 0.0, 0.0], [0.0, 0.0, 1.0]])
    plain = simulate.instrument(truth, LASER, 20, rng())
    turned = simulate.instrument(truth, LASER._replace(rotation=quarter), 20, rng())
    np.testing.assert_allclose(turned.clean[:, [0, 2]], plain.clean[:, [0, 2]], atol=1e-9)
    np.testing.assert_allclose((turned.clean[:, 1] - plain.clean[:, 1]) % (2 * np.pi), np.pi / 2, atol=1e-9)


def test_gaps(truth):
    seen = simulate.instrument(truth, LASER, 20, rng(), simulate.InstrumentErrors(gap_share=0.1))
    assert 0.85 < len(seen.t_ns) / 2400 < 0.91
    assert np.diff(seen.t_ns).max() > 4e8


@pytest.mark.parametrize("share", [0.0, 0.04, 0.15, 0.3])
def test_share_kind_and_size_of_outliers(share):
    truth = scenario.flight(600, 20, "gentle", rng())
    clean = simulate.instrument(truth, LASER, 20, rng())
    dirty = simulate.contaminate(clean, SIGMA[:4], rng(), share)
    hit = dirty.labels != simulate.NONE
    assert hit.sum() / (3 * len(hit)) == pytest.approx(share, abs=0.003)
    if share:
        assert (dirty.labels == simulate.ISOLATED).sum() / hit.sum() == pytest.approx(0.63, abs=0.02)
    added = (dirty.values - clean.values) / SIGMA[:4]
    added[:, 1] = (added[:, 1] + np.pi / SIGMA[1]) % (2 * np.pi / SIGMA[1]) - np.pi / SIGMA[1]
    assert (np.abs(added[hit]) > 5.999).all()
    assert (np.abs(added[hit]) < 121).all()
    assert not added[~hit & np.isfinite(added)].any()


def test_runs_and_isolated_ones_are_what_they_say():
    truth = scenario.flight(600, 20, "gentle", rng())
    dirty = simulate.contaminate(simulate.instrument(truth, LASER, 20, rng()), SIGMA[:4], rng(), 0.1)
    for column in dirty.labels.T[:3]:
        edges = np.flatnonzero(np.diff(np.r_[0, column, 0]))
        for begin, end in zip(edges[::2], edges[1::2], strict=True):
            kind, length = column[begin], end - begin
            assert (length == 1) if kind == simulate.ISOLATED else (3 <= length <= 25)
    whole = (dirty.labels[:, :3] == simulate.PATCH).sum(axis=1)
    assert {1, 3} <= set(whole)


@pytest.mark.parametrize("kind", simulate.PATCH_KINDS)
def test_patches(truth, kind):
    clean = simulate.instrument(truth, LASER, 20, rng())
    dirty = simulate.patch(clean, SIGMA[:4], simulate.LongPatch(kind, 40, 10, (RANGE,), 30), rng())
    added = dirty.values[:, RANGE] - clean.values[:, RANGE]
    since_s = (clean.t_ns - simulate.T0_NS) * 1e-9 - 40
    inside = (since_s >= 0) & (since_s < 10)
    np.testing.assert_array_equal(dirty.labels[:, RANGE] == simulate.PATCH, inside)
    assert not dirty.labels[:, AZIMUTH].any()
    assert not added[~inside].any()
    if kind == "offset":
        np.testing.assert_allclose(np.abs(added[inside]), 30, atol=1e-9)
    elif kind == "ramp":
        np.testing.assert_allclose(np.abs(added[inside]), 3 * since_s[inside], atol=1e-9)
    elif kind == "frozen":
        assert set(dirty.values[inside, RANGE]) == {clean.values[inside.argmax() - 1, RANGE]}
    else:
        assert added[inside].std() == pytest.approx(30, rel=0.2)


def test_ins_error_is_slow_in_position_and_white_in_velocity():
    truth = scenario.flight(2000, 20, "gentle", rng())
    seen = simulate.ins(truth, rng(), simulate.InsErrors(bias_m=2.0, tau_s=20.0))
    error = seen.values - seen.clean
    assert error[:, :3].std() == pytest.approx(2.0, rel=0.15)
    one_tau = np.mean(error[:-200, :3] * error[200:, :3]) / error[:, :3].var()
    assert one_tau == pytest.approx(np.exp(-1), abs=0.12)
    assert error[:, 3:6].std() == pytest.approx(0.1, rel=0.02)
    assert abs(np.mean(error[:-1, 3:6] * error[1:, 3:6])) < 0.03 * 0.01
    stamped = (seen.t_ns - simulate.T0_NS) * 1e-9 - 0.12
    np.testing.assert_allclose(scenario.at(truth, stamped)[0], seen.clean[:, :3], atol=1e-5)


def test_rows_hold_every_value_once_in_time_order(truth):
    observations = [simulate.instrument(truth, LASER, 20, rng()), simulate.ins(truth, rng())]
    joined, labels = simulate.rows(observations)
    assert len(joined) == len(labels) == sum(np.isfinite(seen.values).sum() for seen in observations)
    assert (np.diff(joined["t_ns"]) >= 0).all()
    for sensor, seen in enumerate(observations):
        mine = joined[joined["sensor"] == sensor]
        values = seen.values[np.isfinite(seen.values)]
        np.testing.assert_array_equal(np.sort(mine["value"]), np.sort(values))


def test_interpolation_meets_every_sample(truth):
    for values, samples in zip(scenario.at(truth, truth.t_s), truth[1:], strict=True):
        np.testing.assert_allclose(values, samples, atol=1e-6)


def test_measured_track_between_its_samples():
    t_s = np.arange(0, 20, 0.04)
    circle = np.column_stack([50 * np.sin(t_s / 2), 50 * np.cos(t_s / 2), 100 + 0 * t_s])
    p, v, _ = scenario.at(scenario.track(t_s, circle), np.array([7.013, 11.987]))
    expected = [[50 * np.sin(t / 2), 50 * np.cos(t / 2), 100] for t in (7.013, 11.987)]
    np.testing.assert_allclose(p, expected, atol=1e-4)
    np.testing.assert_allclose(np.linalg.norm(v, axis=1), 25, atol=0.02)
