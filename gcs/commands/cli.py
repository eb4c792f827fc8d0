"""The command ``gcs``: each command is a file of this folder or of ``after``, imported when it is asked for.

Exit codes: 0 done, 1 the run failed, 2 wrong usage or input (one line on stderr, no traceback).
"""

import sys

from cyclopts import App, CycloptsError

from gcs import __version__
from gcs.contract.messages import InputError

COMMANDS = {
    "replay": "After the flight: a tlog and ground-sensor feeds in, trajectory and verdicts out.",
    "run": "Live: MAVLink and ground sensors in over the bus, cleaned state out, view, recording.",
    "bridge": "One bridge alone, on whichever machine the instrument hangs on.",
    "report": "A run folder as one HTML page that opens offline: tables, figures, verdict, a place to sign.",
    "compare": "Two runs, or a run and a truth file: how far they are apart, and whether the sigmas hold.",
    "demo": "The sample flight with theodolites and a radar, live through Zenoh, in the browser.",
    "view": "The page alone, on any machine, showing what a station publishes.",
    "screen": "One raw feed, channel by channel, without a trajectory: cleaned feed, flags and a picture.",
    "train": "Train the correction network and test it on flights it has never seen.",
    "doctor": "Check Python, packages, station file, ports, listeners, router and clock before a flight.",
}

AFTER = ("report", "compare", "screen")  # of what a run or an instrument has left


def module_of(name: str) -> str:
    """The module that holds a command."""
    return f"gcs.commands.{'after.' if name in AFTER else ''}{name}"


app = App(name="gcs", version=__version__, help="Flight-test trajectory measurement: where was it really?")
for _name, _help in COMMANDS.items():
    app.command(f"{module_of(_name)}:command", name=_name, help=_help)


def main() -> None:
    """Entry point."""
    try:
        app(sys.argv[1:], exit_on_error=False, print_error=False)
    except CycloptsError as error:
        _refuse(" ".join(str(error).split()) + "; see gcs --help")
    except InputError as error:
        _refuse(str(error))
    except KeyboardInterrupt:  # before a command listens for it: while it waits for a router, say
        sys.exit(130)


def _refuse(line: str) -> None:
    shown = "".join(c if c.isprintable() else ascii(c)[1:-1] for c in line)  # what was given is shown in it
    print(f"gcs: {shown}", file=sys.stderr)
    sys.exit(2)
