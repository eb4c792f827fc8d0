"""What the operator's terminal shows: one line while it runs, a table at the end."""

import sys
import time

import numpy as np
from rich.console import Console as Rich
from rich.table import Table

from gcs.contract.messages import VERDICTS
from gcs.station.session import Update

PERIOD_S = 0.5
screen = Rich(stderr=True, highlight=False)


def say(text: str) -> None:
    """One line for the operator."""
    screen.print(text, soft_wrap=True, markup=False)


class Console:
    """A sink. On a terminal it keeps one line up to date; elsewhere it is silent until the end."""

    def __init__(self):
        self._next_s = 0.0
        self._rows = self._outliers = 0

    def take(self, update: Update) -> None:
        self._rows += len(update.retired)
        self._outliers += int((update.retired["verdict"] >= VERDICTS.index("isolated")).sum())
        if not sys.stderr.isatty() or time.monotonic() < self._next_s or not len(update.track):
            return
        self._next_s = time.monotonic() + PERIOD_S
        newest = update.track[-1]
        e, n, u = newest["x"][:3]
        clock = time.strftime("%H:%M:%S", time.gmtime(newest["t_ns"] / 1e9))
        sys.stderr.write(
            f"\r\033[K{clock}Z  E {e:9.1f}  N {n:9.1f}  U {u:8.1f} m   "
            f"{self._rows:,} values final, {self._outliers:,} set aside"
        )
        sys.stderr.flush()

    def close(self, summary: dict, best: np.ndarray) -> None:
        if sys.stderr.isatty():
            sys.stderr.write("\r\033[K")
        table = Table("sensor", "channel", *VERDICTS, box=None, pad_edge=False)
        for sensor, channels in summary["verdicts"].items():
            for channel, counts in channels.items():
                table.add_row(sensor, channel, *(f"{counts[v]:,}" if v in counts else "·" for v in VERDICTS))
        screen.print(table)
