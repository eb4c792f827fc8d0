"""What happens to the station itself: a bounded file in the run folder, lines and events for the operator.

Everything goes through the logger ``gcs``: what any part logs as a warning or worse is written with its
traceback to ``station.log``, printed as one line, and sent as an ``Event``.
"""

import contextlib
import logging
import sys
import threading
import time
from collections.abc import Callable, Iterator, Sequence
from functools import partial
from logging.handlers import RotatingFileHandler
from pathlib import Path
from typing import Any

from gcs.contract.messages import Event
from gcs.contract.supervision import brief, log
from gcs.outputs.console import say
from gcs.outputs.disk import Beside

PATIENCE_S = 3.0  # at the end, for lines that still wait for the disk
FILE_BYTES, FILES = 2_000_000, 3  # of station.log and of each of its predecessors: 8 MB at most
REPEAT_S = 10.0  # the operator gets the same line once in so long; the file has all of them
EVENTS = logging.getLogger("gcs.event")  # events on their way anyway: for the file alone
LEVELS = {"info": logging.INFO, "warning": logging.WARNING, "error": logging.ERROR}


class EventHandler(logging.Handler):
    """Makes an event of each record; what fails in here makes none."""

    def __init__(self, send: Callable[[Event], None]):
        super().__init__(logging.INFO)
        self._send, self._busy = send, threading.local()
        self._sent_s: dict[str, float] = {}

    def emit(self, record: logging.LogRecord) -> None:
        if record.name == EVENTS.name or getattr(self._busy, "now", False):
            return
        text, now_s = record.getMessage(), time.monotonic()
        if now_s - self._sent_s.get(text, -REPEAT_S) < REPEAT_S:
            return
        self._sent_s = {t: s for t, s in self._sent_s.items() if now_s - s < REPEAT_S} | {text: now_s}
        level = {logging.INFO: "info", logging.WARNING: "warning"}.get(record.levelno, "error")
        self._busy.now = True
        try:
            self._send(Event(t_ns=time.time_ns(), level=level, text=text))
        except Exception:  # the bus itself may be what is broken; the file still has it
            EVENTS.exception("could not be sent: %s", text)
        finally:
            self._busy.now = False


class _File(RotatingFileHandler):
    """Written in a thread of its own, so that nobody waits for a disk that hangs.

    A full or broken disk costs the line and nothing else: the record's own event tells of the disk.
    """

    def __init__(self, path: Path, **options: Any):
        super().__init__(path, **options)
        self._beside = Beside()

    def emit(self, record: logging.LogRecord) -> None:
        self._beside.put(partial(super().emit, record))

    def handleError(self, record: logging.LogRecord) -> None:
        pass

    def close(self) -> None:
        if self._beside.end(PATIENCE_S):  # else closing would hang, too
            with contextlib.suppress(OSError):
                super().close()

    def format(self, record: logging.LogRecord) -> str:
        stack = getattr(record, "stack", "")
        return super().format(record) + (f"\n{stack.rstrip()}" if stack else "")


@contextlib.contextmanager
def opened(folder: Path | None, targets: Sequence[Callable[[Event], None]]) -> Iterator[None]:
    """While open, the logger ``gcs`` writes to ``folder`` and tells ``targets``.

    An exception that ends any thread, or that is raised where nobody can catch it, is logged as well.
    """

    def send(event: Event) -> None:
        say(f"{event.level}: {event.text}")
        for target in targets:
            target(event)

    handlers: list[logging.Handler] = [EventHandler(send)]
    if folder is not None:
        file = _File(folder / "station.log", maxBytes=FILE_BYTES, backupCount=FILES, encoding="utf-8")
        form = logging.Formatter("%(asctime)s.%(msecs)03dZ %(levelname)s %(threadName)s: %(message)s")
        form.converter, form.datefmt = time.gmtime, "%Y-%m-%dT%H:%M:%S"
        file.setFormatter(form)
        handlers.append(file)
    before = log.level, log.propagate, threading.excepthook, sys.unraisablehook
    log.setLevel(logging.INFO)
    threading.excepthook = lambda at: _uncaught(f"thread {getattr(at.thread, 'name', '?')}", at.exc_value)
    sys.unraisablehook = lambda at: _uncaught("a callback", at.exc_value)
    for handler in handlers:
        log.addHandler(handler)
    try:
        yield
    finally:
        for handler in handlers:
            log.removeHandler(handler)
            handler.close()
        log.level, log.propagate, threading.excepthook, sys.unraisablehook = before


def note(event: Event) -> None:
    """An event that is on its way anyway, into the file."""
    EVENTS.log(LEVELS.get(event.level, logging.WARNING), "%s", event.text)


def _uncaught(who: str, error: BaseException | None) -> None:
    if error is not None and not isinstance(error, SystemExit):
        log.error("%s ended: %s", who, brief(error), exc_info=error)
