"""Filters side by side: how they mix, which is believed, and when the lock is lost."""

import numpy as np
import pytest

from filters.baselines import baselines, interacting
from filters.baselines.interacting import LOST, LOST_NS, LOST_ROWS, SILENT, SILENT_NS, STAY_S, Mixture
from filters.models import state as models
from filters.models.rows import AZIMUTH, RANGE, ROW
from filters.models.settings import Settings
from filters.smoother import passes
from tests.filters.scenes import sensors

SECOND_NS = 1_000_000_000
PSDS = np.array([[1.0, 1.0, 0.0, 0.0], [30.0, 30.0, 0.0, 0.0]])
AT = np.array([100.0, 400.0, 200.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0])


def mixture(chance=(0.5, 0.5)) -> Mixture:
    """Filters that agree, one for each chance."""
    m = len(chance)
    return Mixture(
        np.tile(AT, (m, 1)), np.tile(np.eye(9), (m, 1, 1)), np.array(chance), np.zeros(2, np.int64)
    )


def follow(start: Mixture, channel: int, t_ns: np.ndarray, value: np.ndarray):
    """Rows of one theodolite: (rows taken, epochs, why it ended), and what was made of them."""
    model = baselines.make("wolf", sensors(["theo-a"], slow=0.0), Settings()).model
    rows, k, n = np.zeros(len(t_ns), ROW), len(t_ns), len(model.prior)
    rows["channel"], rows["t_ns"], rows["value"] = channel, t_ns, value
    judged = interacting.Followed(*np.zeros((4, k)), np.zeros((k, n)), np.zeros((k, n, n)))
    ended = interacting.follow(
        model, baselines.columns(model, rows), 0, PSDS[: len(start.chance)], True, start, judged,
        passes.trace(1, n, 1), models.scratch(n),
    )  # fmt: skip
    return ended, judged


def seen_range() -> float:
    model = baselines.make("wolf", sensors(["theo-a"], slow=0.0), Settings()).model
    return float(np.linalg.norm(AT[:3] - model.offset[0]))


def test_a_position_believed_holds_the_lock():
    start, t_ns = mixture(), np.arange(1, 21) * SECOND_NS
    ended, judged = follow(start, RANGE, t_ns, np.full(20, seen_range()))
    assert ended == (20, 20, 0)
    assert start.lock.tolist() == [t_ns[-1], 0]
    assert (judged.weight > 0.9).all()


def test_the_lock_is_lost_after_time_and_rows():
    """Both are asked for: a slow instrument may be off for two seconds with a single row."""
    fast, slow = np.arange(1, 101) * LOST_NS // 40, np.arange(1, 31) * LOST_NS // 4
    for t_ns in (fast, slow):
        (taken, _, why), judged = follow(mixture(), RANGE, t_ns, np.full(len(t_ns), 9e4))
        assert why == LOST
        assert t_ns[taken] > LOST_NS >= t_ns[taken - 1] or taken == LOST_ROWS
        assert taken >= LOST_ROWS
        assert (judged.weight[:taken] < interacting.BELIEVED).all()


def test_silence_ends_it_too():
    t_ns = np.array([1, 2, 3 + SILENT_NS // SECOND_NS, 4 + SILENT_NS // SECOND_NS]) * SECOND_NS
    ended, _ = follow(mixture(), RANGE, t_ns, np.full(4, seen_range()))
    assert ended == (2, 2, SILENT)


def test_the_filter_that_fits_is_believed():
    """Of rows without a manoeuvre the calm one gains: the other expects larger steps."""
    start = mixture()
    follow(start, RANGE, np.arange(1, 41) * SECOND_NS // 10, np.full(40, seen_range()))
    assert start.chance.sum() == pytest.approx(1.0)
    assert start.chance[0] > 0.6


def test_chances_are_those_of_bayes():
    """At nearly one instant nothing is mixed: the density of each epoch once, of each filter alone."""
    t_ns, value, wide = np.array([1, 2, 3]), np.full(3, seen_range()), np.array([1.0, 4.0])
    start = mixture()
    start.P[:] = start.P * wide[:, None, None]
    density = np.ones(2)
    for k in range(2):
        alone = Mixture(
            start.x[k : k + 1].copy(), start.P[k : k + 1].copy(), np.ones(1), np.zeros(2, np.int64)
        )
        density[k] = 1.0 / np.prod(follow(alone, RANGE, t_ns, value)[1].sigma)  # of values that fit exactly
    follow(start, RANGE, t_ns, value)
    assert start.chance == pytest.approx(density / density.sum(), rel=1e-4)


def test_an_epoch_counts_once_however_many_rows_it_has():
    t_ns = np.repeat(np.arange(1, 6) * SECOND_NS, 2)
    ended, judged = follow(mixture(), AZIMUTH, t_ns, np.zeros(10))
    assert ended[:2] == (10, 5)
    assert (judged.x[:5] != 0).any()
    assert (judged.x[5:] == 0).all()


def test_mixing_keeps_the_whole():
    """Mean and covariance of all filters together are what they were, whatever is passed between them."""
    rng = np.random.default_rng(3)
    root = rng.normal(size=(2, 4, 4))
    start = Mixture(
        rng.normal(size=(2, 4)), root @ root.transpose(0, 2, 1), np.array([0.8, 0.2]), np.zeros(2, np.int64)
    )
    before, after = (np.zeros(4), np.zeros((4, 4))), (np.zeros(4), np.zeros((4, 4)))
    interacting.blend(start, start.chance, *before)
    interacting.mix(start, 0.7)
    interacting.blend(start, start.chance, *after)
    assert np.allclose(after[0], before[0])
    assert np.allclose(after[1], before[1])


def test_chances_change_as_a_markov_chain():
    """Two regimes that each last ``STAY_S`` in the mean: d p₁/dt = (p₂ − p₁) / STAY_S."""
    steps, dt = 1000, 1.5 / 1000
    start, p = mixture((0.9, 0.1)), 0.9
    for _ in range(steps):
        p += dt * ((1.0 - p) - p) / STAY_S
    interacting.mix(start, 1.5)
    assert start.chance[0] == pytest.approx(p, abs=1e-3)


def test_one_filter_alone_mixes_with_nobody():
    start = mixture((1.0,))
    interacting.mix(start, 5.0)
    assert np.array_equal(start.x[0], AT)
    assert np.array_equal(start.P[0], np.eye(9))


def test_blend_keeps_mean_and_spread():
    """Against samples drawn from the mixture."""
    rng = np.random.default_rng(5)
    mixture = interacting.Mixture(
        np.array([[0.0, 1.0], [3.0, -1.0]]), np.array([np.eye(2), 4 * np.eye(2)]), np.ones(2),
        np.zeros(2, np.int64),
    )  # fmt: skip
    share, x, P = np.array([0.3, 0.7]), np.zeros(2), np.zeros((2, 2))
    interacting.blend(mixture, share, x, P)
    which = (rng.random(200_000) < share[1]).astype(int)
    drawn = mixture.x[which] + rng.normal(size=(200_000, 2)) * np.array([1.0, 2.0])[which, None]
    assert np.allclose(x, drawn.mean(axis=0), atol=0.02)
    assert np.allclose(P, np.cov(drawn.T), atol=0.06)
