"""Statuses against the enumeration of every path, densities against scipy."""

import itertools

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.stats import cauchy, norm

from filters.models import runs
from filters.models.rows import AZIMUTH, RANGE
from filters.smoother import passes, status
from filters.smoother.buffer import Rows
from tests.filters.smoother.kit import small
from tests.filters.smoother.test_passes import both

pytestmark = pytest.mark.decision

GOOD, GROSS, RUN = range(3)
STEP_NS = 50_000_000


def levels(r, s, noise, memory, weighed=None, t_ns=None):
    """(k, 3) log densities of the rows: good, gross, and a run that goes on; (k, 3, 3) the ways to each.

    The run is followed by the mean of all paths up to each row, its age too; what it does is tested with the
    runs.
    ``weighed`` (k,): log densities of a good row, where they are others.
    """
    chance, m, age, out, moves = memory[:3], memory.copy(), memory[runs.AGE], [], []
    for k in range(len(r)):
        A = transition(memory[runs.CHANCE], 1 / (runs.ROWS + age))
        moves.append(A)
        gross, fresh = cauchy.logpdf(r[k], 0, status.WIDTH * s[k]), runs.FRESH * (s[k] ** 2 - noise[k])
        seconds = (t_ns[k] - m[runs.TIME]) * 1e-9
        run, bending, steady = runs.log_run(m, r[k], noise[k], fresh, gross, seconds)
        like = np.array([norm.logpdf(r[k], 0, s[k]) if weighed is None else weighed[k], gross, run])
        out.append(like)
        good, gross, on = np.exp(like)
        begun, gone_on = (chance[GOOD] + chance[GROSS]) * A[GOOD, RUN] * gross, chance[RUN] * A[RUN, RUN] * on
        chance = np.array([chance @ A[:, GOOD] * good, chance @ A[:, GROSS] * gross, begun + gone_on])
        chance = chance / chance.sum()
        runs.follow(m, r[k], noise[k], fresh, like[1], begun / (begun + gone_on), bending, steady, seconds)
        m[runs.TIME], age = t_ns[k], gone_on / (begun + gone_on) * (age + 1)
    return np.array(out), np.array(moves)


def transition(p, end):
    """(3, 3) from, to; a run ends with probability ``end``."""
    settled = [1 - p, p * (1 - status.RUN_SHARE), p * status.RUN_SHARE]
    return np.array([settled, settled, [end, 0.0, 1 - end]])


def enumerate_paths(r, s, noise, memory, t_ns, weighed=None):
    """(k, 3) posterior of each row, log evidence, over all paths; a run's first row is a gross error."""
    like, moves = levels(r, s, noise, memory, weighed, t_ns)
    like, chance = np.exp(like), memory[:3]
    posterior, total = np.zeros((len(r), 3)), 0.0
    for first in range(3):
        for path in itertools.product(range(3), repeat=len(r)):
            p, before = chance[first], first
            for k, now in enumerate(path):
                p *= moves[k, before, now] * like[k, GROSS if now == RUN and before != RUN else now]
                before = now
            posterior[range(len(r)), path] += p
            total += p
    return posterior / total, np.log(total)


def case(channels, seed, outliers=()):
    """(rows, own, memory) of an instrument's residuals, ``outliers`` (row, sigmas)."""
    rng, k = np.random.default_rng(seed), len(channels)
    rows = Rows(
        STEP_NS * np.arange(k),
        np.zeros(k, "i2"),
        np.array(channels, "i1"),
        np.zeros(k),
        np.ones(k),
        np.zeros((k, 3)),
    )
    own = small.fresh(rows)
    own.noise[:], own.weight[:] = rng.uniform(0.5, 1.0, k), 0.5
    own.sigma[:] = np.sqrt(own.noise + rng.uniform(0.0, 2.0, k))
    own.residual[:] = own.sigma * rng.normal(size=k)
    for i, size in outliers:
        own.residual[i] = size * own.sigma[i]
    memory = status.fresh_memory(1)
    memory[0, channels, :3] = rng.dirichlet([5, 1, 1])
    memory[0, :, 3 : runs.BEGUN] = rng.normal(), 0.04, 0.5, -STEP_NS, rng.uniform(0.0, 5.0)
    memory[0, :, runs.BENDING : runs.STEADY] = 0.4, rng.normal(), 3.0, 0.6, 0.1, 50.0
    memory[0, :, runs.STEADY :] = 0.25, rng.normal(), 1.0, 0.4, 0.05, 5.0
    return rows, own, memory


def open_(rows):
    """(k,) nothing is closed."""
    return np.zeros(len(rows.t), bool)


CASES = {
    "all good": ([RANGE] * 6, ()),
    "one outlier": ([RANGE] * 7, [(3, 12.0)]),
    "a run": ([RANGE] * 7, [(2, 5.0), (3, 5.3), (4, 4.9), (5, 5.1)]),
    "the last one": ([RANGE] * 5, [(4, -40.0)]),
    "two channels": ([RANGE, AZIMUTH] * 5, [(2, 4.0), (4, 4.2), (5, 30.0)]),
    "one row": ([RANGE], [(0, 3.0)]),
    "huge": ([RANGE] * 4, [(1, 1e9), (2, -1e12)]),
}


@pytest.mark.parametrize("name", CASES)
@pytest.mark.parametrize("seed", [0, 1])
def test_posterior_is_that_of_all_paths(name, seed):
    channels, outliers = CASES[name]
    rows, own, memory = case(channels, seed, outliers)
    before = memory.copy()
    change = status.posterior(rows, own, memory, open_(rows), False)
    largest = 0.0
    for c in set(channels):
        mine = rows.channel == c
        expected, _ = enumerate_paths(
            own.residual[mine], own.sigma[mine], own.noise[mine], before[0, c], rows.t[mine]
        )
        good = np.where(expected[:, GOOD] < status.NEGLIGIBLE, 0.0, expected[:, GOOD])
        assert own.weight[mine] == pytest.approx(good, abs=1e-6)  # float32
        assert memory[0, c, :3] == pytest.approx(expected[-1], abs=1e-9)
        largest = max(largest, np.abs(good - 0.5).max())
    assert change == pytest.approx(largest, abs=1e-6)


@pytest.mark.parametrize("name", CASES)
def test_filtered_is_the_forward_half(name):
    channels, outliers = CASES[name]
    rows, own, memory = case(channels, 2, outliers)
    start = memory.copy()
    total = {c: 0.0 for c in set(channels)}
    for k, c in enumerate(channels):
        good, log_likelihood = status.filtered(
            memory[0, c], own.residual[k], own.sigma[k], own.noise[k], rows.t[k]
        )
        total[c] += log_likelihood
        mine = np.flatnonzero(rows.channel[: k + 1] == c)
        expected, log_total = enumerate_paths(
            own.residual[mine], own.sigma[mine], own.noise[mine], start[0, c], rows.t[mine]
        )
        assert good == pytest.approx(expected[-1, GOOD], abs=1e-6)
        assert total[c] == pytest.approx(log_total, rel=1e-6)


def test_closed_rows_get_no_weight_and_the_others_theirs():
    rows, own, memory = case([RANGE, AZIMUTH] * 3, 0)
    twin = type(own)(*(column.copy() for column in own))
    status.posterior(rows, own, memory.copy(), open_(rows), False)
    status.posterior(rows, twin, memory.copy(), rows.channel == AZIMUTH, False)
    assert not twin.weight[rows.channel == AZIMUTH].any()
    assert np.array_equal(twin.weight[rows.channel == RANGE], own.weight[rows.channel == RANGE])


# ---- learning


def told_weights(weight, residual=0.0):
    rows, own, _ = case([RANGE] * len(weight), 0)
    own.weight[:], own.residual[:] = weight, residual
    return rows, own


def test_the_share_of_outliers_is_learned_up_and_down_within_bounds():
    memory, seen = status.fresh_memory(1), []
    for weight in (0.3, 1.0):
        for _ in range(30):
            rows, own = told_weights([weight] * 10)
            status.advance(rows, own, memory)
            seen.append(memory[0, RANGE, runs.CHANCE])
    up, down = np.array(seen[:30]), np.array(seen[30:])
    assert (np.diff(up) >= 0).all()
    assert up[-1] == pytest.approx(status.P_WORST)
    assert (np.diff(down) <= 0).all()
    assert down[-1] == pytest.approx(status.P_OUTLIER)
    assert memory[0, AZIMUTH, runs.CHANCE] == status.P_OUTLIER  # of that channel alone


def test_one_step_of_learning_is_the_mean_over_the_memory():
    memory = status.fresh_memory(1)
    rows, own = told_weights([0.0])
    status.advance(rows, own, memory)
    p = status.P_OUTLIER
    assert memory[0, RANGE, runs.CHANCE] == pytest.approx(p + (1 - p) / status.MEMORY_ROWS)


def test_a_run_is_learned_from_once():
    """Only the step from a good row to an outlier tells how often that happens."""
    memory = status.fresh_memory(1)
    rows, own = told_weights([0.0] * 7, residual=30.0)
    own.sigma[:], own.noise[:] = 1.0, 1.0
    status.advance(rows, own, memory)
    p = status.P_OUTLIER
    assert memory[0, RANGE, runs.CHANCE] == pytest.approx(p + (1 - p) / status.MEMORY_ROWS)


def test_advance_moves_the_statuses_as_at_first_sight():
    rows, own, memory = case([RANGE] * 5, 3, [(3, 9.0)])
    other = memory.copy()
    own.weight[:] = 1.0
    status.advance(rows, own, memory)
    for k in range(5):
        p = other[0, RANGE, runs.CHANCE]
        good = other[0, RANGE, 0] > status.DOUBT
        status.filtered(other[0, RANGE], own.residual[k], own.sigma[k], own.noise[k], rows.t[k])
        other[0, RANGE, runs.CHANCE] = max(status.P_OUTLIER, p - p / status.MEMORY_ROWS) if good else p
    assert memory == pytest.approx(other)


# ---- evidence


def test_the_evidence_of_good_rows_is_their_joint_gaussian_density():
    model, rows, x, P, H = small.linear_case(7)
    own, out, *_ = both(model, rows, x, P, 1.0)
    memory = status.fresh_memory(1)
    memory[..., runs.CHANCE] = 1e-300  # no outliers
    total, *_ = status.log_evidence(rows, own, out, memory, -1)
    dense = small.Dense(model, rows, x, P, small.PSD, H)
    assert total == pytest.approx(dense.log_density(own.noise), abs=1e-6)


def test_the_evidence_is_the_sum_over_all_paths():
    """Every row by its innovation; a good one of less weight has the larger noise."""
    rows, own, memory = case([RANGE] * 6, 4)
    own.weight[:] = [1, 1, 0, 0, 0.5, 1]
    v = np.random.default_rng(5).normal(size=6)
    v[2:4] = 8.0, 9.0
    S = own.noise + np.linspace(0.5, 2.0, 6)
    spare = np.array([n / w - n if w else 0.0 for n, w in zip(own.noise, own.weight, strict=True)])
    good = norm.logpdf(v, 0, np.sqrt(S + spare))
    _, expected = enumerate_paths(v, np.sqrt(S), own.noise, memory[0, RANGE], rows.t, good)
    out = passes.trace(6, 9, 1)
    out.v[:], out.S[:], out.fresh[:] = v, S, runs.FRESH * (S - own.noise)
    found, *_ = status.log_evidence(rows, own, out, memory, -1)
    assert found == pytest.approx(expected, rel=1e-9)


@settings(deadline=None, derandomize=True, max_examples=50)
@given(st.lists(st.floats(-1e6, 1e6), min_size=1, max_size=12), st.floats(1e-3, 1e3), st.floats(0.0, 1.0))
def test_probabilities_of_the_statuses_sum_to_one(residuals, s, share):
    memory = status.fresh_memory(1)[0, 0]
    for k, r in enumerate(residuals):
        good, log_likelihood = status.filtered(memory, r * s, s, share * s * s, k * STEP_NS)
        assert memory[:3].sum() == pytest.approx(1.0)
        assert 0.0 <= good <= 1.0
        assert np.isfinite(log_likelihood)


def test_every_reason_has_a_text():
    assert len(set(status.REASONS)) == len(status.REASONS) == status.NO_STATE + 1


def test_a_trace_of_nothing():
    rows, own, memory = case([RANGE], 0)
    none = Rows(*(column[:0] for column in rows))
    out = passes.trace(1, 9, 0)
    own = type(own)(*(column[:0] for column in own))
    assert status.posterior(none, own, memory, open_(none), False) == 0.0
    assert not any(status.log_evidence(none, own, out, memory, -1))
