"""What a sensor has said since its clock went wrong: afterwards all is as if it had not been said."""

import numpy as np
import pytest

from filters.models.settings import Settings
from filters.smoother.estimator import FixedLagSmoother
from filters.smoother.snapshots import KEPT, WrongClock
from tests.filters.smoother.kit import small
from tests.filters.smoother.kit.flights import SENSORS

S = 1_000_000_000
BEGIN_S, FOUND_S, END_S = 5.0, 9.0, 12.0  # of a drift of 2 %, until it is refused; of the flight
DRIFTS = [SENSORS[0], SENSORS[1]._replace(estimate=("clock",)), SENSORS[2]._replace(slow=1.0)]


@pytest.fixture(scope="module")
def flown():
    return small.fly(DRIFTS, END_S)


def drifting(flown):
    """``flown`` with rows of sensor 1 by a clock that drifts, then none."""
    lied, mine = flown.copy(), flown["sensor"] == 1
    lied["t_ns"][mine] += np.maximum(flown["t_ns"][mine] - round(BEGIN_S * S), 0) // 50
    lied = lied[~mine | (flown["t_ns"] < FOUND_S * S)]
    return lied[np.argsort(lied["t_ns"], kind="stable")]


def newest_ns(rows):
    return int(rows["t_ns"][rows["sensor"] == 1].max())


def follow(rows, wrong=(), arrival_ns=None, sensors=DRIFTS):
    """The estimator after ``rows``, told of each of ``wrong`` when its newest row has come."""
    arrival_ns = rows["t_ns"] if arrival_ns is None else arrival_ns
    estimator, wrong = FixedLagSmoother(sensors, Settings()), list(wrong)
    order = np.argsort(arrival_ns, kind="stable")
    for k in range(round(END_S * 10) + 7):
        now = order[(arrival_ns[order] >= k * S // 10) & (arrival_ns[order] < (k + 1) * S // 10)]
        while wrong and wrong[0].newest_ns < k * S // 10:
            estimator.take_back(1, wrong.pop(0))
        estimator.step(rows[now])
    return estimator


def sigmas_apart(one, other):
    """(n,) between the heads of two estimators."""
    a, b = one._now.best.head, other._now.best.head
    return np.abs(a.x - b.x) / np.sqrt(np.diag(b.P))


def test_after_it_all_is_as_if_the_sensor_had_been_silent_since(flown):
    lied = drifting(flown)
    silent = follow(flown[(flown["sensor"] != 1) | (flown["t_ns"] < (BEGIN_S - 1.0) * S)])
    as_it_was = follow(lied)
    taken = follow(lied, [WrongClock(round((BEGIN_S - 1.0) * S), newest_ns(lied))])
    assert sigmas_apart(as_it_was, silent).max() > 2.0
    assert sigmas_apart(taken, silent).max() < 0.7
    variance, should = (np.diag(one._now.best.head.P) for one in (taken, silent))
    np.testing.assert_allclose(variance, should, rtol=0.5)


def test_every_bank_has_a_covariance_and_keeps_to_its_sensors(flown):
    lied = drifting(flown)
    taken = follow(lied, [WrongClock(round((BEGIN_S - 1.0) * S), newest_ns(lied), 0.01)])
    clock = taken.model.clock_at[1]
    for bank in taken._now.banks:
        assert np.linalg.eigvalsh(bank.best.head.P)[0] > -1e-9
        if bank.excluded == 1:
            assert bank.best.head.x[clock] == 0.0


@pytest.mark.parametrize("moved_s", [0.0, 0.03, np.inf])
def test_once_it_is_right_again_it_is_as_unsure_as_it_has_moved(flown, moved_s):
    lied = drifting(flown)
    found = WrongClock(round((BEGIN_S - 1.0) * S), newest_ns(lied))
    estimator = follow(lied, [found])
    clock, prior = estimator.model.clock_at[1], estimator.model.prior[estimator.model.clock_at[1]]
    before = estimator._now.best.head.P[clock, clock]
    estimator.take_back(1, found._replace(moved_s=moved_s))
    for where in (estimator._now.best.head, estimator._now.best.anchor):
        assert where.P[clock, clock] - before == pytest.approx(min(moved_s**2, prior), rel=0.1, abs=1e-5)


def test_who_was_never_right_is_as_unsure_as_before_the_first_row(flown):
    lied = drifting(flown)
    estimator = follow(lied, [WrongClock(-S, newest_ns(lied))])
    clock = estimator.model.clock_at[1]
    assert estimator._now.best.head.P[clock, clock] >= estimator.model.prior[clock]


def test_a_late_row_does_not_bring_back_what_was_taken_back(flown):
    lied = drifting(flown)
    wrong = [WrongClock(round((BEGIN_S - 1.0) * S), newest_ns(lied))]
    late_ns = lied["t_ns"] + np.where((lied["sensor"] == 2) & (np.arange(len(lied)) % 5 == 0), 6 * S // 10, 0)
    in_time, late = follow(lied, wrong), follow(lied, wrong, late_ns)
    assert sigmas_apart(late, in_time).max() < 0.1


def test_without_a_state_there_is_nothing_to_take_back(flown):
    nothing = FixedLagSmoother(DRIFTS, Settings())
    nothing.take_back(1, WrongClock(0, 0))
    nothing.step(flown[:1])
    assert nothing._now.best is None


def test_what_can_be_gone_back_to_is_bounded_and_a_second_apart(flown):
    estimator = follow(np.concatenate([flown, small.fly(DRIFTS, END_S, begin_s=END_S)]))
    past = [one.of[0].t_ns for one in estimator._withdrawals._past]
    assert len(past) <= KEPT
    assert (np.diff(past) >= S).all()


def test_methods_that_decide_at_first_sight_take_nothing_back(flown):
    from filters import methods

    estimator = methods.make("gate", DRIFTS)
    estimator.take_back(1, WrongClock(0, 0))
    estimator.step(flown)
    assert not estimator._withdrawals._asked
