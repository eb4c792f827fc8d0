"""One update against the textbook in matrices, the weights against their closed form."""

import numpy as np
import pytest

from filters.models.update import spread, update, weight

pytestmark = pytest.mark.decision


def test_update_is_the_textbooks():
    rng = np.random.default_rng(0)
    root = rng.normal(size=(5, 5))
    x, P, h, R, v = rng.normal(size=5), root @ root.T, rng.normal(size=5), 0.3, 1.7
    S = h @ P @ h + R
    K = P @ h / S
    left = np.eye(5) - np.outer(K, h)
    mine_x, mine_P = x.copy(), P.copy()
    update(mine_x, mine_P, P @ h, v, S)
    assert np.allclose(mine_x, x + K * v, rtol=1e-12)
    assert np.allclose(mine_P, left @ P @ left.T + R * np.outer(K, K), rtol=1e-10)  # Joseph's form


def test_the_covariance_stays_symmetric_to_the_last_bit():
    rng = np.random.default_rng(1)
    root = rng.normal(size=(7, 7))
    P = root @ root.T
    P = (P + P.T) / 2
    for _ in range(50):
        h = rng.normal(size=7)
        m = P @ h
        update(np.zeros(7), P, m, 1.0, h @ m + 1e-3)
    assert np.array_equal(P, P.T)


def test_a_value_without_weight_changes_nothing():
    x, P = np.ones(3), np.eye(3)
    update(x, P, np.ones(3), 5.0, np.inf)
    assert np.array_equal(x, np.ones(3))
    assert np.array_equal(P, np.eye(3))


@pytest.mark.parametrize("w", [0.0, 0.2, 0.5, 1.0])
def test_the_spread_of_an_innovation_is_that_of_a_mixture(w):
    """Of two states, with and without the row, about their mean."""
    rng = np.random.default_rng(3)
    P, m, v, S = np.eye(4), rng.normal(size=4), 3.0, 2.5
    moved = m / S * v
    about = w * moved
    expected = w * np.outer(moved - about, moved - about) + (1 - w) * np.outer(about, about)
    spread(P, m, v, S, w)
    assert np.allclose(P - np.eye(4), expected)
    assert np.array_equal(P, P.T)


@pytest.mark.parametrize(
    ("u", "expected"), [(0, 1), (1.5, 1), (8.5, 0), (100, 0), (5.0, 0.3 * 0.25), (-5.0, 0.3 * 0.25)]
)
def test_igg_iii(u, expected):
    assert weight(float(u), 1.5, 8.5) == pytest.approx(expected)


def test_weights_are_continuous_and_go_down():
    u = np.linspace(0.0, 10.0, 1001)
    w = np.array([weight(value, 2.0, 8.0) for value in u])
    assert (np.diff(w) <= 0).all()
    assert np.abs(np.diff(w)).max() < 0.02


def test_special_cases_are_no_rule_and_a_gate():
    assert weight(1e9, np.inf, np.inf) == 1.0
    assert [weight(u, 4.0, 4.0) for u in (3.999, 4.001)] == [1.0, 0.0]
