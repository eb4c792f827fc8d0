"""What a row says of the state: against the textbook's full filter, moments by quadrature, differences."""

import itertools

import numpy as np
import pytest

from filters.models import state, theodolite
from filters.models.motion import CORE
from filters.models.rows import AZIMUTH, CHANNELS, ELEVATION, RANGE, RANGE_RATE, VE, E
from filters.models.unscented import difference
from filters.models.update import update
from filters.smoother import passes
from tests.filters import full_ukf
from tests.filters.smoother.kit import small
from tests.filters.smoother.kit.differences import derivatives

pytestmark = pytest.mark.decision

POLAR = [RANGE, AZIMUTH, ELEVATION, RANGE_RATE]
STILL = np.zeros(4)


def predict(model, channel, value, x, P, *, sensor=0, place=None, psd=STILL):
    """(innovation, its variance without noise, P h (n,), gradient (n,))."""
    rows = small.as_rows([(0.0, sensor, channel, value)], model)
    if place is not None:
        rows.place[0] = place
    n = len(x)
    out = passes.trace(1, n, 1)
    v, variance = state.predict_row(model, rows, 0, x, P, psd, out, 0, state.scratch(n))
    gradient = np.zeros(n)
    np.add.at(gradient, out.index[0, : out.count[0]], out.gain[0, : out.count[0]])
    return v, variance, out.m[0].copy(), gradient


def narrow(seed):
    rng = np.random.default_rng(seed)
    root = rng.normal(size=(CORE, CORE)) * np.repeat([8.0, 5.0, 2.0], 3)[:, None]
    x = np.array([300.0, 900, 200, 20, -30, 5, 1, 2, -1]) + rng.normal(size=9)
    return x, root @ root.T


def tilted():
    """A radar that does not stand level, away from the station."""
    a, b = np.radians([20.0, 3.0])
    turn = np.array([[np.cos(a), np.sin(a), 0], [-np.sin(a), np.cos(a), 0], [0, 0, 1]])
    lean = np.array([[1, 0, 0], [0, np.cos(b), np.sin(b)], [0, -np.sin(b), np.cos(b)]])
    return small.radar(place=(-400.0, 100.0, 20.0))._replace(rotation=lean @ turn)


# ---- the state's layout


def test_the_state_has_what_the_sensors_ask_for():
    sensors = [
        small.ins(clock_sigma_s=0.2, p=0.5, v=0.2),
        small.theodolite(estimate=("bias", "clock")),
        small.theodolite(az=1e-4, el=1e-4, estimate=("bias",)),
        small.radar(),
    ]
    model = state.build(sensors, bias_sigma_m=3.0, bias_tau_s=50.0)
    assert model.bias_at[0, E : E + 6].tolist() == [9, 10, 11, 12, 13, 14]
    assert model.clock_at.tolist() == [15, 19, -1, -1]
    assert model.bias_at[1, :3].tolist() == [16, 17, 18]
    assert model.bias_at[2, :3].tolist() == [-1, 20, 21]  # it has no range
    assert (model.bias_at[3] == -1).all()
    assert len(model.prior) == len(model.rate) == 22
    assert model.prior[9] == 9.0
    assert model.rate[9] == pytest.approx(1 / 50.0)
    assert model.prior[15] == pytest.approx(0.04)
    assert not model.rate[16:19].any()
    assert not model.prior[:CORE].any()
    assert not state.floating(model)


SLOW = {"r": 2.0, "az": 3e-4, "el": 1e-4, "rr": 0.3}
ZEROS = 5.0, 1e-3, 2e-3


def slow_states(slow, estimate=(), **sigma):
    """(variance, correlation time, whose) of a second instrument's errors, (13,) each; NaN where none."""
    sensor = small.radar(slow=slow, estimate=estimate, **(sigma or SLOW))._replace(zero_sigma=ZEROS)
    model = state.build([small.ins(), sensor])
    at = np.maximum(model.bias_at[1], 0)
    with np.errstate(divide="ignore"):
        found = model.prior[at], 1.0 / model.rate[at], np.append(np.zeros(CORE), model.slow_of)[at]
    return [np.where(model.bias_at[1] >= 0, column, np.nan) for column in found]


@pytest.mark.parametrize("slow", [1.0, 0.5, 3.0])
def test_an_instrument_has_slow_errors_as_multiples_of_its_noise(slow):
    variance, tau_s, whose = slow_states(slow)
    expected = (slow * np.array([SLOW["r"], SLOW["az"], SLOW["el"]])) ** 2
    assert variance[:3] == pytest.approx(expected)
    assert tau_s[:3] == pytest.approx(theodolite.SLOW_TAU_S)
    assert whose[:3].tolist() == [1, 1, 1]
    assert np.isnan(variance[3:]).all()  # a range rate has none


@pytest.mark.parametrize("slow", [1.0, 3.0])
def test_a_zero_error_that_is_asked_for_holds_the_slow_one_too(slow):
    """One state of both variances, driven by the same white noise as the slow one alone: 2 variance / tau."""
    variance, tau_s, whose = slow_states(slow, ("bias",))
    alone, alone_s, _ = slow_states(slow)
    assert variance[:3] == pytest.approx(np.square(ZEROS) + alone[:3])
    assert variance[:3] / tau_s[:3] == pytest.approx(alone[:3] / alone_s[:3])
    assert (tau_s[:3] > theodolite.SLOW_TAU_S).all()
    assert whose[:3].tolist() == [-1, -1, -1]  # its prior is the station's, not learned


def test_without_slow_errors_the_state_is_as_it_was_before_them():
    assert np.isnan(slow_states(0.0)[0]).all()
    variance, tau_s, whose = slow_states(0.0, ("bias",))
    assert variance[:3] == pytest.approx(np.square(ZEROS))
    assert np.isinf(tau_s[:3]).all()
    assert whose[:3].tolist() == [-1, -1, -1]


@pytest.mark.parametrize("estimate", [(), ("bias",), ("bias", "clock")], ids="+".join)
def test_a_channel_that_an_instrument_has_not_has_no_errors(estimate):
    variance, *_ = slow_states(1.0, estimate, az=3e-4, el=1e-4)
    assert np.isnan(variance[RANGE])
    assert np.isfinite(variance[[AZIMUTH, ELEVATION]]).all()


def test_slow_of_says_whose_factor_a_state_has():
    sensors = [
        small.theodolite(slow=1.0, estimate=("clock",)),
        small.ins(),
        small.radar(slow=0.0),
        small.theodolite(slow=2.0),
    ]
    model = state.build(sensors)
    expected = np.full(len(model.prior), -1)
    for s in (0, 3):
        expected[model.bias_at[s, :3]] = s
    assert model.slow_of.tolist() == expected[CORE:].tolist()
    assert len(state.build([small.radar()]).slow_of) == 0
    ins = small.ins()
    assert np.array_equal(state.build([ins._replace(slow=5.0)]).prior, state.build([ins]).prior)


def test_where_all_clocks_float_a_common_shift_is_no_error():
    model = state.build([small.theodolite(estimate=("clock",)), small.radar(estimate=("clock",))])
    P = state.prior_covariance(model)[np.ix_(model.clock_at, model.clock_at)]
    weight = 1.0 / model.prior[model.clock_at]
    assert state.floating(model)
    assert weight @ P @ weight == pytest.approx(0.0, abs=1e-12)  # of the weighted mean
    apart = np.array([1.0, -1.0])
    assert apart @ P @ apart == pytest.approx(model.prior[model.clock_at].sum())  # of their difference


def test_the_common_shift_is_the_clock_of_the_most():
    sensors = [small.theodolite(estimate=("clock",)) for _ in range(3)]
    model, all_heard = state.build(sensors), np.ones(3, bool)
    clocks = np.array([[0.01, 0.012, 0.5]])
    assert state.common_shift(model, clocks, all_heard)[0] == 0.012
    assert state.common_shift(model, clocks, np.array([True, False, False]))[0] == 0.01
    assert state.common_shift(model, clocks, np.zeros(3, bool))[0] == 0.0
    known = state.build([*sensors, small.radar()])
    assert state.common_shift(known, np.array([[0.01, 0.012, 0.5, 0]]), np.ones(4, bool))[0] == 0.0


# ---- narrow priors


@pytest.mark.parametrize("channel", POLAR, ids=CHANNELS[:4])
@pytest.mark.parametrize("sensor", [small.radar(), tilted()], ids=["level", "tilted"])
def test_it_is_the_full_unscented_filter(channel, sensor):
    model = state.build([sensor])
    for seed in range(5):
        x, P = narrow(seed)
        measured = full_ukf.value(sensor, channel, x) + 2.0 * sensor.sigma[channel]
        v, variance, m, _ = predict(model, channel, measured, x, P, place=x[:3] + 1.0)
        S = variance + sensor.sigma[channel] ** 2
        full_x, full_P, full_v, full_S = full_ukf.update(x, P, sensor, channel, measured)
        mine_x, mine_P = x.copy(), P.copy()
        update(mine_x, mine_P, m, v, S)
        assert v == pytest.approx(full_v, rel=1e-9, abs=1e-11)
        assert pytest.approx(full_S, rel=1e-9) == S
        assert np.allclose(mine_x, full_x, rtol=1e-9, atol=1e-9)
        assert np.allclose(mine_P, full_P, rtol=1e-9, atol=1e-9 * np.abs(P).max())


@pytest.mark.parametrize("channel", POLAR, ids=CHANNELS[:4])
@pytest.mark.parametrize("estimate", [(), ("bias",), ("clock",), ("bias", "clock")], ids="+".join)
def test_the_gradient_is_the_derivative(channel, estimate):
    model = state.build([tilted()._replace(estimate=estimate, refraction="radar"), small.ins()])
    rng, n = np.random.default_rng(3), len(model.prior)
    x = np.concatenate([narrow(0)[0], 0.01 * rng.normal(size=n - CORE)])
    P = 1e-10 * np.eye(n)
    *_, m, gradient = predict(model, channel, 0.0, x, P)
    found = derivatives(lambda y: -predict(model, channel, 0.0, y, P)[0], x, 1e-4)
    assert np.allclose(gradient, found, rtol=1e-5, atol=1e-7)
    assert np.allclose(m, P @ gradient, rtol=1e-6, atol=1e-16)


def moments(f, mean, cov):
    """Mean and variance of ``f`` and its covariance with its argument, by Gauss-Hermite quadrature."""
    z, w = np.polynomial.hermite_e.hermegauss(5)
    root, w = np.linalg.cholesky(cov), w / w.sum()
    points = np.array(list(itertools.product(z, repeat=len(mean)))) @ root.T + mean
    weight = np.prod(list(itertools.product(w, repeat=len(mean))), axis=1)
    y = np.array([f(point) for point in points])
    centre = weight @ y
    return centre, weight @ (y - centre) ** 2, (weight * (y - centre)) @ (points - mean)


def test_an_ins_position_counts_the_product_of_unsure_speed_and_unsure_latency():
    model = state.build([small.ins(clock_sigma_s=0.2), small.radar()])
    n, clock = len(model.prior), model.clock_at[0]
    rng = np.random.default_rng(1)
    for seed in range(3):
        root = np.random.default_rng(seed).normal(size=(3, 3)) * [[3.0], [5.0], [0.2]]
        P = np.zeros((n, n))
        at = [0, 3, clock]
        P[np.ix_(at, at)] = root @ root.T
        x = np.zeros(n)
        x[at] = rng.normal(size=3) * [100.0, 30.0, 0.1]
        v, variance, m, _ = predict(model, E, 0.0, x, P)
        mean, spread, cross = moments(lambda y: y[0] - y[1] * y[2], x[at], P[np.ix_(at, at)])
        assert -v == pytest.approx(mean, rel=1e-9)
        assert variance == pytest.approx(spread, rel=1e-9)
        assert np.allclose(m[at], cross, rtol=1e-9)


@pytest.mark.parametrize("channel", [RANGE, AZIMUTH, ELEVATION], ids=CHANNELS[:3])
def test_an_instruments_clock_counts_likewise(channel):
    """Far away, where the channel itself is all but linear."""
    sensor = small.theodolite(estimate=("clock",))
    model = state.build([sensor, small.radar()])
    n, clock = len(model.prior), model.clock_at[0]
    at = [0, 1, 2, 3, 4, 5, clock]
    rng = np.random.default_rng(4)
    root = rng.normal(size=(7, 7)) * np.array([2.0, 2, 2, 3, 3, 3, 0.1])[:, None]
    x, P = np.zeros(n), np.zeros((n, n))
    x[at] = [20e3, 30e3, 4e3, 100.0, -50.0, 20.0, 0.05]
    P[np.ix_(at, at)] = root @ root.T
    seen = small.polar(sensor, x[:3])[channel]
    v, variance, m, _ = predict(model, channel, seen, x, P)

    def value(y):
        return small.polar(sensor, y[:3] - y[6] * y[3:6])[channel] - seen

    mean, spread, cross = moments(value, x[at], P[np.ix_(at, at)])
    assert -v == pytest.approx(mean, rel=1e-4, abs=1e-9)
    assert variance == pytest.approx(spread, rel=1e-3)
    scale = np.sqrt(spread * np.diag(P)[at])
    assert (np.abs(m[at] - cross) < 1e-3 * scale).all()


@pytest.mark.parametrize("channel", [VE, VE + 2, VE + 3])
def test_a_late_ins_cannot_know_what_moved_since(channel):
    model = state.build([small.ins(clock_sigma_s=0.2, p=0.5, v=0.2, a=0.3), small.radar()])
    n = len(model.prior)
    x, P = np.zeros(n), np.eye(n) * 1e-6
    x[model.clock_at[0]] = 0.4
    calm = predict(model, channel, 0.0, x, P)[1]
    lively = predict(model, channel, 0.0, x, P, psd=small.PSD)[1]
    Q = small.transition(0.4, small.PSD)[1]
    assert lively - calm == pytest.approx(Q[channel - VE + 3, channel - VE + 3], rel=1e-9)


def test_angles_differ_the_short_way():
    assert difference(AZIMUTH, 3.1, -3.1) == pytest.approx(6.2 - 2 * np.pi)
    assert difference(RANGE, 3.1, -3.1) == 6.2
    model = state.build([small.theodolite()])
    x, P = np.zeros(9), np.eye(9) * 1e-4
    x[:3] = 1.0, -1000.0, 50.0
    v, *_ = predict(model, AZIMUTH, -np.pi + 1e-3, x, P)
    assert v == pytest.approx(2e-3, rel=1e-3)


def test_a_zero_error_is_taken_off_and_counts():
    sensor = small.theodolite(estimate=("bias",))
    model = state.build([sensor])
    x, P = np.zeros(12), state.prior_covariance(model)
    core_x, core_P = narrow(1)
    x[:9], P[:9, :9] = core_x, core_P
    at = model.bias_at[0, RANGE]
    seen = small.polar(sensor, x[:3])[RANGE]
    v, variance, m, _ = predict(model, RANGE, seen, x, P)
    plain = predict(state.build([small.theodolite()]), RANGE, seen, core_x, core_P)
    x[at] = 3.0
    assert predict(model, RANGE, seen, x, P)[0] == pytest.approx(v - 3.0)
    assert variance == pytest.approx(plain[1] + P[at, at])
    assert m[at] == pytest.approx(P[at, at])
