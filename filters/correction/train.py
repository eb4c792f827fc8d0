"""Training the correction network: BP from starts that a genetic algorithm has found, or from random ones.

Every function takes k networks at once, as weights in a row (k, l), and runs them in one batch, on a GPU
where there is one. The only place that knows torch.
"""

from collections.abc import Callable
from typing import NamedTuple

import numpy as np

from filters.correction import correction, ga

HIDDEN = 12  # units
RATE = 3e-3  # Adam's first step, falling to zero over the epochs
BATCH = 2048
LOST = 10.0  # sigmas: a state farther off than that is lost, and nothing to learn from
GA_SAMPLES = 2048  # on which fitness is measured


class Plan(NamedTuple):
    """How a network is trained."""

    hidden: int = HIDDEN
    population: int = 40
    generations: int = 60
    epochs: int = 25
    selection: str = "improved"  # of ga.SELECTIONS
    seed: int = 0


class Trained(NamedTuple):
    """k networks."""

    weights: np.ndarray  # (k, l)
    start_error: np.ndarray  # (k,) mean squared error on the validation samples before BP, sigma²
    error: np.ndarray  # (k,) after, at the best epoch
    curve: np.ndarray  # (epochs, k)


def random_starts(count: int, hidden: int, rng: np.random.Generator) -> np.ndarray:
    """(count, l) weights, normal with 1-sigma 0.3: units of tanh begin in their linear part."""
    return rng.normal(0.0, 0.3, (count, correction.length(hidden)))


def genetic_start(u: np.ndarray, e: np.ndarray, plan: Plan, seed: int) -> ga.Evolution:
    """Weights to begin with, by the genetic algorithm; fitness is 1 / Σ (output − desired)², as in the paper.

    ``u``, ``e`` (m, 9) as from `correction.samples`.
    """
    rng = np.random.default_rng(seed)
    pick = rng.permutation(len(u))[:GA_SAMPLES]
    u, e = _tensor(u[pick]), _tensor(np.clip(e[pick], -LOST, LOST))

    def fitness(population):
        return 1.0 / (_mean_squares(_tensor(population), u, e, plan.hidden) * e.numel()).cpu().numpy()

    starts = random_starts(plan.population, plan.hidden, rng)
    return ga.evolve(fitness, starts, plan.generations, rng, ga.SELECTIONS[plan.selection])


def backpropagate(
    starts: np.ndarray,
    fit: tuple[np.ndarray, np.ndarray],
    check: tuple[np.ndarray, np.ndarray],
    plan: Plan,
    progress: Callable[[int], None] = lambda epoch: None,
) -> Trained:
    """Train k networks from ``starts`` (k, l) on ``fit``, each kept at its best epoch on ``check``.

    ``fit`` and ``check`` are (u, e) as from `correction.samples`; ``progress`` is told every epoch.
    """
    torch = _torch()
    u, check_u = _tensor(fit[0]), _tensor(check[0])
    e, check_e = (_tensor(np.clip(wanted, -LOST, LOST)) for wanted in (fit[1], check[1]))
    weights = _tensor(starts).requires_grad_()
    adam = torch.optim.Adam([weights], lr=RATE)
    falling = torch.optim.lr_scheduler.CosineAnnealingLR(adam, plan.epochs)
    shuffle = torch.Generator().manual_seed(plan.seed)
    with torch.no_grad():
        best_error = first = _mean_squares(weights, check_u, check_e, plan.hidden)
        best = weights.detach().clone()
    curve = []
    for epoch in range(plan.epochs):
        for part in torch.randperm(len(u), generator=shuffle).split(BATCH):
            adam.zero_grad()
            _mean_squares(weights, u[part], e[part], plan.hidden).sum().backward()
            adam.step()
        falling.step()
        with torch.no_grad():
            error = _mean_squares(weights, check_u, check_e, plan.hidden)
            better = error < best_error
            best[better], best_error = weights.detach()[better], torch.minimum(error, best_error)
        curve.append(error.cpu().numpy())
        progress(epoch)
    return Trained(best.cpu().numpy(), first.cpu().numpy(), best_error.cpu().numpy(), np.array(curve))


def _torch():
    import torch

    torch.set_num_threads(1)  # networks this small: handing work to a second core takes longer than doing it
    return torch


def _tensor(values):
    torch = _torch()
    return torch.tensor(values, dtype=torch.float32, device="cuda" if torch.cuda.is_available() else "cpu")


def _mean_squares(weights, u, e, hidden):
    """(k,) mean of (output − e)² of k networks over samples ``u``, ``e`` (m, 9)."""
    w1, b1, w2, b2 = _layers(weights, hidden)
    inside = (u @ w1.transpose(1, 2) + b1[:, None]).tanh()
    return (inside @ w2.transpose(1, 2) + b2[:, None] - e).square().mean(dim=(1, 2))


def _layers(weights, hidden):
    """As `correction.unpack`, of a tensor (k, l)."""
    n = correction.CORE
    w1, b1, w2, b2 = weights.split([hidden * n, hidden, n * hidden, n], dim=1)
    return w1.view(-1, hidden, n), b1, w2.view(-1, n, hidden), b2
