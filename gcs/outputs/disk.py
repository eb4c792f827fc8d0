"""The files of a run folder, whatever the disk does, and the thread that writes them beside the fusion.

A disk that is full or read-only, a folder that is taken away: what should be written waits in memory and is
tried again once a second; a block is never written by half. What no longer fits in memory is counted as lost.
A file whose name has gone is written anew from the one still held open, so that nothing of it is lost.
"""

import os
import shutil
import threading
import time
from collections import deque
from collections.abc import Callable, Iterable
from contextlib import suppress
from pathlib import Path

from gcs.outputs.console import say

RETRY_S = 1.0  # between two attempts on a disk that refuses; also how often a file is looked for at its place
LAST_TRY_S = 3.0  # a file that its disk refuses is tried for so long at the end
FLAGS = os.O_RDWR | os.O_CREAT | os.O_APPEND
WAITING_BYTES = 8 * 2**20  # of one file that wait for its disk: minutes of tables, half a minute of recording
WAITING_WORK = 100_000  # rows and messages that wait for the writing thread: some minutes of a flight
IDLE_S = 0.1

Tell = Callable[[str, str], None]  # (level of an Event, text)


def to_operator(level: str, text: str) -> None:
    """Tell it on the terminal."""
    say(f"{level}: {text}")


class RunFile:
    """One file that is written from its beginning to its end. No fault of the disk is raised."""

    def __init__(self, path: Path, tell: Tell):
        self.path = path
        self.lost = 0  # units of what no longer fitted in memory
        self._tell = tell
        self._descriptor: int | None = None
        self._waiting: deque[tuple[bytes, int]] = deque()
        self._waiting_bytes = self._begun = 0  # … and how much of the first one is on the disk
        self._failing = False
        self._next_try_s = self._next_look_s = 0.0

    def write(self, block: bytes, units: int = 1) -> bool:
        """Append ``block``, whole or not at all; false where it had to be given up, counted by ``units``."""
        if self._waiting:
            self.flush()
        if self._waiting and self._waiting_bytes + len(block) > WAITING_BYTES:
            self.lost += units
            return False
        self._waiting.append((block, units))
        self._waiting_bytes += len(block)
        self.flush()
        return True

    def flush(self) -> None:
        """Put on the disk what waits, unless the disk has refused within the last second."""
        if self._descriptor is None and not self._waiting:
            return  # no file without content
        now_s = time.monotonic()
        if self._failing and now_s < self._next_try_s:
            return
        try:
            if now_s >= self._next_look_s:
                self._next_look_s = now_s + RETRY_S
                self._look()
            self._put()
        except OSError as error:
            self._next_try_s = self._next_look_s = now_s + RETRY_S
            if not self._failing:
                self._tell("error", f"{self.path}: {error.strerror}; it is tried again every {RETRY_S:g} s")
            self._failing = True
            return
        if self._failing:
            self._failing = False
            lost = f", {self.lost} blocks or rows are missing" if self.lost else ", nothing is missing"
            self._tell("info", f"{self.path}: written again{lost}")

    def sync(self) -> None:
        """Have the disk itself take what was written: a power cut then costs no more than a kill."""
        if self._descriptor is not None and not self._failing:
            try:
                os.fsync(self._descriptor)
            except OSError as error:
                self._tell("error", f"{self.path}: {error.strerror}; the disk may not hold what was written")

    def close(self) -> bool:
        """The end, tried for ``LAST_TRY_S``; false where the disk would not take all."""
        until_s = time.monotonic() + LAST_TRY_S
        self.flush()
        while self._waiting and time.monotonic() < until_s:
            time.sleep(RETRY_S / 10)
            self.flush()
        self.lost += sum(units for _, units in self._waiting)
        if self._descriptor is not None:
            os.close(self._descriptor)
            self._descriptor = None
        return not self._waiting

    def _look(self) -> None:
        """Is the file still where it was put? If not, it is made again from what is held open."""
        if self._descriptor is None:
            self._descriptor = os.open(self.path, FLAGS | os.O_TRUNC, 0o666)
            return
        held = os.fstat(self._descriptor)
        try:
            there = os.stat(self.path)
        except FileNotFoundError:
            there = None
        if there and (there.st_dev, there.st_ino) == (held.st_dev, held.st_ino):
            return
        self.path.parent.mkdir(parents=True, exist_ok=True)
        anew = os.open(self.path, FLAGS | os.O_EXCL, 0o666)
        try:
            with open(self._descriptor, "rb", closefd=False) as old, open(anew, "wb", closefd=False) as new:
                old.seek(0)
                shutil.copyfileobj(old, new)
        except OSError:
            os.close(anew)
            self.path.unlink(missing_ok=True)
            raise
        os.close(self._descriptor)
        self._descriptor = anew
        self._tell("error", f"{self.path}: was taken away; it is there again, whole")

    def _put(self) -> None:
        assert self._descriptor is not None
        while self._waiting:
            block, _ = self._waiting[0]
            while self._begun < len(block):
                self._begun += os.write(self._descriptor, memoryview(block)[self._begun :])
            self._waiting.popleft()
            self._waiting_bytes -= len(block)
            self._begun = 0


def replace(path: Path, parts: Iterable[str]) -> str:
    """Put a whole file in the place of an old one, which stays until then; returns why not, or nothing."""
    beside = path.with_name(path.name + ".new")
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        with beside.open("w", encoding="utf-8", newline="\n") as file:
            file.writelines(parts)
        beside.replace(path)
    except OSError as error:
        with suppress(OSError):
            beside.unlink(missing_ok=True)
        return error.strerror or str(error)
    return ""


class Beside:
    """A thread that does what is put to it, one after the other. What it has no room for is refused.

    ``idle`` is done where nothing has come for ``IDLE_S``, however long the one who puts takes.
    """

    def __init__(self, idle: Callable[[], object] = lambda: None):
        self._idle = idle
        self._work: deque[tuple[Callable[[], object], int]] = deque()
        self._size = 0
        self._changed = threading.Condition()
        self._ended = self._over = False
        self._steps = 0  # done so far: pieces of work, and parts of one that takes long
        self._failure: Exception | None = None
        self._thread = threading.Thread(target=self._run, name="run folder", daemon=True)
        self._thread.start()

    def put(
        self, work: Callable[[], object], size: int = 1, *, refuse: bool = True, wake: bool = True
    ) -> bool:
        """Have ``work`` done; false where more than ``WAITING_WORK`` waits already, by ``size``.

        Without ``wake`` it may wait for the next piece, or for ``IDLE_S``: who puts it has no time to share.
        """
        with self._changed:
            if refuse and self._size >= WAITING_WORK:
                return False  # one piece may be larger than all that may wait: it is taken
            self._work.append((work, size))
            self._size += size
            if wake:
                self._changed.notify()
        return True

    def check(self) -> None:
        """Raise what has failed since the last call."""
        failure, self._failure = self._failure, None
        if failure:
            raise failure

    def goes_on(self) -> None:
        """Called by a piece of work that takes long, after each part of it: nothing hangs."""
        with self._changed:
            self._steps += 1
            self._changed.notify_all()

    def wait(self, patience_s: float) -> None:
        """Until all is done that has been put, or nothing has gone on for so long."""
        with self._changed:
            self._wait_for(lambda: self._size == 0, patience_s)

    def end(self, patience_s: float) -> bool:
        """Do what is left; false where nothing has gone on for ``patience_s``: the disk hangs."""
        with self._changed:
            self._ended = True
            self._changed.notify_all()
            return self._wait_for(lambda: self._over, patience_s)

    def _wait_for(self, done: Callable[[], bool], patience_s: float) -> bool:
        seen, until_s = self._steps, time.monotonic() + patience_s
        while not done():
            if seen != self._steps:
                seen, until_s = self._steps, time.monotonic() + patience_s
            left_s = until_s - time.monotonic()
            if left_s <= 0.0:
                return False
            self._changed.wait(left_s)
        return True

    def _run(self) -> None:
        while True:
            with self._changed:
                self._changed.wait_for(lambda: self._work or self._ended, IDLE_S)
                if self._ended and not self._work:
                    self._over = True
                    self._changed.notify_all()
                    return
                work, size = self._work.popleft() if self._work else (self._idle, 0)
            try:
                work()
            except Exception as error:  # one block that cannot be written must not cost all that follow
                self._failure = error
            with self._changed:
                self._size -= size
                self._steps += 1
                self._changed.notify_all()
