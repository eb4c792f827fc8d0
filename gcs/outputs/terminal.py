"""The terminal of a live station: one that takes nothing holds up nobody.

Ctrl-S, a pipe that nobody reads, a remote shell whose network is away: whoever writes then waits. In a live
station that would be the session, and with it the flight.
"""

import sys
from collections.abc import Iterator
from contextlib import contextmanager
from functools import partial
from typing import Any, TextIO

from gcs.outputs.disk import Beside

PATIENCE_S = 1.0  # at the end, for what still waits


class Unhindered:
    """In place of the text stream ``stream``: what is written goes there in a thread of its own.

    What no longer fits in memory is not shown; events are in the run folder anyway.
    """

    def __init__(self, stream: TextIO):
        self._stream = stream
        self._beside = Beside()

    def write(self, text: str) -> int:
        self._beside.put(partial(self._pass_on, text), len(text))
        return len(text)

    def flush(self) -> None:
        """Each piece is, as it is passed on."""

    def end(self) -> None:
        self._beside.end(PATIENCE_S)

    def __getattr__(self, name: str) -> Any:
        return getattr(self._stream, name)

    def _pass_on(self, text: str) -> None:
        self._stream.write(text)
        self._stream.flush()


@contextmanager
def unhindered() -> Iterator[None]:
    """While open, nobody who writes to stderr waits for it."""
    before = sys.stderr
    instead = Unhindered(before)
    sys.stderr = instead
    try:
        yield
    finally:
        sys.stderr = before
        instead.end()
