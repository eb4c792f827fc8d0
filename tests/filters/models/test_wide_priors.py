"""Rows seen from a state that is known too poorly for sigma points."""

import itertools

import numpy as np
import pytest

from filters.models import state
from filters.models.rows import AZIMUTH, CHANNELS, ELEVATION, RANGE
from filters.models.update import update
from tests.filters.models.test_state import narrow, predict, tilted
from tests.filters.smoother.kit import small
from tests.filters.smoother.kit.differences import derivatives

pytestmark = pytest.mark.decision


def diffuse(model, at=(0.0, 0.0, 0.0)):
    x, P = np.zeros(len(model.prior)), state.prior_covariance(model)
    x[:3] = at
    P[range(9), range(9)] = np.repeat([1e5, 300.0, 20.0], 3) ** 2
    return x, P


@pytest.mark.parametrize("target", [(300.0, 900.0, 200.0), (-40.0, 15.0, 3000.0), (-9e3, -12e3, 10.0)])
@pytest.mark.parametrize("guess", [(0.0, 0.0, 0.0), (5e3, -5e3, 0.0)])
@pytest.mark.parametrize("order", list(itertools.permutations(range(3))))
def test_one_plot_places_the_target_from_nothing(target, guess, order):
    """Range, azimuth and elevation in any order; the error is that of the plot's own sigmas."""
    sensor = tilted()
    model = state.build([sensor])
    p = np.array(target)
    seen = small.polar(sensor, p)
    x, P = diffuse(model, guess)
    for channel in order:
        v, variance, m, _ = predict(model, channel, seen[channel], x, P, place=p)
        update(x, P, m, v, variance + sensor.sigma[channel] ** 2)
    jacobian = np.array([derivatives(lambda q, c=c: small.polar(sensor, q)[c], p, 1e-2) for c in range(3)])
    whitened = jacobian / sensor.sigma[:3, None]
    assert np.linalg.norm(whitened @ (x[:3] - p)) < 0.2  # sigmas
    expected = np.linalg.inv(whitened.T @ whitened)
    assert np.allclose(np.diag(P)[:3], np.diag(expected), rtol=0.05)


def test_a_wide_row_is_linear_at_its_own_place():
    sensor = tilted()
    model = state.build([sensor])
    x, P = diffuse(model)
    place = np.array([800.0, -300.0, 150.0])
    for channel in (RANGE, AZIMUTH, ELEVATION):
        h = np.zeros(9)
        h[:3] = derivatives(lambda q, c=channel: small.polar(sensor, q)[c], place, 1e-2)
        seen = small.polar(sensor, place)[channel] + 1e-3
        v, variance, m, gradient = predict(model, channel, seen, x, P, place=place)
        assert np.allclose(gradient, h, rtol=1e-5, atol=1e-9)
        assert v == pytest.approx(1e-3 - h[:3] @ (x[:3] - place), rel=1e-6)
        assert variance == pytest.approx(h @ P @ h, rel=1e-6)
        assert np.allclose(m, P @ h, rtol=1e-5, atol=1e-3)


@pytest.mark.parametrize("channel", [RANGE, AZIMUTH, ELEVATION], ids=CHANNELS[:3])
def test_a_line_of_sight_alone_moves_nothing_while_the_place_is_unknown(channel):
    sensor = small.theodolite()
    model = state.build([sensor])
    x, P = diffuse(model, (500.0, 800.0, 100.0))
    v, variance, m, gradient = predict(model, channel, 0.3, x, P)
    before = x.copy(), P.copy()
    update(x, P, m, v, variance + sensor.sigma[channel] ** 2)
    assert not gradient.any()
    assert np.array_equal(x, before[0])
    assert np.array_equal(P, before[1])


def test_an_angle_without_a_place_is_still_compared_with_the_prediction():
    """A position of 200 m sigma at a kilometre: across, and so within 0.2 rad, or it is an outlier."""
    sensor = tilted()
    model = state.build([sensor])
    x, P = diffuse(model, sensor.offset_m + sensor.rotation.T @ [0.0, 1000.0, 0.0])
    P[range(3), range(3)] = 200.0**2
    far = np.sqrt(1000.0**2 + 3 * 200.0**2)
    for channel in (AZIMUTH, ELEVATION):
        for off in (0.1, 0.5, 1.2):
            v, variance, _, gradient = predict(model, channel, off, x, P)
            assert v == pytest.approx(1000.0 * np.sin(off) / far, rel=1e-6)
            assert np.sqrt(variance) == pytest.approx(200.0 / far, rel=1e-6)
            assert not gradient.any()


@pytest.mark.parametrize("channel", [AZIMUTH, ELEVATION])
@pytest.mark.parametrize(
    ("share", "sigma_m", "heard"), [(0.0, 20.0, False), (0.7, 50.0, True), (0.0, 400.0, True)]
)
def test_a_place_that_the_prediction_excludes_moves_nothing(channel, share, sigma_m, heard):
    """A target at the instrument itself would lie on every line of sight."""
    sensor = small.theodolite()
    model = state.build([sensor])
    place = np.array([300.0, 500.0, 100.0])
    x, P = diffuse(model, share * place)
    P[range(3), range(3)] = sigma_m**2
    seen = small.polar(sensor, place)[channel] + 0.5
    _, _, m, gradient = predict(model, channel, seen, x, P, place=place)
    assert bool(gradient.any()) == bool(m.any()) == heard


def test_a_narrow_prior_needs_no_place():
    sensor = small.theodolite()
    model = state.build([sensor])
    x, P = narrow(0)
    for channel in (RANGE, AZIMUTH, ELEVATION):
        seen = small.polar(sensor, x[:3])[channel]
        without = predict(model, channel, seen, x, P)
        other = predict(model, channel, seen, x, P, place=x[:3] + 500.0)
        assert without[:2] == other[:2]
        assert np.array_equal(without[3], other[3])


@pytest.mark.parametrize("channel", [AZIMUTH, ELEVATION])
@pytest.mark.parametrize(("along_m", "moves"), [(90.0, True), (110.0, False)])
def test_a_line_of_sight_alone_moves_only_a_target_whose_distance_is_known(channel, along_m, moves):
    """To a tenth, as across it; with a place of its own to two fifths."""
    sensor = small.theodolite()
    model = state.build([sensor])
    x, P = diffuse(model, (0.0, 1000.0, 0.0))
    P[range(3), range(3)] = 1.0, along_m**2, 1.0
    assert predict(model, channel, 1e-3, x, P)[3].any() == moves
    assert predict(model, RANGE, 1000.0, x, P)[3].any()
    assert predict(model, channel, 1e-3, x, P, place=x[:3] + 5.0)[3].any()
