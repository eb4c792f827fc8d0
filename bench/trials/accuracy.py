"""Recorded and simulated flights, instruments simulated from the truth: the table of `columns`."""

import argparse
import json
from pathlib import Path

import numpy as np

from bench.trials import columns, common, flights, many, scene


def options(parser: argparse.ArgumentParser) -> None:
    """All that can be asked."""
    parser.description, parser.epilog = __doc__, columns.__doc__
    parser.formatter_class = argparse.RawDescriptionHelpFormatter
    parser.add_argument("--data", type=Path, help="folder of the recorded flights; else GCS_DATA")
    parser.add_argument("--flight", nargs="+", help=f"{', '.join(flights.names())}; default: all recorded")
    parser.add_argument("--share", type=float, default=0.04, help="of the values, outliers")
    common.seeds_option(parser, "100:101")
    parser.add_argument("--method", default="default", help="see run.make_estimator")
    parser.add_argument("--setting", nargs="*", default=[], metavar="NAME=VALUE", help="of the estimator")
    parser.add_argument("--sensors", nargs="+", default=list(scene.STANDARD), help=", ".join(scene.SITES))
    parser.add_argument("--seconds", type=float, default=flights.SPAN_S, help="0: the whole flight")
    parser.add_argument("--order", choices=["time", "receipt"], default="time")
    parser.add_argument("--jitter", type=float, default=0.0, help="of the stamps, s")
    parser.add_argument("--gaps", type=float, default=0.0, help="share of measurements lost in dropouts")
    parser.add_argument("--crooked", nargs="*", default=[], help="instruments with --zero and --clock")
    parser.add_argument("--zero", nargs=3, type=float, default=[0, 0, 0], help="m, deg, deg")
    parser.add_argument("--clock", type=float, default=0.0, help="s: stamps are late by it")
    parser.add_argument("--estimate", nargs="*", default=[], help="bias, clock: of all instruments")
    parser.add_argument("--no-peers", action="store_true", help="leave the small filters out")
    parser.add_argument("--no-told", action="store_true", help="leave the run with the labels told out")
    parser.add_argument("--jobs", type=int, default=2)
    parser.add_argument("--json", type=Path, help="also write all figures there")


def main(asked: argparse.Namespace) -> None:
    trial = trial_of(asked)
    names = asked.flight or list(flights.RECORDED)
    results = many.all_of(trial, names, asked.seeds, asked.jobs)
    print(
        f"{asked.method}, outliers {100 * asked.share:g} %, seeds {common.told(asked.seeds)}, "
        f"{' '.join(asked.sensors)}, {asked.seconds or 'all'} s; instruments simulated from the truth"
    )
    print(columns.table(results))
    if asked.json:
        asked.json.write_text(json.dumps(results, indent=1, default=float), encoding="utf-8")


def trial_of(asked: argparse.Namespace) -> many.Trial:
    """The trial that the options ask for."""
    zero = (asked.zero[0], *np.radians(asked.zero[1:]).tolist(), 0.0)
    wrong = scene.Wrong(asked.share, zero, asked.clock, tuple(asked.crooked), asked.jitter, asked.gaps)
    settings = tuple((name, float(x)) for name, x in (s.split("=") for s in asked.setting))
    return many.Trial(
        flights.folder(asked.data), asked.method, tuple(asked.sensors), wrong, tuple(asked.estimate),
        asked.seconds or None, asked.order, not asked.no_peers, not asked.no_told, settings,
    )  # fmt: skip
