"""How large an INS's errors are: up by what the rows say, back to the prior, never below it."""

import numpy as np
import pytest

from filters import methods
from filters.models import state
from filters.models.motion import CORE
from filters.smoother import adaptation, passes
from tests.filters.smoother.kit import small
from tests.filters.smoother.kit.flights import error_m

pytestmark = pytest.mark.decision

SENSORS = [small.ins(), small.theodolite("a", slow=1.0), small.theodolite("b", (900.0, 900.0, 0.0))]
MODEL = state.build(SENSORS)
N_STATES = len(MODEL.prior)
PRIOR = adaptation.ins_prior(N_STATES)
EAST = MODEL.bias_at[0, 4] - CORE
LEAST = adaptation.SLOW_SIGMA**-2


def told(slope=0.0, information=0.0, at=EAST):
    found = passes.scores(N_STATES)
    found.errors[0, at], found.errors[1, at] = slope, information
    return found


def test_a_step_is_slope_over_information_and_the_prior_is_one():
    mean, information = adaptation.follow_ins(PRIOR, MODEL, told(0.3, 1.0), 0.25)
    assert information[EAST] == pytest.approx(LEAST + 1.0)
    assert mean[EAST] == pytest.approx(0.3 / (LEAST + 1.0))
    assert not np.delete(mean, EAST).any()


def test_it_never_says_that_an_ins_is_better_than_its_prior():
    assert not adaptation.follow_ins(PRIOR, MODEL, told(-5.0, 1.0), 0.25)[0].any()


def test_a_step_has_a_longest():
    assert adaptation.follow_ins(PRIOR, MODEL, told(1e6, 1.0), 0.25)[0, EAST] == adaptation.MOTION_STEP


def test_what_was_learned_is_forgotten():
    known = adaptation.follow_ins(PRIOR, MODEL, told(3.0, 10.0), 0.25)
    for _ in range(400):
        known = adaptation.follow_ins(known, MODEL, told(), 1.0)
    assert known == pytest.approx(PRIOR, abs=1e-3)


def test_of_instruments_and_clocks_nothing_is_learned():
    others = np.setdiff1d(np.arange(N_STATES - CORE), MODEL.bias_at[0][MODEL.bias_at[0] >= 0] - CORE)
    known = adaptation.follow_ins(PRIOR, MODEL, told(5.0, 1.0, others), 0.25)
    assert np.array_equal(known[:, others], PRIOR[:, others])


def test_an_ins_without_its_gps_leads_nobody_away():
    """It drifts off by 0.06 m/s², as slowly as an error of its own: two theodolites know better."""
    rows = small.fly(SENSORS, 30.0, seed=2)
    t_s = rows["t_ns"] * 1e-9
    since = np.maximum(t_s - 8.0, 0.0)
    own = rows["sensor"] == 0
    rows["value"][own & (rows["channel"] == 4)] += (0.03 * since**2)[own & (rows["channel"] == 4)]
    rows["value"][own & (rows["channel"] == 7)] += (0.06 * since)[own & (rows["channel"] == 7)]
    one = methods.make("default", SENSORS)
    track = one.step(rows).track
    late = track["t_ns"] > 25e9
    assert np.exp(one._now.best.ins[0, EAST]) > 2.0
    off = track["x"][late, 0] - small.truth(track["t_ns"][late] * 1e-9)[0][:, 0]
    assert np.abs(off / np.sqrt(track["P"][late, 0, 0])).mean() < 1.5
    assert np.median(error_m(track[late])) < 1.0
