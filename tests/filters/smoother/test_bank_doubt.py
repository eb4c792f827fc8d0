"""Doubt between hypotheses: apart or not, and what a likely other one leaves in spread and ``ambiguous``."""

from types import SimpleNamespace

import numpy as np
import pytest

from filters.smoother.bank import apart
from tests.filters.smoother.test_bank import A, B, ambiguous, begun

pytestmark = pytest.mark.decision


def trial(at, sigma=1.0):
    """A hypothesis, as far as doubt looks at it."""
    return SimpleNamespace(
        head=SimpleNamespace(x=np.append(np.array(at, float), np.zeros(6)), P=np.eye(9) * sigma**2)
    )


def doubt(*ranked):
    one, _, _ = begun([A, B])
    one._doubt(ranked[0][1], ranked[0][0], list(ranked))
    return one


def test_apart_is_by_both_sigmas():
    assert not apart(trial((0, 0, 0)), trial((4.0, 0, 0)))
    assert apart(trial((0, 0, 0)), trial((4.5, 0, 0)))
    assert not apart(trial((0, 0, 0)), trial((4.5, 0, 0), sigma=2.0))


def test_an_unlikely_or_a_near_hypothesis_leaves_no_doubt():
    assert not ambiguous(doubt((0.0, trial((0, 0, 0))), (-1.0, trial((1, 0, 0)))))
    far = doubt((0.0, trial((0, 0, 0))), (-200.0, trial((100, 0, 0))))
    assert not ambiguous(far)
    assert far.spread[0, 0] < 1e-6


def test_a_likely_one_elsewhere_leaves_its_spread():
    one = doubt((0.0, trial((0, 0, 0))), (0.0, trial((100, 0, 0))))
    assert ambiguous(one)
    assert one.spread[0, 0] == pytest.approx(0.5 * 100.0**2)  # Σ chance · gap²
    assert not one.spread[1:, 1:].any()
    less = doubt((0.0, trial((0, 0, 0))), (-5.0, trial((100, 0, 0))))
    assert 0 < less.spread[0, 0] < one.spread[0, 0]
