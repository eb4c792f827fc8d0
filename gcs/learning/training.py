"""``gcs train``: learn the correction, test it on flights never seen, install it only if it helped.

Flights are split three ways, never within a flight: fit, check (stops the training, sets the gains) and held
out. Everything follows from the seed; flights already flown are not flown again.

The correction goes into what is published and not back into the filter, so the filter's NIS is the same with
and without it. What can change is the squared error by the filter's own sigma: that is in the report.
"""

import json
from collections.abc import Callable
from importlib.util import find_spec
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from filters.correction import correction, train
from filters.correction.correction import Network
from filters.models.settings import Settings
from gcs.contract.messages import InputError
from gcs.learning import dataset, network
from gcs.learning.dataset import Flown

FIRST_FLIGHT = 1000  # times seed + 1: no two seeds fly the same
EVERY = 5  # of five flights three are for the fit, one checks, one is held out
INSIDE = 0.999  # share of the training inputs that lie in the range
BEARABLE = 0.1  # quantile over the check flights of the gain that is best for each
WORTH = 0.99  # pooled position error to that without, from which on a correction is worth having
WORSE = 1.005  # ... of a single flight, 1.00 to the digits reported
QUIET = 1e-12  # squared output below which a flight says nothing about the gain


class Split(NamedTuple):
    """Flights by purpose."""

    fit: list[Flown]
    check: list[Flown]
    held_out: list[Flown]


def run(
    out: Path,
    flights: int,
    folders: list[Path],
    plan: train.Plan,
    settings: Settings,
    compare: int,
    install: Path | None,
    say: Callable[[str], None],
) -> bool:
    """Train into folder ``out``: flights, network.json, report.json. Returns whether the network helps.

    ``flights`` simulated ones and run ``folders``; ``compare`` trainings per kind of start for the report.
    Raises InputError where torch is missing or too few flights are given.
    """
    if find_spec("torch") is None:
        raise InputError("training needs torch: pip install 'gcs-trajectory[train]'")
    if flights + len(folders) < EVERY:
        raise InputError(
            f"--flights {flights}: training needs {EVERY} flights or more, to learn and to check"
        )
    first = FIRST_FLIGHT * (plan.seed + 1)
    split = divide(dataset.gather(range(first, first + flights), folders, settings, out, _steps(say)))
    say(f"{len(split.fit)} flights to learn, {len(split.check)} to check, {len(split.held_out)} held out")
    net = learn(split, plan)
    held_out = [effect(net, flown) for flown in split.held_out]
    report: dict[str, Any] = {
        "training": plan._asdict()
        | {
            "filter": {name: None if value != value else value for name, value in settings._asdict().items()},
            "flights": flights,
        },
        "data": {name: [flown.name for flown in part] for name, part in split._asdict().items()},
        "network": {"limit": net.limit.round(3).tolist(), "gain": net.gain.round(3).tolist()},
        "held_out": held_out,
        "total": total(held_out),
        "starts": starts(split, plan, compare) if compare else {},
    }
    (out / "report.json").write_text(json.dumps(report, indent=1) + "\n", encoding="utf-8")
    network.save(out / "network.json", net, report["training"], report["data"], report["total"])
    good = earns(held_out)
    if good and install:
        install.parent.mkdir(parents=True, exist_ok=True)
        install.write_bytes((out / "network.json").read_bytes())
    for line in [*table(report), verdict(report["total"], install, good=good)]:
        say(line)
    return good


def learn(split: Split, plan: train.Plan, *, genetic: bool = True) -> Network:
    """The network that ``split`` teaches, from a genetic start or a random one."""
    fit, check = pool(split.fit), pool(split.check)
    if genetic:
        start = train.genetic_start(*fit, plan, plan.seed).best[None]
    else:
        start = train.random_starts(1, plan.hidden, np.random.default_rng(plan.seed))
    return assemble(train.backpropagate(start, fit, check, plan).weights[0], plan, split)


def divide(flights: list[Flown]) -> Split:
    """Every fifth flight checks, the one after it is held out."""
    return Split(
        [flown for k, flown in enumerate(flights) if k % EVERY < EVERY - 2],
        flights[EVERY - 2 :: EVERY],
        flights[EVERY - 1 :: EVERY],
    )


def assemble(weights: np.ndarray, plan: train.Plan, split: Split) -> Network:
    """Weights (l,), the range they were trained in, and the gains that the check flights bear.

    The gain best for one flight and output is the least-squares one, Σ e ê / Σ ê². A low quantile of it is
    taken, so that an output that does harm to one flight in ten is off.
    """
    u, _ = pool(split.fit)
    limit = np.quantile(np.abs(u), INSIDE, axis=0)
    raw = Network(*correction.unpack(weights.astype(float), plan.hidden), limit, np.ones(correction.CORE))
    best = []
    for flown in split.check:
        said = correction.respond_all(raw, flown.u)
        best.append((said * flown.e).sum(axis=0) / ((said**2).sum(axis=0) + QUIET))
    return raw._replace(gain=np.clip(np.quantile(best, BEARABLE, axis=0), 0.0, 1.0))


def effect(net: Network, flown: Flown) -> dict:
    """One flight without and with the correction: RMS errors, and squared error in sigmas (1 is right)."""
    left = flown.e - correction.respond_all(net, flown.u)
    out = {"flight": flown.name, "epochs": len(flown.u)}
    for name, k in (("position_m", 0), ("velocity_mps", 3), ("acceleration_mps2", 6)):
        part = slice(k, k + 3)
        off, on = (np.sqrt(((e * flown.sigma)[:, part] ** 2).sum(axis=1).mean()) for e in (flown.e, left))
        out[name] = {"off": float(off), "on": float(on), "ratio": float(on / off)}
    out["nees"] = {"off": float((flown.e**2).mean()), "on": float((left**2).mean())}
    return out


def total(held_out: list[dict]) -> dict:
    """Over all held-out flights: mean and worst ratio of each error, flights counting alike."""
    out = {}
    for name in ("position_m", "velocity_mps", "acceleration_mps2"):
        ratios = np.array([one[name]["ratio"] for one in held_out])
        out[name] = {
            "ratio": float(np.exp(np.log(ratios).mean())),
            "worst": float(ratios.max()),
            "best": float(ratios.min()),
        }
    return out


def earns(held_out: list[dict]) -> bool:
    """Whether the correction made the held-out flights better, and none of them worse."""
    position = total(held_out)["position_m"]
    return position["ratio"] <= WORTH and position["worst"] <= WORSE


def starts(split: Split, plan: train.Plan, count: int) -> dict:
    """``count`` trainings each from improved roulette, classic roulette and random weights, all in one batch.

    Error: mean squared, sigma², on the held-out flights, of networks with gain 1.
    """
    fit, unseen = pool(split.fit), pool(split.held_out)
    begun, out = {}, {}
    for name in ("improved", "classic"):
        runs = [train.genetic_start(*fit, plan._replace(selection=name), 100 + k) for k in range(count)]
        begun[name] = np.array([one.best for one in runs])
        out[name] = {
            "diversity": float(np.mean([one.diversity[-1] / one.diversity[0] for one in runs])),
            "parents": float(np.mean([one.parents.mean() for one in runs])),
            "fitness": float(np.mean([one.fitness[-1] / one.fitness[0] for one in runs])),
        }
    begun["random"] = train.random_starts(count, plan.hidden, np.random.default_rng(99))
    out["random"] = {}
    trained = train.backpropagate(np.concatenate(list(begun.values())), fit, unseen, plan)
    for name, first, error in zip(
        begun, np.split(trained.start_error, 3), np.split(trained.curve[-1], 3), strict=True
    ):
        spread = np.quantile(error, [0.0, 0.25, 0.5, 0.75, 1.0])
        out[name] |= {"before": float(np.median(first)), "after": spread.tolist()}
    nothing = float((np.clip(unseen[1], -train.LOST, train.LOST) ** 2).mean())
    return out | {"no network": {"after": [nothing] * 5}}


def table(report: dict) -> list[str]:
    """The report as lines for the terminal."""
    kinds = ("position_m", "velocity_mps", "acceleration_mps2")
    lines = [
        f"{'held-out flight':20s}" + "".join(f"{kind + ' off, on':>26s}" for kind in kinds) + "  error²/σ²"
    ]
    for one in report["held_out"]:
        errors = "".join(f"{one[k]['off']:10.3f}{one[k]['on']:8.3f}{one[k]['ratio']:8.3f}" for k in kinds)
        lines.append(f"{one['flight']:20s}{errors}{one['nees']['off']:7.2f}{one['nees']['on']:6.2f}")
    for name, one in report["starts"].items():
        low, _, middle, _, high = one["after"]
        line = f"{name:18s} mean squared error after BP {low:.4f} … {middle:.4f} … {high:.4f}"
        if "parents" in one:
            line += f", diversity left {one['diversity']:.2f}, parents {one['parents']:.1f}"
        lines.append(line)
    return lines


def verdict(totals: dict, install: Path | None, *, good: bool) -> str:
    """One line: what was done with the network, and why."""
    ratios = ", ".join(
        f"{kind} × {one['ratio']:.3f} (worst {one['worst']:.3f})" for kind, one in totals.items()
    )
    if not good:
        return f"held-out flights: {ratios}: position no better, not installed"
    return f"held-out flights: {ratios}: " + (
        f"installed as {install}" if install else "use it with --correction"
    )


def pool(flights: list[Flown]) -> tuple[np.ndarray, np.ndarray]:
    """(u, e) of all ``flights``, (m, 9) each."""
    return np.concatenate([flown.u for flown in flights]), np.concatenate([flown.e for flown in flights])


def _steps(say):
    """Progress of a long count, every tenth step."""

    def step(done: int, wanted: int) -> None:
        if done % 10 == 0 or done == wanted:
            say(f"{done} of {wanted} flights flown")

    return step
