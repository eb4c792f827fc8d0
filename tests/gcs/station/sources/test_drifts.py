"""Slopes of clocks: what a line tells, who drifts by vote, and from when to when."""

import numpy as np
import pytest

from gcs.station.sources import drifts
from gcs.station.sources.courses import FINE_NS, Path, S, Sightings, cut

RNG = np.random.default_rng(2)


def at(t_s):
    return np.column_stack([500.0 * np.sin(t_s / 15.0), 500.0 * np.cos(t_s / 11.0), 100.0 + 0.0 * t_s])


def lines(rate, zero=(0.0, 0.0, 0.0)):
    """Of a source ten times a second for a minute, with zero errors, against a path without any."""
    t_s = np.arange(0.0, 60.0, 0.1)
    true_ns = np.rint(t_s * S).astype(np.int64)
    stamps = true_ns + np.rint(rate * t_s * S).astype(np.int64)
    sightings = Sightings(stamps, at(t_s) + RNG.normal(size=(600, 3)) + zero, np.ones(3), polar=False)
    pieces = cut(stamps)
    course_ns = FINE_NS * np.round(rate * pieces.t_ns / FINE_NS)
    return drifts.lines(Path(true_ns, at(t_s)), sightings, pieces, course_ns, 0, np.array([0, 10, 20]))


@pytest.mark.parametrize("rate", [0.0, 0.01, -0.01])
@pytest.mark.parametrize("zero", [(0.0, 0.0, 0.0), (3.0, -2.0, 1.0)])
def test_the_slope_of_a_line_is_the_clocks_rate_whatever_the_zero_errors(rate, zero):
    told = lines(rate, zero)
    assert (np.abs(told.slope - rate) < 4.0 * told.sigma + 0.0005).all()
    assert (told.sigma < 0.001).all()


def vote(slopes, votes):
    """Who drifts, of sources whose slopes against one another are differences of their own."""
    own = np.array(slopes)
    apart = (own[:, None] - own)[..., None]
    np.einsum("iij->ij", apart)[:] = np.nan
    sigma = np.where(np.isnan(apart), np.nan, 0.0003)
    return drifts.drifting(apart, sigma, np.full_like(apart, 0.006), np.array(votes))[:, 0].tolist()


def test_one_that_all_others_see_drift_does():
    assert vote([0.0, 0.01, 0.0, 0.0], [0.5, 1, 1, 1]) == [False, True, False, False]
    assert vote([0.0, 0.01, 0.0], [0.5, 1, 1]) == [False, True, False]


def test_of_two_nobody_drifts():
    assert vote([0.0, 0.01], [0.5, 1]) == [False, False]
    assert vote([0.0, 0.01], [1, 1]) == [False, False]


def test_an_aircraft_that_is_apart_accuses_nobody():
    assert vote([0.01, 0.0, 0.0], [0.5, 1, 1]) == [True, False, False]


def test_who_cannot_tell_has_no_say():
    slope = np.full((3, 3, 1), np.nan)
    slope[0, 1] = slope[1, 0] = 0.01
    sigma = np.where(np.isnan(slope), np.nan, 0.0003)
    assert not drifts.drifting(slope, sigma, np.full_like(slope, 0.006), np.ones(3)).any()


def series(offset):
    """Lines as told by offsets (k,) twice a second."""
    t_s = np.arange(0.0, 100.0, 0.5)
    off_s = offset(t_s) + RNG.normal(scale=0.01, size=len(t_s))
    off_s[[30, 77, 140]] += 3.0
    return drifts.ClockLines(t_s, off_s, np.full(len(t_s), 1e4), *np.zeros((3, 0)))


def test_a_drift_begins_at_the_bend_and_ends_at_the_jump():
    told = series(lambda t: 0.05 + np.where((t >= 40) & (t < 70), 0.01 * (t - 40), 0.0))
    ((begin_s, end_s),) = drifts.spans(np.arange(30, 62, 2), told)
    assert abs(begin_s - 40.0) < 5.0
    assert 69.9 < end_s < 70.6


def test_one_without_a_beginning_or_an_end_is_the_whole():
    told = series(lambda t: 0.01 * t)
    assert list(drifts.spans(np.arange(0, 82, 2), told)) == [(-20.0, 120.0)]


def test_what_turns_out_to_be_no_line_is_no_drift():
    assert list(drifts.spans(np.array([20]), series(lambda t: 0.0 * t))) == []
