"""How large an instrument's slow errors are is learned, up and down, and kept; what none shows is not."""

import numpy as np
import pytest

from filters.models import motion, state, theodolite
from filters.models.motion import CORE
from filters.models.rows import AZIMUTH, ELEVATION, RANGE
from filters.smoother import adaptation
from tests.filters.smoother.kit import small

pytestmark = pytest.mark.decision

SENSORS = [
    small.ins(),
    small.theodolite("a", slow=1.0, r=2.0, az=1e-4, el=1e-4),
    small.theodolite("zeros", slow=1.0, estimate=("bias", "clock")),
    small.radar("b", slow=2.0),
]
MODEL = state.build(SENSORS)
A, B = MODEL.bias_at[1, :3], MODEL.bias_at[3, :3]
PRIOR = adaptation.slow_prior(len(SENSORS))
LEAST = adaptation.SLOW_SIGMA**-2


def follow(known, seconds, x=None, variance=None):
    """`follow_slow` of a state that says nothing but what is given: {index: value}."""
    every_x, every_variance = np.zeros(len(MODEL.prior)), MODEL.prior.copy()
    every_variance[CORE:] *= adaptation.slow_factors(known, MODEL)
    for column, told in ((every_x, x), (every_variance, variance)):
        for at, value in (told or {}).items():
            column[at] = value
    return adaptation.follow_slow(known, MODEL, every_x, every_variance, seconds)


def test_before_the_first_row_they_are_as_stated():
    assert not PRIOR[0].any()
    assert PRIOR[1] == pytest.approx(LEAST)
    assert np.array_equal(adaptation.slow_factors(PRIOR, MODEL), np.ones(len(MODEL.prior) - CORE))


def test_each_instrument_has_one_factor_and_zero_errors_clocks_and_an_ins_none():
    known = PRIOR.copy()
    known[0] = np.log([3.0, 0.2, 5.0, 7.0])
    expected = np.ones(len(MODEL.prior))
    expected[A], expected[B] = 0.2, 7.0
    assert adaptation.slow_factors(known, MODEL) == pytest.approx(expected[CORE:])
    assert len(adaptation.slow_factors(known[:, :1], state.build([small.theodolite()]))) == 0


def log_likelihood(factor, seconds, x, variance):
    """Expected, of the samples that so much time is worth, by the log ``factor`` of their variances."""
    samples, stationary = seconds / (2.0 * theodolite.SLOW_TAU_S), MODEL.prior[list(x)] * np.exp(factor)
    square = np.array([x[at] ** 2 + variance[at] for at in x])
    return -0.5 * samples * (np.log(stationary) + square / stationary).sum()


@pytest.mark.parametrize("before", [0.0, -1.0, 0.7])
def test_one_step_is_that_of_slope_and_information(before):
    """The slope by differences of the expected log likelihood; the prior is an observation of 0."""
    known, seconds, h = PRIOR.copy(), 4.0, 1e-5
    known[:, 1] = before, 3.0
    x = dict(zip(A, [1.0, 2e-5, 3e-4], strict=True))
    variance = dict(zip(A, [0.5, 1e-10, 4e-10], strict=True))
    slope = np.subtract(*(log_likelihood(before + d, seconds, x, variance) for d in (h, -h))) / (2 * h)
    seen = [max(0.0, 1.0 - variance[at] / (MODEL.prior[at] * np.exp(before))) for at in A]
    keep = np.exp(-seconds / adaptation.SLOW_MEMORY_S)
    faded = LEAST + keep * (3.0 - LEAST)
    information = faded + 0.5 * seconds / (2.0 * theodolite.SLOW_TAU_S) * np.square(seen).sum()
    found = follow(known, seconds, x, variance)
    assert found[1, 1] == pytest.approx(information)
    assert found[0, 1] == pytest.approx(keep * 3.0 * before / faded + slope / information, rel=1e-6)
    others = [0, 2, 3]
    assert found[0, others] == pytest.approx(0.0, abs=1e-12)


def test_an_error_that_is_known_well_counts_once_in_two_correlation_times():
    """Of one that has been seen to be n times as large the mean square is n² after one sample."""
    one = 2.0 * theodolite.SLOW_TAU_S
    sure = dict.fromkeys(A, 0.0)
    x = {at: 1.5 * np.sqrt(MODEL.prior[at]) for at in A}
    found = follow(PRIOR, one, x, sure)
    assert found[1, 1] == pytest.approx(LEAST + 3 * 0.5)
    assert found[0, 1] == pytest.approx(3 * 0.5 * (1.5**2 - 1.0) / (LEAST + 3 * 0.5))


def test_what_no_row_shows_is_not_learned():
    known = PRIOR.copy()
    for _ in range(1000):
        known = follow(known, 1.0)
    assert known == pytest.approx(PRIOR)


def test_a_zero_error_says_nothing_of_slow_ones():
    zeros = MODEL.bias_at[2, :3]
    found = follow(PRIOR, 10.0, dict.fromkeys(zeros, 50.0), dict.fromkeys(zeros, 0.0))
    assert found == pytest.approx(PRIOR)


def test_what_was_learned_is_forgotten_by_data_time_and_not_by_calls():
    known = PRIOR.copy()
    known[:, 1] = 2.0, 5.0 + LEAST
    half_s = adaptation.SLOW_MEMORY_S * np.log(2.0)
    later = follow(known, half_s)
    assert later[1, 1] == pytest.approx(2.5 + LEAST)
    assert later[0, 1] == pytest.approx(2.0 * 0.5 * (5.0 + LEAST) / (2.5 + LEAST))
    twice = follow(follow(known, 0.3 * half_s), 0.7 * half_s)
    assert twice == pytest.approx(later)
    assert follow(known, 1e5) == pytest.approx(PRIOR)


def test_a_step_has_a_longest_and_the_factor_has_bounds():
    huge, sure, nothing = dict.fromkeys(A, 1e9), dict.fromkeys(A, 0.0), dict.fromkeys(A, 0.0)
    once = follow(PRIOR, 1.0, huge, sure)
    assert once[0, 1] == adaptation.MOTION_STEP
    up = down = PRIOR
    for _ in range(100):
        up, down = follow(up, 10.0, huge, sure), follow(down, 1e3, nothing, sure)
    low, high = adaptation.SLOW_RANGE
    assert up[0, 1] == high
    assert low <= down[0, 1] < -3.0


# ---- by simulation


def learned(size, seed=0, seconds=600.0, hz=20.0, rows=5):
    """(k,) log factor of a range whose slow error is ``size`` times its noise, after each call.

    The target is known, so its filter has one state; the factor is that learned, every ``rows`` rows.
    """
    rng, known, dt = np.random.default_rng(seed), PRIOR, 1.0 / hz
    at, noise, prior = A[0], 2.0**2, MODEL.prior[A[0]]
    keep = np.exp(-dt / theodolite.SLOW_TAU_S)
    error, x, P, out = size * 2.0 * rng.normal(), 0.0, prior, []
    for k in range(1, round(seconds * hz) + 1):
        error = keep * error + size * 2.0 * np.sqrt(1.0 - keep**2) * rng.normal()
        P = keep**2 * P + (1.0 - keep**2) * np.exp(known[0, 1]) * prior
        gain = P / (P + noise)
        x, P = keep * x + gain * (error + 2.0 * rng.normal() - keep * x), (1.0 - gain) * P
        if k % rows == 0:
            known = follow(known, rows * dt, {at: x}, {at: P})
            out.append(known[0, 1])
    return np.array(out)


@pytest.mark.parametrize("seed", range(3))
@pytest.mark.parametrize("size", [0.3, 1.0, 3.0, 10.0])
def test_the_size_of_slow_errors_is_learned_up_and_down(size, seed):
    assert learned(size, seed)[-1] == pytest.approx(np.log(size**2), abs=0.7)


@pytest.mark.parametrize("size", [0.0, 0.1])
def test_errors_that_drown_in_the_noise_are_known_to_be_small(size):
    """To a tenth of the noise the mean of ten seconds is known: nothing smaller can be seen."""
    found = learned(size)
    assert -5.0 < found[-1] < -3.0
    assert (np.diff(found[::60]) < 0.1).all()


def test_a_few_minutes_are_enough():
    """Within a factor of two of the sigma after two minutes."""
    for size in (0.3, 3.0):
        ends = [learned(size, seed, seconds=120.0)[-1] for seed in range(4)]
        assert np.abs(np.array(ends) - np.log(size**2)).max() < np.log(4.0)


# ---- how they are used


def test_the_factor_drives_the_motion_of_the_errors():
    densities = motion.densities(motion.PSD, adaptation.slow_factors(PRIOR + np.log(4.0), MODEL))
    assert len(densities) == len(MODEL.prior) - 5
    x, P = np.zeros(len(MODEL.prior)), np.zeros((len(MODEL.prior),) * 2)
    motion.predict(x, P, 1e3, densities, MODEL.rate, MODEL.prior)
    for channel in (RANGE, AZIMUTH, ELEVATION):
        a, zero = MODEL.bias_at[1, channel], MODEL.bias_at[2, channel]
        assert P[a, a] == pytest.approx(4.0 * MODEL.prior[a])
        assert P[zero, zero] <= MODEL.prior[zero]
