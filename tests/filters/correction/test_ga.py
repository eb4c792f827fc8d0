"""The genetic algorithm: both roulettes against their definition, evolution against chance."""

import numpy as np
import pytest

from filters.correction import ga


def literal_improved(fitness, count, rng):
    """The paper's four steps, word by word."""
    pool = sorted(range(len(fitness)), key=lambda k: -fitness[k])
    chosen = []
    while len(chosen) < count:
        total = sum(fitness[k] for k in pool)
        r = rng.uniform(0.0, total)
        summed = 0.0
        for k in pool:
            summed += fitness[k]
            if summed > r:
                chosen.append(k)
                pool.remove(k)
                break
    return chosen


@pytest.mark.parametrize("seed", range(20))
def test_improved_roulette_is_the_papers(seed):
    fitness = np.random.default_rng(100 + seed).exponential(size=12)
    found = ga.improved_roulette(fitness, 6, np.random.default_rng(seed))
    assert found.tolist() == literal_improved(fitness.tolist(), 6, np.random.default_rng(seed))


def test_a_freak_is_a_parent_once_in_the_improved_roulette_only():
    fitness = np.array([1.0] * 19 + [1e6])
    rng = np.random.default_rng(0)
    improved = ga.improved_roulette(fitness, 10, rng)
    assert len(set(improved.tolist())) == 10
    assert 19 in improved
    assert (ga.classic_roulette(fitness, 10, rng) == 19).all()


def test_first_parent_is_chosen_in_proportion_to_fitness():
    fitness, rng = np.array([1.0, 5.0, 2.0, 2.0]), np.random.default_rng(1)
    for select in (ga.improved_roulette, ga.classic_roulette):
        first = np.array([select(fitness, 2, rng)[0] for _ in range(4000)])
        share = np.bincount(first, minlength=4) / 4000
        np.testing.assert_allclose(share, fitness / 10.0, atol=0.03)


def bowl(population):
    return 1.0 / (0.01 + ((population - 1.5) ** 2).mean(axis=1))


@pytest.mark.parametrize("select", ga.SELECTIONS.values(), ids=ga.SELECTIONS)
def test_evolution_beats_as_many_random_trials(select):
    rng = np.random.default_rng(2)
    start = rng.normal(size=(40, 8))
    evolved = ga.evolve(bowl, start, 60, rng, select)
    chance = bowl(rng.normal(size=(40 * 61, 8))).max()
    assert evolved.fitness[-1] > 2.0 * chance
    assert bowl(evolved.best[None])[0] == evolved.fitness[-1]
    assert (np.diff(evolved.fitness) >= 0.0).all()


def test_improved_roulette_keeps_the_population_more_different():
    start = np.random.default_rng(3).normal(size=(40, 8))
    left = {
        name: ga.evolve(bowl, start, 30, np.random.default_rng(4), select).diversity[-1]
        for name, select in ga.SELECTIONS.items()
    }
    assert left["improved"] > left["classic"]


def test_a_population_that_does_not_pair_up_is_refused():
    with pytest.raises(ValueError, match="multiple of 4"):
        ga.evolve(bowl, np.zeros((6, 2)), 1, np.random.default_rng(0))
