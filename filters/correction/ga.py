"""A genetic algorithm over real vectors, and the two ways of choosing parents that the GA-BP paper compares.

A generation: half of the population is chosen as parents, pairs of parents exchange genes, genes mutate,
parents and children are the next generation.
"""

from collections.abc import Callable
from typing import NamedTuple

import numpy as np

EXCHANGE = 0.5  # chance of a gene to come from the other parent: uniform crossover
MUTATION = 0.05  # chance of a child's gene to change
STEP = 0.3  # 1-sigma of that change; weights of a small tanh network are of the order of one


class Evolution(NamedTuple):
    """What became of a population; histories have one entry per generation, the start included."""

    best: np.ndarray  # (l,) the fittest individual of all generations
    fitness: np.ndarray  # (g + 1,) its fitness up to then
    diversity: np.ndarray  # (g + 1,) spread of the genes: 1-sigma over the population, mean over genes
    parents: np.ndarray  # (g,) how many different individuals became parents


def improved_roulette(fitness: np.ndarray, count: int, rng: np.random.Generator) -> np.ndarray:
    """``count`` different parents out of ``fitness`` (n,) > 0, as indices.

    The paper's steps: sort by fitness; draw r in (0, S), S the sum; add up from the first until the sum
    exceeds r; the last one added is a parent and leaves the pool; again with the new S.
    """
    order = np.argsort(fitness)[::-1]
    pool = fitness[order]
    chosen = np.empty(count, int)
    for k in range(count):
        total = np.cumsum(pool)
        r = rng.uniform(0.0, total[-1])
        last = min(int(np.searchsorted(total, r, side="right")), len(pool) - 1)
        chosen[k] = order[last]
        order, pool = np.delete(order, last), np.delete(pool, last)
    return chosen


def classic_roulette(fitness: np.ndarray, count: int, rng: np.random.Generator) -> np.ndarray:
    """``count`` parents out of ``fitness`` (n,) > 0, each with chance fitness / S, repeats allowed."""
    total = np.cumsum(fitness)
    r = rng.uniform(0.0, total[-1], count)
    return np.minimum(np.searchsorted(total, r, side="right"), len(fitness) - 1)


SELECTIONS = {"improved": improved_roulette, "classic": classic_roulette}


def evolve(
    fitness_of: Callable[[np.ndarray], np.ndarray],
    population: np.ndarray,
    generations: int,
    rng: np.random.Generator,
    select: Callable = improved_roulette,
) -> Evolution:
    """Let ``population`` (n, l), n a multiple of 4, evolve; ``fitness_of`` maps (n, l) to (n,) > 0."""
    if len(population) % 4:
        raise ValueError(
            f"population of {len(population)}: half of it pairs up, so it must be a multiple of 4"
        )
    fitness = fitness_of(population)
    best, top = population[fitness.argmax()], fitness.max()
    tops, spread, different = [top], [_diversity(population)], []
    for _ in range(generations):
        chosen = select(fitness, len(population) // 2, rng)
        parents = population[chosen]
        population = np.concatenate([parents, _mutate(_cross(parents, rng), rng)])
        fitness = fitness_of(population)
        if fitness.max() > top:
            best, top = population[fitness.argmax()], fitness.max()
        tops.append(top)
        spread.append(_diversity(population))
        different.append(len(np.unique(chosen)))
    return Evolution(best, np.array(tops), np.array(spread), np.array(different))


def _cross(parents: np.ndarray, rng: np.random.Generator) -> np.ndarray:
    """Neighbours pair up and swap about half of their genes: two children of every pair."""
    children = parents.copy()
    swap = rng.random((len(parents) // 2, parents.shape[1])) < EXCHANGE
    children[0::2][swap], children[1::2][swap] = parents[1::2][swap], parents[0::2][swap]
    return children


def _mutate(children: np.ndarray, rng: np.random.Generator) -> np.ndarray:
    hit = rng.random(children.shape) < MUTATION
    return children + hit * rng.normal(0.0, STEP, children.shape)


def _diversity(population: np.ndarray) -> float:
    return float(population.std(axis=0).mean())
