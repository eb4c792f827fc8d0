"""One explanation of a window: outliers found, from wrong weights too; decided in parts or at once."""

import numpy as np
import pytest

from filters.models import state
from filters.models.motion import CORE, PSD
from filters.models.rows import AZIMUTH, RANGE, E
from filters.smoother import gated, status
from filters.smoother.buffer import Rows, outcome
from filters.smoother.hypothesis import Hypothesis, Moment, Workspace
from tests.filters.smoother.kit import small

NEVER = np.iinfo(np.int64).max


def hypothesis(sensors, seconds=2.0, seed=0, excluded=-1, sigma=5.0):
    """(hypothesis anchored at the truth within ``sigma``, rows, model), all weights one."""
    model = state.build(sensors)
    rows = small.to_rows(small.fly(sensors, seconds, seed=seed), model)
    x, P = np.zeros(len(model.prior)), state.prior_covariance(model)
    p, v = small.truth(np.zeros(1))
    x[:6] = *p[0], *v[0]
    P[range(CORE), range(CORE)] = sigma**2
    anchor = Moment(int(rows.t[0]), x, P, status.fresh_memory(len(sensors)))
    one = Hypothesis(Workspace(model, PSD), anchor, excluded)
    one.judged(outcome(len(rows.t)))
    one.own.weight[:] = 1.0
    return one, rows, model


def spoil(rows, at, sigmas):
    rows.value[at] += sigmas * np.sqrt(rows.stated[at])


def where(rows, sensor, channel=None, first=0, count=None):
    mine = (rows.sensor == sensor) & ((rows.channel == channel) if channel is not None else True)
    at = np.flatnonzero(mine)
    return at[first:][:count]


def wrong(one, rows, at):
    """(missed, falsely refused) among the rows; ``at`` are the outliers."""
    refused = one.own.weight < status.DOUBT
    bad = np.zeros(len(rows.t), bool)
    bad[at] = True
    return int((bad & ~refused).sum()), int((refused & ~bad).sum())


def instruments():
    return small.four()[1:]


def test_good_rows_are_all_kept():
    one, rows, _ = hypothesis(small.four())
    one.settle(rows, 0)
    assert wrong(one, rows, []) == (0, 0)
    assert one.shortfall < 3.0


@pytest.mark.parametrize("seed", range(6))
def test_a_right_model_is_as_likely_as_it_expects(seed):
    """Good rows only: nothing that asks for another explanation."""
    one, rows, _ = hypothesis(instruments(), seed=seed)
    one.settle(rows, 0)
    assert abs(one.shortfall) < 4.0


def test_nothing_is_expected_of_an_excluded_sensor():
    one, rows, _ = hypothesis([small.theodolite()], excluded=0)
    spoil(rows, np.arange(10), 50.0)
    one.settle(rows, 0)
    assert one.shortfall == pytest.approx(0.0, abs=1e-9)


@pytest.mark.parametrize("seed", range(3))
def test_isolated_outliers_are_found(seed):
    one, rows, _ = hypothesis(small.four(), seed=seed)
    rng = np.random.default_rng(seed)
    # the INS says velocities with slow errors, so its own are judged less sharply
    at = rng.permutation(np.flatnonzero(rows.sensor > 0))[:8]
    spoil(rows, at, rng.choice([-1, 1], 8) * rng.uniform(20, 100, 8))
    one.settle(rows, 0)
    missed, refused = wrong(one, rows, at)
    assert missed == 0
    assert refused <= 1


@pytest.mark.parametrize(("sensor", "channel"), [(0, RANGE), (1, AZIMUTH), (2, RANGE)])
def test_a_run_in_one_channel_is_found(sensor, channel):
    one, rows, _ = hypothesis(instruments())
    at = where(rows, sensor, channel, 5, 10)
    spoil(rows, at, 30.0)
    for _ in range(2):
        one.settle(rows, 0)
    missed, refused = wrong(one, rows, at)
    assert missed == 0
    assert refused <= 2


def liar(sensor, sensors):
    """(hypothesis, rows, its rows) with all polar channels of ``sensor`` 40 sigmas off throughout."""
    one, rows, _ = hypothesis(sensors)
    at = where(rows, sensor)
    at = at[rows.channel[at] < 3]
    spoil(rows, at, 40.0)
    return one, rows, at


@pytest.mark.parametrize("sensor", range(3))
def test_one_of_three_sensors_that_is_wrong_throughout_is_found_by_annealing(sensor):
    equal = [*instruments()[:2], small.theodolite("c", (-500.0, 700.0, 0.0))]
    one, rows, at = liar(sensor, equal)
    one.settle(rows, 0, annealed=True)
    missed, refused = wrong(one, rows, at)
    assert missed <= 2
    assert refused <= 2


def test_the_truth_about_a_liar_has_the_most_evidence():
    """Two theodolites and a radar that is less precise, one theodolite wrong."""
    told, rows, at = liar(1, instruments())
    told.own.weight[at] = 0.0
    for _ in range(2):
        told.settle(rows, 0)
    assert wrong(told, rows, at) == (0, 0)
    found, rows, at = liar(1, instruments())
    found.settle(rows, 0, annealed=True)
    assert found.log_evidence <= told.log_evidence + 1.0


def test_annealed_it_does_not_matter_that_all_weights_are_wrong():
    """Only the bad rows believed at first; and the same from all good ones."""
    found = []
    for believed in ("bad", "good", "none", "all"):
        one, rows, _ = hypothesis(instruments())
        at = where(rows, 0, RANGE, 5, 10)
        spoil(rows, at, 30.0)
        bad = np.isin(np.arange(len(rows.t)), at)
        one.own.weight[:] = {"bad": bad, "good": ~bad, "none": 0, "all": 1}[believed]
        one.settle(rows, 0, annealed=True)
        one.settle(rows, 0)
        assert wrong(one, rows, at)[0] == 0
        found.append(one.own.weight > status.DOUBT)
    for other in found[1:]:
        assert np.array_equal(found[0], other)


def test_settled_again_nothing_changes():
    one, rows, _ = hypothesis(small.four())
    spoil(rows, where(rows, 1, RANGE, 4, 3), 25.0)
    for _ in range(8):
        one.settle(rows, 0)
    weight, head, evidence = one.own.weight.copy(), one.head.x.copy(), one.log_evidence
    one.settle(rows, 0)
    assert np.abs(one.own.weight - weight).max() < 0.05
    assert np.abs(one.head.x[:3] - head[:3]).max() < 0.02
    assert one.log_evidence == pytest.approx(evidence, abs=1.0)


def mirrored():
    """(right, other) settled on the same rows, the other from an anchor 200 m aside, as sure of it."""
    right, rows, _ = hypothesis(small.four())
    other, _, _ = hypothesis(small.four())
    other.anchor.x[0] += 200.0
    right.settle(rows, 0)
    other.settle(rows, 0)
    return right, other


def test_the_truth_has_more_evidence_than_a_mirror():
    right, other = mirrored()
    assert right.log_evidence > other.log_evidence + 10


def test_a_mirror_falls_short():
    """What the anchor costs is behind the newest rows."""
    right, other = mirrored()
    assert other.shortfall > right.shortfall


def test_excluded_it_says_what_the_others_say():
    """Whatever the excluded sensor says, nothing changes."""
    one, rows, _ = hypothesis(instruments(), excluded=1)
    other, spoilt, _ = hypothesis(instruments(), excluded=1)
    spoil(spoilt, where(spoilt, 1), 500.0)
    one.own.weight[rows.sensor == 1] = other.own.weight[rows.sensor == 1] = 0.0
    for h, seen in ((one, rows), (other, spoilt)):
        h.settle(seen, 0)
        h.settle(seen, 0)
        assert not h.own.weight[seen.sensor == 1].any()
    assert np.array_equal(one.head.x, other.head.x)
    assert one.log_evidence == other.log_evidence
    assert one.shortfall == other.shortfall
    kept = rows.sensor != 1
    assert np.array_equal(one.own.residual[kept], other.own.residual[kept])


@pytest.mark.parametrize("slow", [0.0, 1.0])
def test_first_sight_then_the_window_end_in_the_same_state(slow):
    """No outliers, same densities: filtered forward is filtered forward."""
    one, rows, model = hypothesis([sensor._replace(slow=slow) for sensor in small.four()])
    one.follow(np.array([[0.0, 1.0, -1.0, 2.0], one.slow[1]]))
    one.judged(outcome(0))
    told = gated.epoch_states(len(rows.t), len(model.prior))
    count, _ = one.admit(rows, told, gated.Rule(gated.IGG, np.inf, np.inf), NEVER)
    assert count == len(rows.t)
    x, P = one.head.x.copy(), one.head.P.copy()
    one._smooth(rows, 0)
    assert np.allclose(one.head.x, x, rtol=1e-9, atol=1e-9)
    assert np.allclose(one.head.P, P, rtol=1e-9, atol=1e-12)


@pytest.mark.parametrize("slow", [0.0, 1.0])
@pytest.mark.parametrize("cut", [1, 40, 200])
def test_committed_in_parts_is_all_at_once(cut, slow):
    """The anchor passes the first rows, the rest is filtered from there: the same head as from the start."""
    one, rows, _ = hypothesis([sensor._replace(slow=slow) for sensor in small.four()])
    one.follow(np.array([[0.0, 1.0, -1.0, 2.0], one.slow[1]]))
    found = one.settle(rows, cut)
    one._smooth(rows, 0)  # with the densities as they are now
    x, P, weight, scale = one.head.x.copy(), one.head.P.copy(), one.own.weight.copy(), one.scale
    slow_errors, ins_errors = one.slow, one.ins
    one.commit(rows, cut, found, 0.0)
    assert one.anchor.t_ns == rows.t[cut - 1]
    assert np.array_equal(one.own.weight, weight[cut:])
    rest = Rows(*(column[cut:] for column in rows))
    one.scale, one.ins = scale, ins_errors
    one.follow(slow_errors)
    one._smooth(rest, 0)
    assert np.allclose(one.head.x, x, rtol=1e-9, atol=1e-9)
    assert np.allclose(one.head.P, P, rtol=1e-8, atol=1e-12)


def test_of_both_regimes_the_errors_have_the_same_factor():
    sensors = [small.ins(), small.theodolite(slow=1.0)]
    one, _, model = hypothesis(sensors)
    one.follow(np.array([[3.0, np.log(4.0)], one.slow[1]]))
    one.psd_before = 30.0 * one.psd
    now, before = one.densities()
    assert np.array_equal(now[4:], before[4:])
    assert np.array_equal(before[:4], 30.0 * now[:4])
    assert now[4:] == pytest.approx(np.where(model.slow_of == 1, 4.0, 1.0))


def test_the_factor_of_slow_errors_is_followed_where_rows_are_decided():
    """The theodolite's ranges, 4 of its sigmas off against an INS that knows better, must be slow errors."""
    sensors = [small.ins(clock_sigma_s=1e-9, p=0.05, v=0.05), small.theodolite(slow=1.0)]
    one, rows, _ = hypothesis(sensors)
    spoil(rows, where(rows, 1, RANGE), 4.0)
    found = one.settle(rows, len(rows.t))
    one.commit(rows, len(rows.t), found, 2.0)
    assert one.slow[0, 0] == 0.0
    assert one.slow[0, 1] > 0.1


def test_smoothed_states_of_the_kept_rows_are_nearer_the_truth():
    one, rows, _ = hypothesis(small.four())
    one.settle(rows, len(rows.t))
    first = np.flatnonzero(np.diff(rows.t, prepend=-1))[10:60]
    at = one.space.trace.x[first, :3]
    p, _ = small.truth(rows.t[first] * 1e-9)
    sigma = np.sqrt(np.trace(one.space.trace.P[first][:, :3, :3], axis1=1, axis2=2))
    assert (np.linalg.norm(at - p, axis=1) < 4 * sigma).mean() > 0.95


def test_a_copy_goes_its_own_way():
    one, rows, _ = hypothesis(small.four())
    one.settle(rows, 0)
    x, weight = one.head.x.copy(), one.own.weight.copy()
    other = one.copy()
    other.own.weight[:] = 0.0
    other.anchor.x[:3] += 100.0
    other.anchor.memory[:] = 0.1
    other.settle(rows, 0)
    assert np.array_equal(one.head.x, x)
    assert np.array_equal(one.own.weight, weight)


def test_an_ins_alone_is_believed():
    one, rows, _ = hypothesis([small.ins(clock_sigma_s=0.05, p=0.3, v=0.1)])
    one.settle(rows, 0)
    assert (one.own.weight[rows.channel < E + 3] > status.DOUBT).all()
