"""What each part of the estimator is worth: one after the other is switched off, on the same rows.

flights  recorded ones, with outliers: RMS of the newest and of the best estimate over that of the whole
         estimator without the labelled rows, median and worst; epochs beyond 3 sigma, median, %; good values
         refused in 10,000, median; longest time above 5 m
liars    one of four instruments that lies in every channel (see liar.py): the worst error, m; misleading, %
"""

import argparse
from collections.abc import Iterator
from contextlib import ExitStack, contextmanager
from itertools import product
from operator import itemgetter
from typing import Any, NamedTuple
from unittest.mock import patch

import numpy as np

from bench.trials import common, flights, liar, run, scene, score
from filters.models import state
from filters.smoother import adaptation, bank, estimator, gated, proposals
from filters.smoother.bank import Bank

SEEN_S, LIARS = 60.0, "standard"
REDECIDE, AGAIN, STARTS = Bank.redecide, proposals.again, Bank._starts
SLOW_ERRORS = state._slow_errors


def _no_annealing(incumbent: Any, rows: Any, weight: np.ndarray, *, annealed: bool) -> Any:
    return incumbent.copy() if annealed else AGAIN(incumbent, rows, weight, annealed=False)


def _first_starts(self: Bank, rows: Any, **_: Any) -> list:
    return STARTS(self, rows) if self.best is None or self.best.young else []


def _zeros_alone(sensor: Any) -> dict:
    return SLOW_ERRORS(sensor._replace(slow=0.0))


class Part(NamedTuple):
    """What is put in the place of a part, and settings."""

    instead: tuple[tuple[object, str, object], ...] = ()
    settings: tuple[tuple[str, float], ...] = ()


def _kept(known: np.ndarray, *_: Any) -> np.ndarray:
    return known


PARTS = {
    "all there": Part(),
    "no proposal `without`": Part(
        ((Bank, "redecide", lambda self, rows, keep, _=(): REDECIDE(self, rows, keep)),)
    ),
    "no proposal `closing`": Part(((proposals, "going_wrong", lambda *_: []),)),
    "no proposal `again`": Part(((proposals, "again", _no_annealing),)),
    "no proposal `manoeuvre`": Part(((proposals, "manoeuvre", lambda incumbent, _: incumbent.copy()),)),
    "no proposal `start` but the first": Part(((Bank, "_starts", _first_starts),)),
    "no alternative that lives on": Part(((Bank, "_keep_alternative", lambda _self, _top, _ranked: None),)),
    "a run that has begun is no reason": Part(((proposals, "going_on", lambda _incumbent, _rows: False),)),
    "no prior odds of a change": Part(((bank, "INERTIA", 0.0),)),
    "no second look at a surprise": Part(((estimator, "SURPRISE_NS", gated.NEVER_NS // 2),)),
    "densities of the motion as set": Part(
        ((adaptation, "densities", _kept), (adaptation, "follow_motion", _kept))
    ),
    "usual densities as set": Part(((adaptation, "follow_motion", _kept),)),
    "noise as stated": Part(((adaptation, "follow_noise", _kept),)),
    "no slow errors of the instruments": Part(((state, "_slow_errors", _zeros_alone),)),
    "slow errors as large as the noise": Part(((adaptation, "follow_slow", _kept),)),
    "no gusts": Part(settings=(("gust_psd", 0.0),)),
    "errors of the INS are white": Part(settings=(("ins_bias_sigma_m", 0.0),)),
}
FIGURES = ("over_told", "over_told_smooth", "beyond3", "beyond3_smooth", "false", "far_s")
TITLES = ("/told", "worst", "/toldS", "worstS", ">3s%", ">3sS%", "false", "far_s", "liar m", "mislead%")


def options(parser: argparse.ArgumentParser) -> None:
    common.options(parser, __doc__, "100:101", flights.RECORDED)
    parser.add_argument("--share", type=float, default=0.15, help="of the values, outliers")
    parser.add_argument("--part", nargs="+", default=list(PARTS), choices=list(PARTS))


def main(asked: argparse.Namespace) -> None:
    flown = list(product(asked.part, asked.flight, asked.seeds))
    lied = list(product(asked.part, liar.LIES, liar.SINCE_S, asked.seeds))
    errors = common.by_key(flown, common.spread_out(fly, asked, flown), itemgetter(0))
    lies = common.by_key(lied, common.spread_out(lie, asked, lied), itemgetter(0))
    print(f"{asked.method}, outliers {100 * asked.share:g} %, seeds {common.told(asked.seeds)}, {SEEN_S:g} s")
    print(common.plain_table(TITLES, {part: line(errors[part], lies[part]) for part in asked.part}))


def line(flown: list[tuple], lied: list[tuple]) -> tuple:
    """Of the figures of one part: TITLES."""
    newest, best, beyond, beyond_best, false, far_s = np.array(flown).T
    worst_m, misleading = np.array(lied).T.max(axis=1)
    told = np.median(newest), newest.max(), np.median(best), best.max()
    honest = 100 * np.median(beyond), 100 * np.median(beyond_best), np.median(false), far_s.max()
    return *told, *honest, worst_m, 100 * misleading


def fly(asked: argparse.Namespace, case: tuple) -> tuple:
    """FIGURES of one flight without the part."""
    part, name, seed = case
    flight = flights.load(name, flights.folder(asked.data), seed, SEEN_S)
    seen = scene.watch(flight, scene.STANDARD, seed, scene.Wrong(asked.share))
    told = run.tried(seen, common.maker(asked), told=True)
    with off(part, asked) as changed:
        figures = score.figures(seen, run.tried(seen, common.maker(changed)), told)
    return tuple(figures[name] for name in FIGURES)


def lie(asked: argparse.Namespace, case: tuple) -> tuple:
    """(worst m, misleading) of one liar without the part."""
    part, kind, since_s, seed = case
    with off(part, asked) as changed:
        _, misleading, _, _, worst_m, *_ = liar.one(changed, (LIARS, kind, since_s, "normal", seed))
    return worst_m, misleading


@contextmanager
def off(part: str, asked: argparse.Namespace) -> Iterator[argparse.Namespace]:
    """While open, the estimator lacks the part; gives the options that go with that."""
    settings = [f"{name}={value}" for name, value in PARTS[part].settings]
    with ExitStack() as stack:
        for owner, name, instead in PARTS[part].instead:
            stack.enter_context(patch.object(owner, name, instead))
        yield argparse.Namespace(**vars(asked) | {"setting": asked.setting + settings})
