"""Trials of an estimator.

python -m bench.trials flights --data DIR --share 0.04 --seeds 100:103 [--flight NAME ...] [--method default]
"""

import argparse
import importlib
import os
import sys

COMMANDS = {
    "flights": "recorded and simulated flights with simulated instruments",
    "autoferry": "real radar and lidar of a ferry",
    "gaps": "one radar, silent for a while",
    "air": "one radar: air traffic, and drones with gaps",
}


def main(arguments: list[str] | None = None) -> None:
    """One file a command: ``command_NAME.py`` with ``options(parser)`` and ``main(asked)``."""
    for threads in ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "NUMBA_NUM_THREADS"):
        os.environ.setdefault(threads, "1")
    parser = argparse.ArgumentParser(prog="python -m bench.trials", description=__doc__.splitlines()[0])
    commands = parser.add_subparsers(dest="command", required=True)
    wanted = next((x for x in (sys.argv[1:] if arguments is None else arguments) if x in COMMANDS), None)
    for name, says in COMMANDS.items():
        sub = commands.add_parser(name, help=says)
        if name == wanted:
            module = importlib.import_module(f"bench.trials.command_{name}")
            module.options(sub)
    asked = parser.parse_args(arguments)
    importlib.import_module(f"bench.trials.command_{asked.command}").main(asked)


if __name__ == "__main__":
    main()
