"""Runs of outliers: their level, what they cost, what is none, and that a channel recovers."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.stats import norm

from filters.models import runs
from filters.models.rows import RANGE
from filters.smoother import status
from filters.smoother.buffer import Rows
from tests.filters.smoother.kit import small
from tests.filters.smoother.test_status import open_

pytestmark = pytest.mark.decision


STEP_NS = 50_000_000
NO = -700.0  # log density of a gross error that is out of the question
LINES = {"bending": (runs.BENDING, runs.BEND), "steady": (runs.STEADY, runs.DRIFT)}  # where, and how it turns


def followed(residuals, s=1.0, noise=1.0):
    """(memory (MEMORY,), P(good), log likelihood of each) of one channel, row by row."""
    memory = status.fresh_memory(1)[0, 0]
    out = [status.filtered(memory, r, s, noise, k * STEP_NS) for k, r in enumerate(residuals)]
    return memory, *np.array(out).T


def test_the_level_of_a_run_is_the_mean_of_its_rows():
    memory, good, _ = followed([0.1, 8.0, 9.0, 8.5, 8.5])
    assert max(good[1:]) < 0.01
    assert memory[runs.LEVEL] == pytest.approx(8.5, abs=0.2)
    assert memory[runs.BENDING + runs.LINE] == pytest.approx(8.5, abs=0.3)
    assert memory[runs.STEADY + runs.LINE] == pytest.approx(8.5, abs=0.3)
    assert memory[runs.VARIANCE] < 0.7  # of its own noise, and what the level may have moved


def test_a_further_row_of_a_run_costs_little_and_one_elsewhere_much():
    on, off = (followed([0.1, 9.0, 9.3, 9.1, r])[2][-1] for r in (9.0, -9.0))
    assert status.log_good(0.0, 1.0) - on < 1.5
    assert status.log_good(0.0, 1.0) - off > 4.0


@pytest.mark.parametrize("rate", [0.0, 9.0])
@pytest.mark.parametrize("size", [30.0, 1e4])
def test_a_smooth_run_costs_the_same_however_large_it_is_in_sigmas(size, rate):
    """Of a mirror image the sharper instrument must not be the one that is believed."""
    noise = np.random.default_rng(3).normal(size=40)
    _, good, likelihood = followed([0.0, *(size + rate * np.arange(40) + noise)])
    assert max(good[2:]) < 0.01
    assert (status.log_good(0.0, 1.0) - likelihood[15:]).mean() < 2.0


def test_the_three_ways_are_alike_before_the_first_row_and_then_told_apart():
    begun = followed([0.0, 60.0])[0]
    assert begun[[runs.BENDING + runs.P, runs.STEADY + runs.P]] == pytest.approx(1 / 3, abs=0.01)
    rng, k = np.random.default_rng(4), np.arange(25)
    loose, steady = 60.0 * rng.uniform(0.8, 1.2, 25), 60.0 + 0.5 * k + rng.normal(size=25)
    turning = 60.0 + 25.0 * np.sin(0.2 * k) + rng.normal(size=25)
    ways = {"loose": followed(loose)[0], "bending": followed(turning)[0], "steady": followed(steady)[0]}
    found = {name: way(m) for name, m in ways.items()}
    assert found["loose"][0] > 0.8
    assert found["bending"][1] > 0.8
    assert found["steady"][2] > 0.8


def way(m):
    """P(loose), P(bending), P(steady)."""
    bending, steady = m[runs.BENDING + runs.P], m[runs.STEADY + runs.P]
    return 1.0 - bending - steady, bending, steady


def only(memory, line):
    """The same memory, sure of one line."""
    m = memory.copy()
    m[[at + runs.P for at, _ in LINES.values()]] = 0.0
    m[line + runs.P] = 1.0
    return m


def costs(residuals, line):
    """(k,) log densities of the rows of a run that is sure to be on this ``line``, after its first one."""
    m, out = np.zeros(runs.MEMORY), []
    runs.follow(m, residuals[0], 1.0, 0.0, NO, 1.0, 0.0, 0.0, 0.05)
    m = only(m, line)
    for r in residuals[1:]:
        gross = status.log_gross(r, 1.0)
        density, bending, steady = runs.log_run(m, r, 1.0, 0.0, gross, 0.05)
        assert (bending, steady) == ((1.0, 0.0) if line == runs.BENDING else (0.0, 1.0))
        runs.follow(m, r, 1.0, 0.0, gross, 0.0, bending, steady, 0.05)
        out.append(density)
    return np.array(out)


@pytest.mark.parametrize("jump", [30.0, 450.0, -4000.0])
def test_a_line_that_jumps_goes_on_from_there(jump):
    """As residuals of a start, whose first row knows little: such a rate would take rows to forget."""
    residuals = np.concatenate([[1000.0], 1000.0 + jump + np.random.default_rng(3).normal(size=12)])
    density = costs(residuals, runs.STEADY)  # a good row costs 1.4
    assert np.median(density[2:]) > -2.0
    assert density[2:].sum() > -40.0


@pytest.mark.parametrize("slope", [0.0, 0.2, 5.0])
def test_an_offset_and_a_ramp_cost_much_less_as_a_steady_run(slope):
    """Of 50 rows, 2.5 s: 0.3 nats each and more, which over the run are odds of millions."""
    residuals = 40.0 + slope * np.arange(50) + np.random.default_rng(7).normal(size=50)
    bending, steady = (costs(residuals, line)[3:].mean() for line in (runs.BENDING, runs.STEADY))
    assert steady > bending + 0.3
    found = followed([0.0, *residuals])
    assert way(found[0])[2] > 0.95
    assert (status.log_good(0.0, 1.0) - found[2][15:]).mean() < 1.1  # half a nat is the noise's own


def test_values_once_more_that_bend_are_a_bending_run():
    """A target that turns while an instrument repeats what it said: the error grows, turns, comes back."""
    t = 0.05 * np.arange(60)
    residuals = 30.0 + 60.0 * (1.0 - np.cos(2.5 * t)) + np.random.default_rng(8).normal(size=60)
    bending, steady = (costs(residuals, line).sum() for line in (runs.BENDING, runs.STEADY))
    assert bending > steady + 50.0
    found = followed([0.0, *residuals])
    assert way(found[0])[1] > 0.95
    assert max(found[1][2:]) < 0.01


@pytest.mark.parametrize("name", LINES)
def test_a_line_is_that_of_a_textbook_filter(name):
    """Level and rate of a run that has begun for certain: Kalman with white acceleration, in matrices."""
    rng, noise, fresh, dt = np.random.default_rng(5), 0.7, 0.3, 0.1
    (at, turn), m = LINES[name], np.zeros(runs.MEMORY)
    runs.follow(m, 20.0, noise, fresh, NO, 1.0, 0.5, 0.5, dt)
    x, P = np.array([20.0, 0.0]), np.diag([noise, 400.0])
    F, q = np.array([[1.0, dt], [0.0, 1.0]]), turn**2 * noise
    Q = q * np.array([[dt**3 / 3, dt**2 / 2], [dt**2 / 2, dt]]) + np.diag([fresh, 0.0])
    for r in 20.0 + np.arange(1, 8) + rng.normal(size=7):
        before = only(m, at)
        runs.follow(m, r, noise, fresh, NO, 0.0, 0.5, 0.5, dt)
        x, P = F @ x, F @ P @ F.T + Q
        density, *_ = runs.log_run(before, r, noise, fresh, -50.0, dt)
        far = norm.sf(runs.LEAST * np.sqrt(noise), x[0], np.sqrt(P[0, 0]))  # far enough off for a run
        expected = norm.logpdf(r, x[0], np.sqrt(P[0, 0] + noise))
        assert density == pytest.approx(np.log(runs.stay(before) * far) + expected)
        gain = P[:, 0] / (P[0, 0] + noise)
        x, P = x + gain * (r - x[0]), P - np.outer(gain, P[0])
        assert m[[at + runs.LINE, at + runs.RATE]] == pytest.approx(x)
        assert m[[at + runs.SHARP, at + runs.BOTH, at + runs.STEEP]] == pytest.approx(P[[0, 0, 1], [0, 1, 1]])


@settings(deadline=None, derandomize=True, max_examples=100)
@given(st.lists(st.floats(-1e5, 1e5), min_size=1, max_size=15), st.floats(-1e5, 1e5))
def test_the_ways_of_a_run_are_probabilities(residuals, last):
    """None below 0, nor both lines above 1, before a row and after it."""
    m, *_ = followed(residuals)
    for lines in (
        (m[runs.BENDING + runs.P], m[runs.STEADY + runs.P]),
        runs.log_run(m, last, 1.0, 0.0, status.log_gross(last, 1.0), 0.05)[1:],
    ):
        assert min(lines) >= 0.0
        assert sum(lines) <= 1.0 + 1e-12


def test_a_further_row_of_a_run_is_somewhere():
    """The integral of its density over all residuals is 1, of a run that is far enough off."""
    m = followed([0.0, 60.0, 61.0, 59.5, 60.2, 60.1])[0]
    near = np.linspace(40.0, 80.0, 8001)
    fine = [np.exp(runs.log_run(m, v, 1.0, 0.0, status.log_gross(v, 1.0), 0.05)[0]) for v in near]
    gross = (1.0 - runs.stay(m)) * (
        1.0 - (np.arctan(8.0) - np.arctan(4.0)) / np.pi
    )  # the Cauchy's part elsewhere
    total = np.trapezoid(fine, near) + gross
    assert total == pytest.approx(1.0, abs=2e-3)


# ---- how long it lasts


def aged(rows):
    m = np.zeros(runs.MEMORY)
    runs.follow(m, 30.0, 1.0, 0.0, NO, 1.0, 0.0, 0.0, 0.05)
    for _ in range(rows - 1):
        runs.follow(m, 30.0, 1.0, 0.0, NO, 0.0, 0.3, 0.3, 0.05)
    return m


def test_a_run_goes_on_the_likelier_the_longer_it_has_lasted():
    assert runs.stay(aged(1)) == pytest.approx(1.0 - 1.0 / runs.ROWS)
    found = [runs.stay(aged(rows)) for rows in range(1, 60)]
    assert found == pytest.approx([1.0 - 1.0 / (runs.ROWS + age) for age in range(59)])
    assert (np.diff(found) > 0.0).all()


def test_half_of_all_runs_have_fewer_rows_than_the_constant():
    """Pareto: P(more than n rows) = (ROWS − 1) / (ROWS − 1 + n)."""
    going_on = np.cumprod([runs.stay(aged(rows)) for rows in range(1, 200)])  # P(more than n rows)
    n = np.arange(1, 200)
    assert going_on == pytest.approx((runs.ROWS - 1.0) / (runs.ROWS - 1.0 + n))
    assert going_on[int(runs.ROWS) - 2] == pytest.approx(0.5)  # nine rows or fewer


def test_another_begin_is_of_no_age_and_a_likely_one_of_its_share():
    m = aged(20)
    assert m[runs.AGE] == 19.0
    half = m.copy()
    runs.follow(half, 30.0, 1.0, 0.0, NO, 0.5, 0.3, 0.3, 0.05)
    assert half[runs.AGE] == pytest.approx(0.5 * 20.0)
    runs.follow(m, -80.0, 1.0, 0.0, NO, 1.0, 0.3, 0.3, 0.05)
    assert m[runs.AGE] == 0.0
    assert way(m) == pytest.approx((1 / 3, 1 / 3, 1 / 3))
    assert runs.stay(m) == pytest.approx(1.0 - 1.0 / runs.ROWS)


def test_a_channel_that_recovers_forgets_how_long_its_run_was():
    m, good, _ = followed([0.0, *[40.0] * 30, *[0.0] * 20, 40.0, 40.0])
    assert max(good[2:31]) < 0.01
    assert min(good[32:51]) > status.SURE
    assert m[runs.AGE] == pytest.approx(1.0, abs=0.01)


def test_what_moves_the_prediction_moves_the_level_the_other_way():
    m = followed([0.0, 30.0, 30.0])[0]
    before = m.copy()
    runs.move(m, 2.0)
    levels = runs.LEVEL, *(at + runs.LINE for at, _ in LINES.values())
    assert before - m == pytest.approx(np.isin(np.arange(runs.MEMORY), levels) * 2.0)


def test_a_run_of_a_vague_prediction_goes_on_at_its_level():
    """Rows of a channel that is not used share the prediction's error: 2 s off, and yet not good."""
    _, good, _ = followed([0.1, 12.0, 12.1, 11.9, 12.0, 12.1, 11.8], s=6.0, noise=1.0)
    assert good[-1] < 0.2


def test_rows_that_fit_are_no_run():
    """What is correlated, as an INS's errors are, has no level beyond its own noise."""
    _, good, _ = followed([2.5, *[1.0] * 10, *[-1.0] * 10])
    assert min(good[-15:]) > status.SURE


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
        np.arange(count) * STEP_NS,
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
        status.posterior(part, mine, memory.copy(), open_(part), False)
        status.advance(Rows(*(c[:cut] for c in part)), type(own)(*(c[:cut] for c in mine)), memory)
        seen += mine.weight[:cut].tolist()
    assert seen[30] < 0.01
    assert min(seen[-100:]) > status.SURE
    assert memory[0, RANGE, runs.CHANCE] < 0.02
