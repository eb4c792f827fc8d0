"""What several commands share: their options, and the signals that end them."""

import os
import signal
import threading
from collections.abc import Callable
from pathlib import Path
from typing import Annotated

from cyclopts import Parameter

StationFile = Annotated[
    Path | None, Parameter(help="station.toml; needed as soon as there are ground sensors")
]
Feeds = Annotated[
    tuple[str, ...], Parameter(consume_multiple=True, negative="", help="NAME=FILE.csv, one per instrument")
]
Correction = Annotated[str, Parameter(help="the learned part: off, or a network that gcs train wrote")]
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
