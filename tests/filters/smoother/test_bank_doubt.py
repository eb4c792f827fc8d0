"""Doubt between hypotheses: apart or not, and what a likely other one leaves in spread and ``ambiguous``."""

from types import SimpleNamespace

import numpy as np
import pytest

from filters.smoother.bank import CLOSE, Trial
from filters.smoother.hypothesis import apart, differ
from tests.filters.smoother.test_bank import RADAR, A, B, ambiguous, begun

pytestmark = pytest.mark.decision


def hypothesis(at, sigma=1.0, log_evidence=0.0, refused=0):
    """As far as doubt looks at it; ``refused`` of its ten rows."""
    return SimpleNamespace(
        head=SimpleNamespace(x=np.append(np.array(at, float), np.zeros(6)), P=np.eye(9) * sigma**2),
        own=SimpleNamespace(weight=(np.arange(10) >= refused).astype(float)),
        log_evidence=log_evidence,
    )


def trial(at, log_evidence=0.0, prior=0.0, **more):
    return Trial(prior, hypothesis(at, log_evidence=log_evidence, **more))


def doubt(*ranked):
    one, _, _ = begun([A, B])
    one._doubt(ranked[0], list(ranked))
    return one


def alternative(*ranked, before=None):
    """Who is kept beside the first of ``ranked``; ``before`` are the two till then."""
    one, _, _ = begun([A, B])
    if before:
        one.best, one.alternative = before[0].hypothesis, before[1]
    one._keep_alternative(ranked[0], list(ranked))
    return one.alternative


def test_apart_is_by_both_sigmas():
    assert not apart(hypothesis((0, 0, 0)), hypothesis((4.0, 0, 0)))
    assert apart(hypothesis((0, 0, 0)), hypothesis((4.5, 0, 0)))
    assert not apart(hypothesis((0, 0, 0)), hypothesis((4.5, 0, 0), sigma=2.0))


def test_an_unlikely_or_a_near_hypothesis_leaves_no_doubt():
    assert not ambiguous(doubt(trial((0, 0, 0), 0.0), trial((1, 0, 0), -1.0)))
    far = doubt(trial((0, 0, 0), 0.0), trial((100, 0, 0), -200.0))
    assert not ambiguous(far)
    assert far.spread[0, 0] < 1e-6


def test_a_likely_one_elsewhere_leaves_its_spread():
    one = doubt(trial((0, 0, 0), 0.0), trial((100, 0, 0), 0.0))
    assert ambiguous(one)
    assert one.spread[0, 0] == pytest.approx(0.5 * 100.0**2)  # Σ chance · gap²
    assert not one.spread[1:, 1:].any()
    less = doubt(trial((0, 0, 0), 0.0), trial((100, 0, 0), -5.0))
    assert 0 < less.spread[0, 0] < one.spread[0, 0]


def test_hypotheses_differ_that_judge_a_patch_of_rows_differently():
    assert not differ(hypothesis((0, 0, 0)), hypothesis((9, 0, 0), refused=2))
    assert differ(hypothesis((0, 0, 0)), hypothesis((0, 0, 0), refused=3))


def test_a_close_one_elsewhere_that_judges_differently_lives_on():
    here, there = trial((0, 0, 0)), trial((9, 0, 0), -3.0, refused=4)
    assert alternative(here, there).hypothesis is there.hypothesis
    assert alternative(here) is None
    assert alternative(here, trial((9, 0, 0), -3.0)) is None  # the same judgement
    assert alternative(here, trial((1, 0, 0), -3.0, refused=4)) is None  # the same place
    assert alternative(here, trial((9, 0, 0), -CLOSE - 1.0, refused=4)) is None  # hardly possible


def test_of_several_the_likeliest_lives_on():
    less, more = trial((9, 0, 0), -3.0, refused=4), trial((0, 9, 0), -2.0, refused=5)
    assert alternative(trial((0, 0, 0)), less, more).hypothesis is more.hypothesis


def test_an_alternative_goes_on_where_the_states_have_met_again():
    here, there = trial((0, 0, 0)), trial((0.5, 0, 0), -3.0, refused=4)
    assert alternative(here, there) is None
    assert alternative(here, there, before=(here, there)).hypothesis is there.hypothesis
    assert (
        alternative(there, here, before=(here, there)).hypothesis is here.hypothesis
    )  # it has won meanwhile


def test_prior_odds_are_kept_whoever_wins():
    """A start that wins is the rarer one of the two for good."""
    old, new = trial((0, 0, 0)), trial((9, 0, 0), 8.0, prior=-5.0, refused=4)
    assert alternative(new, old).prior == 5.0
    assert alternative(old, trial((9, 0, 0), 4.0, prior=-5.0, refused=4)).prior == -5.0


@pytest.mark.parametrize(
    ("sensors", "young", "shortfall", "doubted"),
    [
        ([A, B], True, 2.1, True),
        ([A, B], True, 1.9, False),
        ([A, B], False, 2.1, False),
        ([A], True, 2.1, True),
        ([A, B, RADAR], True, 2.1, False),
    ],
)
def test_one_or_two_that_begin_and_misfit_are_in_doubt_and_three_decide(sensors, young, shortfall, doubted):
    one, rows, _ = begun(sensors)
    one.best.young, one.best.shortfall = young, shortfall
    one._confirmed(rows)
    assert one._contradicted == doubted
