"""Densities and noise by scoring: where they go, how fast, and back."""

import numpy as np
import pytest

from filters.models import motion, state
from filters.models.rows import VE, E
from filters.smoother import adaptation, status
from filters.smoother.passes import Scores
from tests.filters.smoother.kit import small
from tests.filters.smoother.test_passes import both

PRIOR = motion.PSD
IS_INS = np.array([True, False])
CLEAN = np.zeros((2, 13))  # chances of an outlier
NOTHING = np.zeros((2, 2, 13))  # scores of no row
MODEL = state.build([small.ins(), small.radar()])


def scores(slope=0.0, information=0.0):
    return Scores(
        np.stack([np.stack([np.full(4, float(slope)), np.full(4, float(information))]), np.zeros((2, 4))]),
        np.zeros((2, 4)),
        np.zeros((2, len(MODEL.prior) - motion.CORE)),
    )


def repeat(now, found, times=60):
    for _ in range(times):
        now = adaptation.densities(now, PRIOR, found)
    return now


def window_of_positions(acceleration, seed=0):
    """(model, rows, x, P) of an INS that stands and is then pushed north."""
    rng = np.random.default_rng(seed)
    model = state.build([small.ins(p=0.2, v=0.1)])
    said = []
    for k in range(30):
        t = 0.1 * k
        moved = max(0.0, t - 1.5)
        p, v = [0.0, 0.5 * acceleration * moved**2, 0.0], [0.0, acceleration * moved, 0.0]
        said += [(t, 0, E + a, p[a] + 0.2 * rng.normal()) for a in range(3)]
        said += [(t, 0, VE + a, v[a] + 0.1 * rng.normal()) for a in range(3)]
    P = state.prior_covariance(model)
    P[range(9), range(9)] = 1.0
    return model, small.as_rows(said, model), np.zeros(len(model.prior)), P


def settle(acceleration, start=PRIOR):
    model, rows, x, P = window_of_positions(acceleration)
    psd = start.copy()
    for _ in range(25):
        psd = adaptation.densities(psd, PRIOR, both(model, rows, x, P, 1.0, psd=psd)[2])
    return psd


def test_densities_go_up_on_a_manoeuvre_where_it_happens():
    calm, hard = settle(0.0), settle(40.0)
    assert hard[0] > 3 * PRIOR[0]
    assert hard[0] > 3 * calm[0]
    assert hard[1] < 2 * PRIOR[1]  # nothing happens in the vertical


def test_where_they_settle_does_not_depend_on_where_they_began():
    wide, slim = settle(10.0, 50.0 * PRIOR), settle(10.0, 0.05 * PRIOR)
    assert np.allclose(np.log(wide), np.log(slim), atol=0.05)


def test_they_settle_where_the_posterior_is_flat():
    """Slope of log likelihood and log prior by differences of the evidence: the maximum of their sum."""
    model, rows, x, P = window_of_positions(10.0)
    psd = settle(10.0)
    H = np.zeros((len(rows.t), len(x)))
    for i, c in enumerate(rows.channel):
        H[i, c - E] = 1.0
        H[i, model.bias_at[0, c]] = 1.0

    def log_posterior(shift):
        now = psd * np.exp(shift)
        off = np.log(now / PRIOR) / adaptation.MOTION_SIGMA
        return small.Dense(model, rows, x, P, now, H).log_density(rows.stated) - 0.5 * off @ off

    for j in range(4):
        h = 1e-3 * np.eye(4)[j]
        slope = (log_posterior(h) - log_posterior(-h)) / 2e-3
        assert abs(slope) < 0.05


@pytest.mark.parametrize("factor", [0.01, 50.0])
def test_without_information_densities_go_back_to_their_prior(factor):
    assert np.allclose(repeat(factor * PRIOR, scores()), PRIOR, rtol=1e-6)


def test_a_step_has_a_longest_and_densities_have_bounds():
    once = adaptation.densities(PRIOR, PRIOR, scores(slope=1e9, information=1e-9))
    assert np.allclose(
        np.log(once / PRIOR), np.minimum(adaptation.MOTION_STEP, np.log(motion.HIGHEST / PRIOR))
    )
    assert np.array_equal(repeat(PRIOR, scores(slope=1e9)), motion.HIGHEST)
    assert np.array_equal(repeat(PRIOR, scores(slope=-1e9)), motion.LOWEST)


# ---- what is usual


def usual(known, psd, slope=0.0, information=0.0, seconds=1.0, regime=0):
    found = scores()
    found.kept[regime] = [[slope] * 4, [information] * 4]
    return adaptation.follow_motion(known, BEFORE, np.array(psd), found, seconds)


BEFORE = adaptation.motion_prior(PRIOR)
TWO = np.array([20.0 * PRIOR, 0.1 * PRIOR])  # densities now, and before a manoeuvre


@pytest.mark.parametrize("regime", [0, 1])
def test_what_is_usual_is_the_mean_of_what_was_seen_by_its_information(regime):
    known = usual(BEFORE, TWO, slope=0.0, information=5.0, regime=regime)
    weight = 5.0 / (5.0 + adaptation.USUAL_SIGMA**-2)
    assert np.allclose(known[0], np.log(PRIOR) + weight * np.log(TWO[regime] / PRIOR))
    assert np.allclose(known[1], 5.0 + adaptation.USUAL_SIGMA**-2)


def test_a_slope_moves_it_as_far_as_its_information_says():
    known = usual(BEFORE, np.array([PRIOR, PRIOR]), slope=1.0, information=4.0)
    assert np.allclose(known[0] - np.log(PRIOR), 1.0 / (4.0 + adaptation.USUAL_SIGMA**-2))


def test_a_quiet_minute_is_forgotten_and_an_hour_leads_back_to_the_setting():
    known = usual(BEFORE, TWO, information=5.0)
    later = usual(known, TWO, seconds=adaptation.MOTION_MEMORY_S * np.log(2.0))
    assert np.allclose(later[1] - BEFORE[1], 2.5)
    assert np.allclose(usual(known, TWO, seconds=3600.0), BEFORE)


def test_what_is_usual_has_bounds_and_what_does_not_move_stays():
    assert np.allclose(usual(BEFORE, TWO, slope=1e6, information=1.0)[0], np.log(motion.HIGHEST))
    level = adaptation.motion_prior(PRIOR * [1, 0, 1, 0])
    found = scores(slope=1.0, information=1.0)
    known = adaptation.follow_motion(level, level, TWO * [1, 0, 1, 0], found, 1.0)
    assert np.array_equal(known[:, [1, 3]], level[:, [1, 3]])
    assert (known[0, [0, 2]] > level[0, [0, 2]]).all()


# ---- noise


def test_before_the_first_row_the_noise_is_as_stated():
    prior = adaptation.noise_prior(IS_INS)
    assert not prior[0].any()
    assert np.allclose(prior[1, 1], adaptation.NOISE_SIGMA**-2)
    assert (prior[1, 0, VE:] < prior[1, 0, E]).all()  # nobody states the vibration


def judged(residual, noise, weight=1.0, sensor=1, channel=0):
    """(rows, outcome) of values of one channel whose prediction is known without error."""
    count = len(residual)
    rows = small.as_rows([(0.1 * k, sensor, channel, 0.0) for k in range(count)], MODEL)
    own = small.fresh(rows)
    own.residual[:], own.noise[:], own.sigma[:], own.weight[:] = residual, noise, np.sqrt(noise), weight
    return rows, own


def learn(variance, rows_per_second=20, seconds=60, seed=0):
    """Log scale of a range whose residuals have ``variance`` times the stated one."""
    rng, prior = np.random.default_rng(seed), adaptation.noise_prior(IS_INS)
    known = prior
    for _ in range(seconds):
        residual = rng.normal(scale=np.sqrt(variance), size=rows_per_second)
        rows, own = judged(residual, np.exp(known[0, 1, 0]))
        seen = adaptation.noise_scores(rows, own, CLEAN, IS_INS)
        known = adaptation.follow_noise(known, prior, seen, 1.0)
    return known


@pytest.mark.parametrize("variance", [0.4, 1.0, 4.0, 20.0])
def test_noise_is_learned_up_and_down(variance):
    known = learn(variance)
    assert known[0, 1, 0] == pytest.approx(np.log(variance), abs=0.45)
    others = np.ones((2, 13), bool)
    others[1, 0] = False
    assert not known[0][others].any()


def test_noise_has_bounds():
    assert learn(1e-4)[0, 1, 0] == adaptation.LOWEST
    assert learn(1e9)[0, 1, 0] == adaptation.HIGHEST


def test_unheard_noise_goes_back_to_its_prior():
    known, prior = learn(9.0), adaptation.noise_prior(IS_INS)
    before = np.abs(known[0]).copy()
    for _ in range(4):
        known = adaptation.follow_noise(known, prior, NOTHING, 10.0)
        assert (np.abs(known[0]) <= before).all()
        before = np.abs(known[0])
    long_after = adaptation.follow_noise(known, prior, NOTHING, 1e4)
    assert np.allclose(long_after[0], 0.0, atol=1e-9)
    assert np.allclose(long_after[1], prior[1])


def test_memory_is_of_data_time_not_of_calls():
    known, prior = learn(9.0), adaptation.noise_prior(IS_INS)
    once = adaptation.follow_noise(known, prior, NOTHING, 8.0)
    twice = adaptation.follow_noise(adaptation.follow_noise(known, prior, NOTHING, 3.0), prior, NOTHING, 5.0)
    assert np.allclose(once, twice)


def test_what_is_learned_is_the_weighted_mean_of_prior_and_data():
    """One quadratic log likelihood of middle μ and information I: posterior μ I / (I + prior's)."""
    prior = adaptation.noise_prior(IS_INS)
    middle, information = 0.8, 7.0
    seen = np.stack([np.full((2, 13), middle * information), np.full((2, 13), information)])
    known = adaptation.follow_noise(prior, prior, seen, 0.0)
    assert np.allclose(known[0], middle * information / (information + prior[1]))
    assert np.allclose(known[1], information + prior[1])


def kept_of_good_rows(p):
    """Mean u² of good rows, weighted by P(good), where an outlier has probability ``p``."""
    u = np.linspace(-12.0, 12.0, 4801)
    good = np.exp(-0.5 * u * u) / np.sqrt(2.0 * np.pi)
    gross = status.WIDTH / np.pi / (status.WIDTH**2 + u * u)
    weight = (1.0 - p) * good / ((1.0 - p) * good + p * gross)
    return (weight * u * u * good).sum() / (weight * good).sum()


@pytest.mark.parametrize("p", [0.005, 0.02, 0.05, 0.1, 0.2])
def test_what_is_missing_of_good_rows_is_that_of_the_integral(p):
    assert 1.0 - adaptation.missing(p) == pytest.approx(kept_of_good_rows(p), abs=0.002)


def test_noise_is_not_learned_too_small_where_the_large_residuals_count_for_outliers():
    """Good rows as stated in a channel with many outliers: they lose some of their own."""
    prior, chance, u = adaptation.noise_prior(IS_INS), np.full((2, 13), 0.15), np.linspace(-4.0, 4.0, 801)
    good, gross = np.exp(-0.5 * u * u) / np.sqrt(2 * np.pi), status.WIDTH / np.pi / (status.WIDTH**2 + u * u)
    residual = np.repeat(u, np.round(200 * good).astype(int))
    weight = np.repeat(0.85 * good / (0.85 * good + 0.15 * gross), np.round(200 * good).astype(int))
    rows, own = judged(residual, 1.0, weight)

    def learned(chance):
        seen = adaptation.noise_scores(rows, own, chance, IS_INS)
        return adaptation.follow_noise(prior, prior, seen, 1.0)[0, 1, 0]

    assert learned(chance) == pytest.approx(0.0, abs=0.01)
    assert learned(CLEAN) < -0.06


def test_a_gross_error_that_is_hardly_good_hardly_counts():
    """What the window has found to be wrong does not widen the noise, however large it is."""
    residual, weight = np.append(np.zeros(40), 2000.0), np.append(np.ones(40), 0.0)
    seen = adaptation.noise_scores(*judged(residual, 1.0, weight), CLEAN, IS_INS)
    assert seen[0, 1, 0] == -20.0


def test_a_refused_vibration_of_an_ins_counts_as_a_large_one():
    rows, own = judged(np.array([2.0, 40.0]), 1.0, 0.0, sensor=0, channel=VE)
    seen = adaptation.noise_scores(rows, own, CLEAN, IS_INS)
    assert seen[:, 0, VE].tolist() == [0.5 * (4.0 - 1.0) + 0.5 * (adaptation.CLIPPED**2 - 1.0), 1.0]
    rows, own = judged(np.array([2.0, 40.0]), 1.0, 0.0, sensor=0, channel=E)
    assert not adaptation.noise_scores(rows, own, CLEAN, IS_INS).any()


def test_the_slope_by_the_noise_is_that_of_the_log_likelihood():
    """Of all rows together. Information is never more than Fisher's."""
    model, rows, x, P, H = small.linear_case(4)
    own, *_ = both(model, rows, x, P, 1.0)
    seen = adaptation.noise_scores(rows, own, np.zeros(model.variance.shape), model.is_ins)
    dense, h = small.Dense(model, rows, x, P, small.PSD, H), 1e-3
    for c in np.unique(rows.channel):
        mine = rows.channel == c
        noises = [own.noise * np.exp(sign * h * mine) for sign in (1, -1)]
        up, down = (dense.log_density(noise) for noise in noises)
        assert seen[0, 0, c] == pytest.approx((up - down) / (2 * h), abs=2e-5)
        S, moved = dense.rows(own.noise)[1], np.subtract(*(dense.rows(noise)[1] for noise in noises))
        A = np.linalg.solve(S, moved / (2 * h))
        assert 0.0 < seen[1, 0, c] <= 0.5 * np.trace(A @ A) * (1 + 1e-6)
