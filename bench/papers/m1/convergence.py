"""How the genetic algorithm converges with the improved and with the classic roulette."""

from typing import NamedTuple

import numpy as np

from bench.accuracy import FIRST_SEED
from filters.correction import correction, ga, train


class Convergence(NamedTuple):
    """Means over the evolutions; g generations."""

    best: np.ndarray  # (g + 1,) mean squared error of the fittest up to then, sigma²
    mean: np.ndarray  # (g + 1,) of the population
    diversity: np.ndarray  # (g + 1,) spread of the genes, as share of the start's


def converge(u: np.ndarray, e: np.ndarray, plan: train.Plan, count: int) -> dict[str, Convergence]:
    """``count`` evolutions by each roulette on samples (m, 9) as from `correction.samples`."""
    out = {}
    for name, select in ga.SELECTIONS.items():
        runs = [_evolve(u, e, plan, select, FIRST_SEED + k) for k in range(count)]
        out[name] = Convergence(*np.mean(runs, axis=0))
    return out


def _evolve(u, e, plan, select, seed) -> Convergence:
    rng = np.random.default_rng(seed)
    pick = rng.permutation(len(u))[: train.GA_SAMPLES]
    u, e = u[pick], np.clip(e[pick], -train.LOST, train.LOST)
    means = []

    def fitness(population):
        w1, b1, w2, b2 = correction.unpack(population, plan.hidden)
        inside = np.tanh(u @ w1.transpose(0, 2, 1) + b1[:, None])
        left = inside @ w2.transpose(0, 2, 1) + b2[:, None] - e
        squares = (left**2).mean(axis=(1, 2))
        means.append(squares.mean())
        return 1.0 / (squares * e.size)

    begun = train.random_starts(plan.population, plan.hidden, rng)
    found = ga.evolve(fitness, begun, plan.generations, rng, select)
    return Convergence(1.0 / (found.fitness * e.size), np.array(means), found.diversity / found.diversity[0])
