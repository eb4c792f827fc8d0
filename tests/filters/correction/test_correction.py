"""The network at work, against the same formulas written with matrices."""

import numpy as np
import pytest

from filters.correction import correction
from filters.correction.correction import Network


def network(seed=0, hidden=7, limit=3.0):
    weights = np.random.default_rng(seed).normal(0.0, 0.5, correction.length(hidden))
    return Network(*correction.unpack(weights, hidden), np.full(9, limit), np.linspace(0.2, 1.0, 9))


def states(seed=1, n=12):
    rng = np.random.default_rng(seed)
    x0 = rng.normal(0.0, 10.0, n)
    A, B = rng.normal(size=(2, n, n))
    P0 = A @ A.T + np.eye(n)
    P1 = P0 - 0.5 * P0 @ np.linalg.inv(P0 + B @ B.T) @ P0
    x1 = x0 + 0.3 * rng.normal(size=n) * np.sqrt(np.diag(P0))
    return x0, P0, x1, P1


def matrix(x):
    """(9, 9) station ENU → along-track, right, up."""
    course = np.arctan2(x[3], x[4])
    T = np.array([[np.sin(course), np.cos(course), 0], [np.cos(course), -np.sin(course), 0], [0, 0, 1]])
    return np.kron(np.eye(3), T)


def by_matrices(net, x0, P0, x1, P1):
    T = matrix(x0)
    u = T @ (x1 - x0)[:9] / np.sqrt(np.diag(T @ P0[:9, :9] @ T.T))
    fade = np.clip(2.0 - np.max(np.abs(u) / net.limit), 0.0, 1.0)
    e = fade * net.gain * (net.w2 @ np.tanh(net.w1 @ u + net.b1) + net.b2)
    return x1[:9] + T.T @ (e * np.sqrt(np.diag(T @ P1[:9, :9] @ T.T)))


@pytest.mark.parametrize("seed", range(5))
def test_correction_is_the_formula(seed):
    net, case = network(seed), states(seed)
    np.testing.assert_allclose(correction.Correction(net)(*case), by_matrices(net, *case), rtol=1e-9)


def test_samples_say_what_is_missing():
    x0, P0, x1, P1 = states()
    truth = np.random.default_rng(3).normal(0.0, 10.0, 9)
    u, e = correction.samples(x0[None], P0[None], x1[None], P1[None], truth[None])
    T = matrix(x0)
    sigma = np.sqrt(np.diag(T @ P1[:9, :9] @ T.T))
    np.testing.assert_allclose(x1[:9] + T.T @ (e[0] * sigma), truth, rtol=1e-9)
    np.testing.assert_allclose(correction.sigmas_of(x0[None], P1[None])[0], sigma, rtol=1e-12)
    assert u.shape == (1, 9)


def test_correction_does_not_know_north_or_the_unit():
    """Turned about the vertical and made k times larger, the same flight gets the same correction."""
    net, (x0, P0, x1, P1) = network(), states(n=9)
    angle, k = 1.1, 3.0
    turn = np.array([[np.cos(angle), -np.sin(angle), 0], [np.sin(angle), np.cos(angle), 0], [0, 0, 1]])
    G = k * np.kron(np.eye(3), turn)
    plain = correction.Correction(net)(x0, P0, x1, P1).copy()
    np.testing.assert_allclose(
        correction.Correction(net)(G @ x0, G @ P0 @ G.T, G @ x1, G @ P1 @ G.T), G @ plain, rtol=1e-9
    )


@pytest.mark.parametrize(("times", "left"), [(0.99, 1.0), (1.5, 0.5), (2.0, 0.0), (50.0, 0.0)])
def test_correction_fades_out_beyond_what_was_seen(times, left):
    net = network(limit=3.0)._replace(w1=np.zeros((7, 9)))  # the same answer to everything
    u, e, inside = np.zeros(9), np.empty(9), np.empty(9)
    correction.respond(net, u, inside)
    u[4] = -3.0 * times
    correction.respond(net, u, e)
    np.testing.assert_allclose(e, left * inside, rtol=1e-9, atol=1e-12)


def test_a_target_at_rest_has_a_correction():
    x0, P0, x1, P1 = states()
    x0[3:5] = 0.0
    assert np.isfinite(correction.Correction(network())(x0, P0, x1, P1)).all()


def test_off_changes_nothing():
    x0, P0, x1, P1 = states()
    assert correction.off(x0, P0, x1, P1) is x1
