"""What several commands share: their options, and the signals that end them."""

import os
import signal
import tempfile
import threading
from collections.abc import Callable
from pathlib import Path
from typing import Annotated

from cyclopts import Parameter

from gcs.contract.limits import FASTEST, LONGEST_S
from gcs.contract.messages import InputError
from gcs.outputs.console import say

StationFile = Annotated[
    Path | None, Parameter(help="station.toml; needed as soon as there are ground sensors")
]
Feeds = Annotated[
    tuple[str, ...], Parameter(consume_multiple=True, negative="", help="NAME=FILE.csv, one per instrument")
]
Correction = Annotated[str, Parameter(help="the learned part: off, or a network that gcs train wrote")]
Method = Annotated[
    str,
    Parameter(
        help="named estimator: default; ukf, gate, igg, ga-bp-ukf, the same with other weights; "
        "to compare with, wolf, imm and filterpy-ukf (slow: 0.3 ms a value)"
    ),
]
Overlay = Annotated[
    Path | None, Parameter(help="draw another run's best estimate, or a truth file, beside the flight")
]
Config = Annotated[
    tuple[str, ...],
    Parameter(consume_multiple=True, negative="", help="KEY=VALUE, any setting: ins.height_m=1.5"),
]


def on_signal(action: Callable[[], None]) -> None:
    """Call ``action`` at SIGINT or SIGTERM, in a thread: the handler may interrupt one that holds a lock."""
    heard, tell = os.pipe()

    def wait() -> None:
        os.read(heard, 1)
        action()

    threading.Thread(target=wait, daemon=True).start()
    for number in (signal.SIGINT, signal.SIGTERM):
        signal.signal(number, lambda *_: os.write(tell, b"."))


def stopped() -> threading.Event:
    """An event that SIGINT or SIGTERM sets."""
    stop = threading.Event()
    on_signal(stop.set)
    return stop


def speed_of(text: str) -> float:
    """Times real time; ``max`` is as fast as the machine goes. Raises ``InputError``."""
    try:
        speed = float("inf") if text == "max" else float(text)
    except ValueError:
        speed = 0.0
    if text != "max" and not 0 < speed <= FASTEST:
        raise InputError(f"--speed {text}: expected a number above 0 up to {FASTEST:g}, or max")
    return speed


def seconds_of(seconds: float | None) -> float | None:
    """How long to run; None: until stopped. Raises ``InputError``."""
    if seconds is not None and not 0 < seconds <= LONGEST_S:
        raise InputError(f"--seconds {seconds:g}: expected a number above 0 up to {LONGEST_S:g}")
    return seconds


def known_method(name: str) -> str:
    """The estimator's name, before anything is opened or written. Raises ``InputError``."""
    from filters.methods import METHODS  # numba takes its time: not for --help

    if name not in METHODS:
        raise InputError(f"--method {name}: unknown method; choose one of {', '.join(METHODS)}")
    return name


def run_folder(out: Path) -> Path:
    """``out`` where it is empty, else the first of OUT-2, OUT-3 … that is: a record is never written over.

    Raises ``InputError``.
    """
    folder, number = writable(out), 1
    named = out.resolve()  # "." and ".." are no names to number
    while any(folder.iterdir()):
        if not named.name:
            raise InputError(f"--out {out}: not empty; name a folder")
        number += 1
        folder = writable((out if out.name == named.name else named).with_name(f"{named.name}-{number}"))
    if folder != out:
        say(f"{out} is not empty; this run goes into {folder}")
    return folder


def metres_of(option: str, metres: float | None) -> float | None:
    """A tolerance; None: not stated. Raises ``InputError``."""
    if metres is not None and not 0 < metres < float("inf"):
        raise InputError(f"{option} {metres:g}: expected a number of metres above 0")
    return metres


def writable(folder: Path) -> Path:
    """The folder, made if need be, once a file could be written in it. Raises ``InputError``."""
    try:
        folder.mkdir(parents=True, exist_ok=True)
        with tempfile.TemporaryFile(dir=folder):
            pass
    except (OSError, ValueError) as error:
        why = getattr(error, "strerror", None) or error
        raise InputError(f"--out {folder}: {why}; name a folder that can be written") from None
    return folder


def new_file(path: Path) -> Path:
    """A file that is not there yet and could be written. Raises ``InputError``."""
    try:
        path.open("xb").close()
    except (OSError, ValueError) as error:
        why = getattr(error, "strerror", None) or error
        raise InputError(f"{path}: {why}; name a new file in a folder that is there") from None
    return path
