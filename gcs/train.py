"""``gcs train``: learn the correction, test it on flights never seen, install it only if it helped.

Flights are split three ways, never within a flight: fit, check (stops the training, sets the gains) and held out.
Everything follows from the seed; a training that was stopped goes on where it was.
"""

import json
from collections.abc import Callable
from pathlib import Path
from typing import NamedTuple

import numpy as np

from filters import correction, train
from filters.correction import Network
from filters.estimator import Settings
from gcs import network, training
from gcs.training import Flown

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
    """Train into the folder ``out``: flights, network.json, report.json. Returns whether the network is good.

    ``flights`` simulated ones and run ``folders``; ``compare`` trainings of each kind of start go into the report.
    """
    first = 1000 * (plan.seed + 1)
    split = divide(training.gather(range(first, first + flights), folders, settings, out, _steps(say)))
    say(f"{len(split.fit)} flights to learn from, {len(split.check)} to check, {len(split.held_out)} held out")
    evolution = train.genetic_start(*pool(split.fit), plan, plan.seed)
    say(f"genetic start: fitness × {evolution.fitness[-1] / evolution.fitness[0]:.2f} in {plan.generations} generations")
    trained = train.backpropagate(evolution.best[None], pool(split.fit), pool(split.check), plan)
    net = assemble(trained.weights[0], plan, split)
    held_out = [effect(net, flown) for flown in split.held_out]
    report = {
        "training": plan._asdict() | {"filter": settings._asdict(), "flights": flights, "check_error": float(trained.error[0])},
        "data": {name: [flown.name for flown in part] for name, part in split._asdict().items()},
        "range": dict(limit=net.limit.round(3).tolist(), gain=net.gain.round(3).tolist()),
        "held_out": held_out,
        "total": total(held_out),
        "starts": starts(split, plan, compare) if compare else {},
    }
    out.mkdir(parents=True, exist_ok=True)
    (out / "report.json").write_text(json.dumps(report, indent=1) + "\n", encoding="utf-8")
    network.save(out / "network.json", net, report["training"], report["data"], report["total"])
    for line in table(report):
        say(line)
    good = earns(held_out)
    if good and install:
        install.parent.mkdir(parents=True, exist_ok=True)
        install.write_bytes((out / "network.json").read_bytes())
    say(verdict(good, report["total"], install))
    return good


def divide(flights: list[Flown]) -> Split:
    """Every fifth flight checks, the one after it is held out."""
    return Split(
        [flown for k, flown in enumerate(flights) if k % EVERY < EVERY - 2],
        flights[EVERY - 2 :: EVERY],
        flights[EVERY - 1 :: EVERY],
    )


def assemble(weights: np.ndarray, plan: train.Plan, split: Split) -> Network:
    """Weights (l,), the range they were trained in, and the gains that the check flights bear.

    The gain best for one flight and output is the least-squares one, Σ e ê / Σ ê². A low quantile of it is taken,
    so that an output that does harm to one flight in ten is off.
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
    """One flight without and with the correction: RMS errors, and squared error by the filter's own sigma (1 is right)."""
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
    out["off"] = float((np.clip(unseen[1], -train.LOST, train.LOST) ** 2).mean())
    return out


def table(report: dict) -> list[str]:
    """The report as lines for the terminal."""
    lines = [f"{'held-out flight':22s} {'position m':>22s} {'velocity m/s':>22s} {'error²/sigma²':>16s}"]
    for one in report["held_out"]:
        p, v, n = one["position_m"], one["velocity_mps"], one["nees"]
        lines.append(
            f"{one['flight']:22s} {p['off']:7.3f} {p['on']:7.3f} {p['ratio']:6.3f}"
            f" {v['off']:7.3f} {v['on']:7.3f} {v['ratio']:6.3f} {n['off']:8.2f} {n['on']:7.2f}"
        )
    for name, one in report["starts"].items():
        if name != "off":
            low, _, middle, _, high = one["after"]
            lines.append(
                f"start {name:9s} error before BP {one['before']:.4f}, after {low:.4f} {middle:.4f} {high:.4f}"
                + (f", diversity left {one['diversity']:.2f}, parents {one['parents']:.1f}" if "parents" in one else "")
            )
    return lines


def verdict(good: bool, totals: dict, install: Path | None) -> str:
    """One line: what was done with the network, and why."""
    position = totals["position_m"]
    figures = f"position error on held-out flights × {position['ratio']:.3f}, worst flight × {position['worst']:.3f}"
    if not good:
        return f"{figures}: does not earn its place, not installed"
    return f"{figures}: " + (f"installed as {install}" if install else "good; use it with --correction FILE")


def pool(flights: list[Flown]) -> tuple[np.ndarray, np.ndarray]:
    return np.concatenate([flown.u for flown in flights]), np.concatenate([flown.e for flown in flights])


def _steps(say):
    """Progress of a long count, every tenth step."""

    def step(done: int, wanted: int) -> None:
        if done % 10 == 0 or done == wanted:
            say(f"{done} of {wanted} flights flown")

    return step
