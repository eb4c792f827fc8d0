"""Statuses against the enumeration of every path, densities against scipy."""

import itertools

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.stats import cauchy, norm

from filters.models.rows import AZIMUTH, RANGE
from filters.smoother import passes, status
from filters.smoother.buffer import Rows
from tests.filters.smoother.kit import small
from tests.filters.smoother.test_passes import both

pytestmark = pytest.mark.decision

GOOD, GROSS, RUN = range(3)


def log_densities(r, s, noise, before):
    """(3,) by the module's text."""
    good, gross = norm.logpdf(r, 0, s), cauchy.logpdf(r, 0, status.WIDTH * s)
    near = norm.logpdf(r, before, np.sqrt(2 * s**2 + (status.SPREAD * before) ** 2))
    power, alone = min(1.0, noise / s**2), max(good - status.HANDICAP, gross)
    return np.array([good, gross, power * (np.logaddexp(gross, near) - np.log(2)) + (1 - power) * alone])


def transition(p):
    """(3, 3) from, to."""
    stay, settled = 1 - 1 / status.RUN_ROWS, [1 - p, p * (1 - status.RUN_SHARE), p * status.RUN_SHARE]
    return np.array([settled, settled, [1 - stay, 0.0, stay]])


def enumerate_paths(r, s, noise, memory):
    """(k, 3) posterior of each row, (3,) filtered one of the last, log evidence, over all 3^k paths."""
    A, chance = transition(memory[4]), memory[:3]
    before = [memory[3], *r[:-1]]
    like = np.exp([log_densities(*row) for row in zip(r, s, noise, before, strict=True)])
    posterior, total = np.zeros((len(r), 3)), 0.0
    for path in itertools.product(range(3), repeat=len(r)):
        p = chance @ A[:, path[0]] * like[0, path[0]]
        for k in range(1, len(r)):
            p *= A[path[k - 1], path[k]] * like[k, path[k]]
        posterior[range(len(r)), path] += p
        total += p
    return posterior / total, np.log(total)


def case(channels, seed, outliers=()):
    """(rows, own, memory) of an instrument's residuals, ``outliers`` (row, sigmas)."""
    rng, k = np.random.default_rng(seed), len(channels)
    rows = Rows(
        np.arange(k), np.zeros(k, "i2"), np.array(channels, "i1"), np.zeros(k), np.ones(k), np.zeros((k, 3))
    )
    own = small.fresh(rows)
    own.noise[:], own.weight[:] = rng.uniform(0.5, 1.0, k), 0.5
    own.sigma[:] = np.sqrt(own.noise + rng.uniform(0.0, 2.0, k))
    own.residual[:] = own.sigma * rng.normal(size=k)
    for i, size in outliers:
        own.residual[i] = size * own.sigma[i]
    memory = status.fresh_memory(1)
    memory[0, :, :3], memory[0, :, 3], memory[0, :, 4] = rng.dirichlet([5, 1, 1]), rng.normal(), 0.04
    return rows, own, memory


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
    change = status.posterior(rows, own, memory, -1)
    largest = 0.0
    for c in set(channels):
        mine = rows.channel == c
        expected, _ = enumerate_paths(own.residual[mine], own.sigma[mine], own.noise[mine], before[0, c])
        good = np.where(expected[:, GOOD] < status.NEGLIGIBLE, 0.0, expected[:, GOOD])
        assert own.weight[mine] == pytest.approx(good, abs=1e-6)  # float32
        assert memory[0, c, :3] == pytest.approx(expected[-1], abs=1e-9)
        assert memory[0, c, 3] == own.residual[mine][-1]
        largest = max(largest, np.abs(good - 0.5).max())
    assert change == pytest.approx(largest, abs=1e-6)


@pytest.mark.parametrize("name", CASES)
def test_filtered_is_the_forward_half(name):
    channels, outliers = CASES[name]
    rows, own, memory = case(channels, 2, outliers)
    start = memory.copy()
    total = {c: 0.0 for c in set(channels)}
    for k, c in enumerate(channels):
        good, log_likelihood = status.filtered(memory[0, c], own.residual[k], own.sigma[k], own.noise[k])
        total[c] += log_likelihood
        mine = np.flatnonzero(rows.channel[: k + 1] == c)
        expected, log_total = enumerate_paths(
            own.residual[mine], own.sigma[mine], own.noise[mine], start[0, c]
        )
        assert good == pytest.approx(expected[-1, GOOD], abs=1e-9)
        assert total[c] == pytest.approx(log_total, rel=1e-9)


def test_the_excluded_sensor_gets_no_weight_and_the_others_theirs():
    rows, own, memory = case([RANGE, AZIMUTH] * 3, 0)
    rows.sensor[rows.channel == AZIMUTH] = 1
    memory = np.concatenate([memory, memory])
    twin = type(own)(*(column.copy() for column in own))
    status.posterior(rows, own, memory.copy(), -1)
    status.posterior(rows, twin, memory.copy(), 1)
    assert not twin.weight[rows.sensor == 1].any()
    assert np.array_equal(twin.weight[rows.sensor == 0], own.weight[rows.sensor == 0])


def test_a_row_within_a_run_counts_less_where_the_prediction_is_the_doubt():
    """Power R / s²: all of the density for a sharp prediction, the better of the others for a vague one.

    There a good row speaks against the run by HANDICAP.
    """
    r, s, before = 5.0, 1.0, 5.0
    sharp = status.log_run(r, s, s**2, before)
    assert sharp == pytest.approx(log_densities(r, s, s**2, before)[RUN], rel=1e-12)
    vague = status.log_run(r, s, 0.0, before)
    assert vague == pytest.approx(max(status.log_good(r, s), status.log_gross(r, s)), rel=1e-12)
    half = status.log_run(r, s, 0.5, before)
    assert half == pytest.approx(0.5 * (sharp + vague), rel=1e-12)
    assert status.log_run(r, s, 7.0, before) == sharp  # no more than all of it


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
            seen.append(memory[0, RANGE, 4])
    up, down = np.array(seen[:30]), np.array(seen[30:])
    assert (np.diff(up) >= 0).all()
    assert up[-1] == pytest.approx(status.P_WORST)
    assert (np.diff(down) <= 0).all()
    assert down[-1] == pytest.approx(status.P_OUTLIER)
    assert memory[0, AZIMUTH, 4] == status.P_OUTLIER  # of that channel alone


def test_one_step_of_learning_is_the_mean_over_the_memory():
    memory = status.fresh_memory(1)
    rows, own = told_weights([0.0])
    status.advance(rows, own, memory)
    p = status.P_OUTLIER
    assert memory[0, RANGE, 4] == pytest.approx(p + (1 - p) / status.MEMORY_ROWS)


def test_a_run_is_learned_from_once():
    """Only the step from a good row to an outlier tells how often that happens."""
    memory = status.fresh_memory(1)
    rows, own = told_weights([0.0] * 7, residual=30.0)
    own.sigma[:], own.noise[:] = 1.0, 1.0
    status.advance(rows, own, memory)
    p = status.P_OUTLIER
    assert memory[0, RANGE, 4] == pytest.approx(p + (1 - p) / status.MEMORY_ROWS)


def test_advance_moves_the_statuses_as_at_first_sight():
    rows, own, memory = case([RANGE] * 5, 3, [(3, 9.0)])
    other = memory.copy()
    own.weight[:] = 1.0
    status.advance(rows, own, memory)
    for k in range(5):
        p = other[0, RANGE, 4]
        good = other[0, RANGE, 0] > status.DOUBT
        status.filtered(other[0, RANGE], own.residual[k], own.sigma[k], own.noise[k])
        other[0, RANGE, 4] = max(status.P_OUTLIER, p - p / status.MEMORY_ROWS) if good else p
    assert memory == pytest.approx(other)


# ---- evidence


def test_the_evidence_of_good_rows_is_their_joint_gaussian_density():
    model, rows, x, P, H = small.linear_case(7)
    own, out, *_ = both(model, rows, x, P, 1.0)
    memory = status.fresh_memory(1)
    memory[..., 4] = 1e-300  # no outliers
    total, *_ = status.log_evidence(rows, own, out.v, out.S, memory, -1)
    dense = small.Dense(model, rows, x, P, small.PSD, H)
    assert total == pytest.approx(dense.log_density(own.noise), abs=1e-6)


def test_the_evidence_is_the_sum_over_all_paths():
    """A good row by its innovation, any other by its residual."""
    channels = [RANGE] * 6
    rows, own, memory = case(channels, 4, [(2, 8.0), (3, 9.0)])
    own.weight[:] = [1, 1, 0, 0, 0.5, 1]
    rng = np.random.default_rng(5)
    v, S = rng.normal(size=6), own.noise + rng.uniform(0.5, 2.0, 6)
    spare = [n / w - n if w else 0.0 for n, w in zip(own.noise, own.weight, strict=True)]
    before = [memory[0, RANGE, 3], *own.residual[:-1]]
    like = np.array(
        [log_densities(*row) for row in zip(own.residual, own.sigma, own.noise, before, strict=True)]
    )
    like[:, GOOD] = norm.logpdf(v, 0, np.sqrt(S + spare))
    A, chance = transition(memory[0, RANGE, 4]), memory[0, RANGE, :3]
    total = 0.0
    for path in itertools.product(range(3), repeat=6):
        p = chance @ A[:, path[0]]
        for a, b in itertools.pairwise(path):
            p *= A[a, b]
        total += p * np.exp(like[range(6), path].sum())
    found, *_ = status.log_evidence(rows, own, v, S, memory, -1)
    assert found == pytest.approx(np.log(total), rel=1e-9)


@settings(deadline=None, derandomize=True, max_examples=50)
@given(st.lists(st.floats(-1e6, 1e6), min_size=1, max_size=12), st.floats(1e-3, 1e3), st.floats(0.0, 1.0))
def test_probabilities_of_the_statuses_sum_to_one(residuals, s, share):
    memory = status.fresh_memory(1)[0, 0]
    for r in residuals:
        good, log_likelihood = status.filtered(memory, r * s, s, share * s * s)
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
    assert status.posterior(none, own, memory, -1) == 0.0
    assert not any(status.log_evidence(none, own, out.v, out.S, memory, -1))


@pytest.mark.parametrize(
    "share",
    [
        1.0,
        0.3,
        0.03,
    ],
)
def test_a_channel_recovers_from_one_outlier(share):
    """One gross error, then hundreds of good rows, window by window; ``share`` is R / s²."""
    rng, window, cut, count = np.random.default_rng(0), 20, 5, 300
    rows = Rows(
        np.arange(count),
        np.zeros(count, "i2"),
        np.zeros(count, "i1"),
        *(np.zeros(count),) * 2,
        np.zeros((count, 3)),
    )
    own = small.fresh(rows)
    own.sigma[:], own.noise[:] = 1.0, share
    own.residual[:] = 0.5 * rng.normal(size=count)
    own.residual[30] = 30.0
    memory, seen = status.fresh_memory(1), []
    for k in range(0, count - window, cut):
        part, mine = Rows(*(c[k : k + window] for c in rows)), type(own)(*(c[k : k + window] for c in own))
        status.posterior(part, mine, memory.copy(), -1)
        status.advance(Rows(*(c[:cut] for c in part)), type(own)(*(c[:cut] for c in mine)), memory)
        seen += mine.weight[:cut].tolist()
    assert seen[30] < 0.01
    assert min(seen[-100:]) > status.SURE
    assert memory[0, RANGE, 4] < 0.02
