"""Trials of an estimator.

python -m bench.trials flights --data DIR --share 0.04 --seeds 100:103 [--flight NAME ...] [--method default]
"""

import argparse
import importlib
import os
import sys

COMMANDS = {  # name → file and what it is about
    "flights": ("accuracy", "recorded and simulated flights with simulated instruments"),
    "autoferry": ("real.autoferry", "real radar and lidar of a ferry"),
    "stations": ("real.stations", "two real angle stations"),
    "gaps": ("gaps", "one radar, silent for a while"),
    "air": ("air", "one radar: air traffic, and drones with gaps"),
    "starts": ("starts", "many starts, by every subset of instruments"),
    "ramps": ("ramps", "trackers sliding off, slowly and fast"),
    "liar": ("liar", "one instrument that lies from some time on"),
    "world": ("rough", "simulated flights in a rough world: gusts, an autopilot's own errors, faults"),
    "ablation": ("ablation", "one part of the estimator after the other switched off"),
    "errors": ("errors", "systematic errors to recover"),
}


def main(arguments: list[str] | None = None) -> None:
    """One file a command, with ``options(parser)`` and ``main(asked)``."""
    for threads in ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "NUMBA_NUM_THREADS"):
        os.environ.setdefault(threads, "1")
    parser = argparse.ArgumentParser(prog="python -m bench.trials", description=__doc__.splitlines()[0])
    commands = parser.add_subparsers(dest="command", required=True)
    wanted = next((x for x in (sys.argv[1:] if arguments is None else arguments) if x in COMMANDS), None)
    for name, (file, says) in COMMANDS.items():
        sub = commands.add_parser(name, help=says)
        if name == wanted:
            importlib.import_module(f"bench.trials.{file}").options(sub)
    asked = parser.parse_args(arguments)
    importlib.import_module(f"bench.trials.{COMMANDS[asked.command][0]}").main(asked)


if __name__ == "__main__":
    main()
