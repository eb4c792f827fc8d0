"""The motion against Van Loan's matrix exponential, its transpose, and draws of white noise."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from filters.models import motion
from filters.models.motion import CORE, MOTIONS
from filters.models.state import build
from tests.filters.smoother.kit import small

pytestmark = pytest.mark.decision

MODEL = build(
    [
        small.ins(clock_sigma_s=0.1),
        small.theodolite(estimate=("bias", "clock")),
        small.radar(slow=1.0),
        small.theodolite(estimate=("bias",), slow=0.5),
    ]
)
N = len(MODEL.prior)
DENSITIES = small.densities(MODEL, factor=np.geomspace(0.05, 30.0, N - CORE))
STEPS = [1e-3, 0.05, 0.3, 2.0, 30.0, 100.0]


def some_state(seed):
    rng = np.random.default_rng(seed)
    root = rng.normal(size=(N, N))
    return rng.normal(scale=10.0, size=N), root @ root.T


@pytest.mark.parametrize("dt", STEPS)
def test_predict_equals_van_loan(dt):
    x, P = some_state(0)
    F, Q = small.transition(dt, DENSITIES, MODEL)
    moved, spread = x.copy(), P.copy()
    motion.predict(moved, spread, dt, DENSITIES, MODEL.rate, MODEL.prior)
    assert np.allclose(moved, F @ x, rtol=1e-10, atol=1e-9)
    expected = F @ P @ F.T + Q
    scale = np.sqrt(np.outer(np.diag(expected), np.diag(expected)))
    assert (np.abs(spread - expected) <= 1e-7 * scale).all()
    assert np.array_equal(spread[:CORE, :CORE], spread[:CORE, :CORE].T)


@pytest.mark.parametrize("dt", STEPS[:4])
def test_drift_is_the_variance_of_what_nobody_expects(dt):
    _, P = some_state(3)
    F, Q = small.transition(dt, DENSITIES, MODEL)
    expected = np.diag((F - np.eye(N)) @ P @ (F - np.eye(N)).T + Q)
    assert [motion.drift(P, DENSITIES, i, dt) for i in range(CORE)] == pytest.approx(expected[:CORE])


@pytest.mark.parametrize("dt", STEPS)
def test_the_noise_is_a_covariance(dt):
    P = np.zeros((N, N))
    motion.predict(np.zeros(N), P, dt, DENSITIES, MODEL.rate, MODEL.prior)
    sigma = np.sqrt(np.diag(P))
    used = sigma > 0
    assert used[:CORE].all()
    assert np.array_equal(P, P.T)
    assert np.linalg.eigvalsh(P[np.ix_(used, used)] / np.outer(sigma[used], sigma[used])).min() > -1e-12


def test_no_time_changes_nothing():
    x, P = some_state(1)
    moved, spread = x.copy(), P.copy()
    motion.predict(moved, spread, 0.0, DENSITIES, MODEL.rate, MODEL.prior)
    assert np.array_equal(moved, x)
    assert np.allclose(spread, P)


def test_two_steps_are_one():
    x, P = some_state(2)
    y, Q = x.copy(), P.copy()
    motion.predict(x, P, 0.7, DENSITIES, MODEL.rate, MODEL.prior)
    for dt in (0.2, 0.5):
        motion.predict(y, Q, dt, DENSITIES, MODEL.rate, MODEL.prior)
    assert np.allclose(x, y, rtol=1e-12)
    assert np.allclose(P, Q, rtol=1e-9)


def test_errors_go_back_to_their_prior_times_its_factor():
    x, P = some_state(3)
    motion.predict(x, P, 3600.0, DENSITIES, MODEL.rate, MODEL.prior)
    fading = np.flatnonzero(MODEL.rate > 1e-3)
    assert np.allclose(x[fading], 0.0, atol=1e-9)
    factor = DENSITIES[motion.MOTIONS :]
    assert np.allclose(np.diag(P)[fading], factor[fading - CORE] * MODEL.prior[fading])
    constant = CORE + np.flatnonzero(MODEL.rate[CORE:] == 0.0)
    assert np.array_equal(x[constant], some_state(3)[0][constant])


@pytest.mark.parametrize("dt", STEPS)
def test_pull_back_is_the_transpose(dt):
    F, _ = small.transition(dt, DENSITIES, MODEL)
    r, M = some_state(4)
    back, back_N = r.copy(), M.copy()
    motion.pull_back(back, back_N, dt, MODEL.rate)
    assert np.allclose(back, F.T @ r, rtol=1e-9, atol=1e-9)
    expected = F.T @ M @ F
    assert np.allclose(back_N, expected, rtol=1e-9, atol=1e-9 * np.abs(expected).max())


@settings(deadline=None, derandomize=True, max_examples=30)
@given(st.floats(1e-3, 100.0), st.integers(0, 1000))
def test_pull_back_keeps_every_product(dt, seed):
    """rᵀ (F x) = (Fᵀ r)ᵀ x, F by `predict` itself."""
    rng = np.random.default_rng(seed)
    x, r, M = rng.normal(size=N), rng.normal(size=N), np.zeros((N, N))
    moved, back = x.copy(), r.copy()
    motion.predict(moved, np.zeros((N, N)), dt, DENSITIES, MODEL.rate, MODEL.prior)
    motion.pull_back(back, M, dt, MODEL.rate)
    terms = np.abs(r) @ np.abs(moved) + np.abs(back) @ np.abs(x)
    assert abs(r @ moved - back @ x) <= 1e-12 * terms


def test_score_of_an_error_is_the_trace_formula():
    """Of one state: Q is the variance that a step of its Gauss-Markov process adds."""
    rng, dt, n = np.random.default_rng(5), 0.3, CORE + 3
    M = rng.normal(size=(n, n))
    M, r = M @ M.T, rng.normal(size=n)
    rate, variance, factor = np.zeros(n), np.zeros(n), np.array([2.0, 1.0, 5.0])
    rate[CORE:], variance[CORE:] = [0.5, 0.0, 2.0], [4.0, 9.0, 0.1]
    psd, found = np.concatenate([np.ones(MOTIONS), factor]), np.zeros((2, 3))
    motion.score_errors(r, M, dt, psd, rate, variance, found)
    Q = factor * variance[CORE:] * (1.0 - np.exp(-2.0 * rate[CORE:] * dt))
    seen = np.diag(M)[CORE:]
    assert found[0] == pytest.approx(0.5 * Q * (r[CORE:] ** 2 - seen))
    assert found[1] == pytest.approx(0.5 * (Q * seen) ** 2)


def test_a_height_that_is_told_is_forgotten_up_to_what_was_told():
    rate, prior = np.zeros(CORE), np.zeros(CORE)
    rate[2], prior[2] = 0.1, 25.0
    x, P = np.arange(CORE, dtype=float), np.zeros((CORE, CORE))
    x[5] = x[8] = 0.0
    found = []
    for _ in range(3):
        motion.predict(x, P, 2.0, np.zeros(MOTIONS), rate, prior)
        found.append(P[2, 2])
    assert found == pytest.approx([10.0, 20.0, 25.0])
    P[2, 2] = 100.0  # a start that is not told yet
    motion.predict(x, P, 2.0, np.zeros(MOTIONS), rate, prior)
    assert P[2, 2] == pytest.approx(100.0)
    assert x[2] == 2.0


def test_score_is_the_trace_formula():
    rng = np.random.default_rng(5)
    root = rng.normal(size=(N, N))
    r, M, dt = rng.normal(size=N), root @ root.T, 0.4
    slope, information = found = np.zeros((2, 4))
    motion.score(r, M, dt, DENSITIES, found)
    for j in range(4):
        one = np.where(np.arange(4) == j, small.PSD, 0.0)
        _, Q = small.transition(dt, one)
        n = M[:CORE, :CORE]
        assert slope[j] == pytest.approx(0.5 * (r[:CORE] @ Q @ r[:CORE] - np.trace(Q @ n)), rel=1e-9)
        per_axis = sum(
            0.5 * np.trace(np.linalg.matrix_power(Q[a][:, a] @ n[a][:, a], 2))
            for a in ([i, i + 3, i + 6] for i in range(3))
        )
        assert information[j] == pytest.approx(per_axis, rel=1e-9)
