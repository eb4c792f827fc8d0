"""First sight: the order of simultaneous rows, the rules, the stop at a surprise, and batches."""

import itertools

import numpy as np
import pytest

from filters.models import state
from filters.models.rows import AE, RANGE, RANGE_RATE, E
from filters.models.update import weight
from filters.smoother import gated, passes, status
from filters.smoother.buffer import Rows, outcome
from tests.filters.smoother.kit import small
from tests.filters.smoother.test_hypothesis import hypothesis

pytestmark = pytest.mark.decision

NEVER = np.iinfo(np.int64).max
EVERYTHING = gated.Rule(gated.IGG, np.inf, np.inf)


def start(model, sigma=1.0):
    x, P = np.zeros(len(model.prior)), state.prior_covariance(model)
    P[range(9), range(9)] = sigma**2
    return x, P


def admit(
    model, rows, x, P, memory=None, *, excluded=-1, rule=gated.BY_STATUS, quiet_ns=NEVER, surprise=0.0,
    t_ns=0, factor=1.0,
):  # fmt: skip
    """(rows taken, epochs, surprise, own, told); ``x``, ``P`` and ``memory`` in place."""
    memory = status.fresh_memory(len(model.is_ins)) if memory is None else memory
    own, n = outcome(len(rows.t)), len(x)
    told = gated.epoch_states(len(rows.t), n)
    taken = gated.admit(
        model, rows, own, 0, np.zeros(model.variance.shape), small.densities(model, factor=factor), x, P,
        t_ns, memory, excluded, rule, surprise, quiet_ns, passes.trace(1, n, 0), told, state.scratch(n),
    )  # fmt: skip
    return *taken, own, told


def several(count=4):
    """A model of so many INS with a position only: their rows at one instant vote."""
    return state.build([small.ins(str(k), p=0.5) for k in range(count)])


def east(model, values, t=0.0):
    return [(t, s, E, value) for s, value in enumerate(values)]


def sight(model, values, **how):
    x, P = start(model, 3.0)
    return admit(model, small.as_rows(east(model, values), model), x, P, **how), x


def test_those_that_agree_go_first_and_sharpen_the_prediction_for_the_rest():
    """A liar who comes first loses no less than one who comes last."""
    truths, model = [2.0, 2.1, 1.9], several()
    weights = {}
    for at in range(4):
        values = [*truths[:at], 20.0, *truths[at:]]
        (_, _, _, own, _), x = sight(model, values)
        weights[at] = own.weight[at]
        assert x[0] == pytest.approx(2.0, abs=0.6)
        assert own.sigma[at] == min(own.sigma)  # it came last
    assert max(weights.values()) < 0.01


def test_where_all_agree_the_rows_go_as_they_come():
    model = several()
    (_, _, _, own, _), _ = sight(model, [0.3, 0.1, 0.2, 0.0])
    assert (np.diff(own.sigma) < 0).all()


@pytest.mark.parametrize("factor", [1.0, 0.05, 20.0])
def test_an_update_at_first_sight_is_the_filters_own(factor):
    """Everything taken: the dense solution of the rows so far, epoch by epoch."""
    model, rows, x, P, H = small.linear_case()
    dense = small.Dense(model, rows, x, P, small.densities(model, factor=factor), H)
    count, epochs, _, own, told = admit(model, rows, x.copy(), P.copy(), rule=EVERYTHING, factor=factor)
    assert (count, epochs) == (len(rows.t), len(np.unique(rows.t)))
    assert (own.weight == 1.0).all()
    for e, t in enumerate(np.unique(rows.t)):
        at = slice(e * dense.n, (e + 1) * dense.n)
        for use, seen_x, seen_P in (
            (rows.t <= t, told.x[e, :9], told.P[e]),
            (rows.t < t, told.before_x[e], told.before_P[e]),
        ):
            mean, cov = dense.given(np.flatnonzero(use), own.noise)
            assert np.allclose(seen_x, mean[at][:9], atol=1e-7)
            assert np.allclose(seen_P, cov[at, at][:9, :9], atol=1e-7)


@pytest.mark.parametrize("u", [0.5, 1.4, 3.0, 6.0, 9.0])
def test_igg_weighs_by_the_innovation(u):
    rule, memory = gated.Rule(gated.IGG, 1.5, 8.5), status.fresh_memory(1)
    w, _ = gated.weigh(rule, memory, 0, RANGE, 2.0 * u, 2.0, 1.0, 0)
    assert w == weight(u, 1.5, 8.5)


def test_a_gate_takes_all_or_nothing():
    gate, memory = gated.Rule(gated.IGG, 4.0, 4.0), status.fresh_memory(1)
    seen = [gated.weigh(gate, memory, 0, RANGE, v, 1.0, 1.0, 0)[0] for v in (3.9, -3.9, 4.1, -50.0)]
    assert seen == [1, 1, 0, 0]


def test_m1_refuses_the_third_doubtful_row_in_a_row_entirely():
    rule, memory = gated.Rule(gated.M1, 4.0, 8.0), status.fresh_memory(1)
    seen = [gated.weigh(rule, memory, 0, RANGE, v, 1.0, 1.0, 0)[0] for v in (5, 5, 5, 5, 1, 5)]
    part = weight(5.0, 4.0, 8.0)
    assert seen == [part, part, 0.0, 0.0, 1.0, part]


def test_m1_scales_the_gain_where_igg_widens_the_noise():
    """βK (M1) against R/β (IGG), one row of one state: closed forms."""
    model = several(1)
    for kind in (gated.IGG, gated.M1):
        x, P = start(model, 3.0)
        b = P[0, 0] + model.prior[model.bias_at[0, E]]
        P0, R = P[0, 0], 0.25
        rows = small.as_rows([(0.0, 0, E, 5.0 * np.sqrt(b + R))], model)
        *_, own, _ = admit(model, rows, x, P, rule=gated.Rule(kind, 2.0, 9.0))
        beta, v = weight(5.0, 2.0, 9.0), rows.value[0]
        assert own.weight[0] == pytest.approx(beta, rel=1e-6)
        S = (b + R) / beta if kind == gated.M1 else b + R / beta
        assert x[0] == pytest.approx(P0 / S * v, rel=1e-6)


def test_by_status_the_weight_is_the_filtered_probability():
    model = several(1)
    memory = status.fresh_memory(1)
    other = memory[0, E].copy()
    x, P = start(model)
    rows = small.as_rows([(0.1 * k, 0, E, v) for k, v in enumerate([0.0, 0.2, 9.0, 9.1, 0.1])], model)
    *_, own, _ = admit(model, rows, x, P, memory)
    for k in range(5):
        w, _ = status.filtered(other, own.residual[k], own.sigma[k], own.noise[k], rows.t[k])
        assert own.weight[k] == pytest.approx(w if w > status.NEGLIGIBLE else 0.0, abs=1e-7)
    assert memory[0, E] == pytest.approx(other)


def test_by_status_a_doubtful_row_leaves_its_spread():
    """One row of one state: the gain is w K, and beside it w (1 − w) (K v)²."""
    model = several(1)
    x, P = start(model, 3.0)
    b = P[0, 0] + model.prior[model.bias_at[0, E]]
    P0, R = P[0, 0], 0.25
    rows = small.as_rows([(0.0, 0, E, 3.7 * np.sqrt(b + R))], model)
    *_, own, _ = admit(model, rows, x, P)
    w, v = float(own.weight[0]), rows.value[0]
    assert 0.1 < w < 0.9
    left = P0 - w * P0**2 / (b + R)
    assert P[0, 0] == pytest.approx(left + w * (1 - w) * (P0 / (b + R) * v) ** 2, rel=1e-6)


def surprising(model, at, size=60.0, count=12):
    rows = [row for k in range(count) for row in east(model, [0.0] * 4, 0.1 * k)]
    return small.as_rows(
        [(t, s, c, size if round(t * 10) == at and s < 3 else v) for t, s, c, v in rows], model
    )


def test_it_stops_after_the_epoch_that_surprises():
    model = several()
    rows = surprising(model, 5)
    x, P = start(model)
    count, epochs, surprise, *_ = admit(model, rows, x, P, quiet_ns=0)
    assert (count, epochs) == (24, 6)
    assert surprise > gated.SURPRISE


def test_nothing_surprises_before_its_time():
    model = several()
    rows = surprising(model, 5)
    x, P = start(model)
    later = int(rows.t[-4])
    count, epochs, *_ = admit(model, rows, x, P, quiet_ns=NEVER)
    assert (count, epochs) == (48, 12)
    x, P = start(model)
    count, *_ = admit(model, surprising(model, 5, size=1e6), x, P, quiet_ns=int(rows.t[0]) + 600_000_000)
    assert count == 28
    assert later > 0


def test_good_rows_do_not_surprise():
    model, rng = several(), np.random.default_rng(0)
    said = [row for k in range(100) for row in east(model, 0.5 * rng.normal(size=4), 0.1 * k)]
    x, P = start(model)
    count, *_ = admit(model, small.as_rows(said, model), x, P, quiet_ns=0)
    assert count == 400


def lost(model, said):
    x, P = start(model)
    return admit(model, small.as_rows(said, model), x, P)[2]


def test_one_outlier_of_any_size_is_no_surprise():
    model = several()
    for size in (10.0, 1e4):
        said = [row for k in range(20) for row in east(model, np.zeros(4), 0.1 * k)]
        assert lost(model, said + east(model, np.array([size, 0.0, 0.0, 0.0]), 2.0)) < gated.SURPRISE


def test_many_rows_somewhat_off_are_a_surprise():
    model = several()
    said = [row for k in range(20) for row in east(model, np.zeros(4), 0.1 * k)]
    assert lost(model, said + east(model, np.full(4, 4.0), 2.0)) > gated.SURPRISE


def test_an_excluded_sensor_neither_moves_the_state_nor_surprises():
    model = several()
    rows = surprising(model, 5)
    alone = Rows(*(column[rows.sensor == 3] for column in rows))
    rows = Rows(*(column[(rows.sensor == 3) | (rows.sensor == 0)] for column in rows))
    x, P = start(model)
    y, Q = start(model)
    *_, surprise, own, _ = admit(model, rows, x, P, quiet_ns=0, excluded=0)
    *_, other, _, _ = admit(model, alone, y, Q, quiet_ns=0)
    assert not own.weight[rows.sensor == 0].any()
    assert np.allclose(x, y, atol=1e-12)
    assert np.allclose(P, Q, atol=1e-12)
    assert surprise == pytest.approx(other)


def test_batches_do_not_matter():
    sensors = [small.theodolite("a", (0.0, -500.0, 0.0)), small.radar("b", (400.0, 0.0, 0.0)), small.ins()]
    model = state.build(sensors)
    flight = small.fly(sensors, 4.0)
    flight["value"][100] += 30.0
    rows = small.as_rows([(r["t_ns"] * 1e-9, r["sensor"], r["channel"], r["value"]) for r in flight], model)
    p, v = small.truth(np.zeros(1))
    results = []
    for size in (len(rows.t), 1):
        x, P = start(model, 5.0)
        x[:6] = *p[0], *v[0]
        memory, surprise, weights, t_ns = status.fresh_memory(3), 0.0, [], 0
        first = np.flatnonzero(np.diff(rows.t, prepend=-1))
        edges = [0, len(rows.t)] if size > 1 else [*first, len(rows.t)]
        for a, b in itertools.pairwise(edges):
            part = Rows(*(column[a:b] for column in rows))
            _, _, surprise, own, _ = admit(model, part, x, P, memory, surprise=surprise, t_ns=t_ns)
            weights.append(own.weight)
            t_ns = int(part.t[-1])
        results.append((x, P, memory, np.concatenate(weights), surprise))
    for one, many in zip(*results, strict=True):
        assert np.array_equal(one, many)


@pytest.mark.parametrize(("channel", "ties"), [(E, True), (E + 3, True), (AE, False)])
def test_an_acceleration_ties_nothing_down(channel, ties):
    model = state.build([small.ins(p=0.5, v=0.2, a=0.3)])
    x, P = start(model)
    *_, told = admit(model, small.as_rows([(0.0, 0, channel, 0.1)], model), x, P)
    assert told.fixed[0] == ties


@pytest.mark.parametrize("excluded", [-1, 0])
@pytest.mark.parametrize(("channel", "ties"), [(RANGE, True), (RANGE_RATE, False)])
def test_a_range_rate_ties_nothing_down_nor_does_an_excluded_sensor(channel, ties, excluded):
    sensor = small.radar()
    model = state.build([sensor])
    x, P = start(model)
    x[:3] = 300.0, 400.0, 100.0
    rows = small.as_rows([(0.0, 0, channel, small.polar(sensor, x[:3], x[3:6])[channel])], model)
    *_, told = admit(model, rows, x, P, excluded=excluded)
    assert told.fixed[0] == (ties and excluded != 0)


def test_rows_taken_one_by_one_or_together_are_judged_alike():
    """What was made of them lies in one place, which grows; a copy has its own."""
    one, rows, model = hypothesis(small.four())
    one.judged(outcome(0))
    other, told = one.copy(), gated.epoch_states(len(rows.t), len(model.prior))
    one.admit(rows, told, gated.BY_STATUS, NEVER)
    for k in np.flatnonzero(np.diff(rows.t, prepend=-1)):
        epoch = Rows(*(column[rows.t == rows.t[k]] for column in rows))
        before = other.copy()
        other.admit(epoch, told, gated.BY_STATUS, NEVER)
        assert len(before.own.weight) == k
    for together, single in zip(one.own, other.own, strict=True):
        assert (together == single).all()
    before.own.weight[:] = -1.0
    assert (other.own.weight >= 0.0).all()
