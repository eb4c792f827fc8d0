"""Training, where torch is there."""

from importlib.util import find_spec

import numpy as np
import pytest

from filters.correction import correction, train

pytestmark = [pytest.mark.torch, pytest.mark.skipif(find_spec("torch") is None, reason="needs torch")]

PLAN = train.Plan(hidden=6, population=16, generations=15, epochs=15)


def lesson(n, seed):
    """Inputs and a desired output that two units could give, with noise."""
    rng, law = np.random.default_rng(seed), np.random.default_rng(0)
    u = rng.normal(size=(n, 9))
    return u, np.tanh(u @ law.normal(size=(9, 2))) @ law.normal(size=(2, 9)) + rng.normal(0.0, 0.3, (n, 9))


FIT, CHECK = lesson(4000, 1), lesson(1000, 2)


def mean_squares(weights, u, e):
    """The same figure through the inference that flies."""
    net = correction.Network(*correction.unpack(weights, PLAN.hidden), np.full(9, 1e9), np.ones(9))
    return ((correction.respond_all(net, u) - e) ** 2).mean()


def test_training_learns_and_its_figure_is_that_of_the_inference():
    start = train.genetic_start(*FIT, PLAN, 0).best
    trained = train.backpropagate(start[None], FIT, CHECK, PLAN._replace(epochs=200))
    assert trained.error[0] < 0.6 * (CHECK[1] ** 2).mean()
    assert trained.error[0] == pytest.approx(mean_squares(trained.weights[0].astype(float), *CHECK), rel=1e-4)
    assert trained.start_error[0] == pytest.approx(mean_squares(start, *CHECK), rel=1e-4)


def test_fitness_is_the_inverse_of_the_sum_of_squares():
    small = tuple(part[: train.GA_SAMPLES] for part in FIT)
    found = train.genetic_start(*small, PLAN._replace(generations=0), 3)
    starts = train.random_starts(PLAN.population, PLAN.hidden, _after_the_pick(len(small[0]), 3))
    sums = [mean_squares(one, *small) * small[1].size for one in starts]
    assert 1.0 / found.fitness[-1] == pytest.approx(min(sums), rel=1e-3)


def _after_the_pick(samples, seed):
    rng = np.random.default_rng(seed)
    rng.permutation(samples)
    return rng


def test_many_networks_at_once_are_trained_as_one_by_one():
    starts = train.random_starts(3, PLAN.hidden, np.random.default_rng(5))
    together = train.backpropagate(starts, FIT, CHECK, PLAN).weights
    alone = [train.backpropagate(start[None], FIT, CHECK, PLAN).weights[0] for start in starts]
    np.testing.assert_allclose(together, alone, atol=1e-3)


def test_genetic_start_is_repeatable_and_follows_the_selection():
    first, second, other = (
        train.genetic_start(*FIT, PLAN._replace(selection=name), 1)
        for name in ("improved", "improved", "classic")
    )
    assert first.best.tobytes() == second.best.tobytes()
    assert (first.parents == PLAN.population // 2).all()
    assert other.parents.mean() < PLAN.population // 2
