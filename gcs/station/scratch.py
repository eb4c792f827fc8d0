"""What is final of a flight, and its best estimate, on the disk: those of a day would not fit into memory.

The files have no name: they go with the process, however it ends. A thread of its own writes them. What the
disk has not taken yet, because it is slow, full or hangs, stays in memory, and nobody waits for it.
"""

import os
import threading
import weakref
from collections.abc import Callable
from pathlib import Path
from tempfile import TemporaryFile

import numpy as np

from filters.models.store import InMemory, Store
from gcs.contract.supervision import brief

PERIOD_S = 0.1  # between two writes
RETRY_S = 1.0  # … where the disk refuses
PATIENCE_S = 5.0  # at the end, for a disk that takes nothing
PIECE_BYTES = 2**25  # written at once; more waits only after the disk has refused for long


class Scratch:
    """Makes the stores of one run, on the disk of ``folder``; ``tell`` is called once if that refuses.

    After the end, as a context, no more is written; what there is can still be read.
    """

    def __init__(self, folder: Path, tell: Callable[[str, str], None]):
        self._folder, self._tell, self._said = folder, tell, False
        self._stores: weakref.WeakSet[OnDisk] = weakref.WeakSet()
        self._over = threading.Event()
        threading.Thread(target=self._run, name="scratch files", daemon=True).start()

    def keep(self, kind: np.dtype) -> Store:
        """A new store of records of this type; as `filters.models.store.Keep`."""
        try:
            store = OnDisk(self._folder, kind)
        except OSError as error:
            self._refused(error)
            return InMemory(kind)
        self._stores.add(store)
        return store

    def __enter__(self) -> "Scratch":
        return self

    def __exit__(self, *_: object) -> None:
        self._over.set()

    def _run(self) -> None:
        while not self._over.wait(PERIOD_S):
            for store in list(self._stores):
                try:
                    store.write()
                except OSError as error:
                    self._refused(error)
                    self._over.wait(RETRY_S)

    def _refused(self, error: OSError) -> None:
        if not self._said:
            self._said = True
            self._tell(
                "warning", f"{self._folder}: {brief(error)}; what is final waits in memory for the disk"
            )


class OnDisk:
    """A `Store` in a file without a name, which is closed when nobody holds the store any more."""

    def __init__(self, folder: Path, kind: np.dtype):
        self._file = TemporaryFile(dir=folder, buffering=0)  # noqa: SIM115 - open for as long as the store is
        weakref.finalize(self, self._file.close)
        self._kind, self._written, self._waiting = kind, 0, InMemory(kind)
        self._lock = threading.Condition()  # over what is written and what waits

    def __len__(self) -> int:
        with self._lock:
            return self._written + len(self._waiting)

    def append(self, records: np.ndarray) -> None:
        with self._lock:
            self._waiting.append(records)

    def read(self, begin: int, end: int) -> np.ndarray:
        """As `Store`. Raises OSError where the disk does not give back what it took."""
        with self._lock:
            cut = self._written
            waiting = self._waiting.read(max(begin - cut, 0), max(end - cut, 0))
        size, data = self._kind.itemsize, bytearray()
        wanted = size * max(min(end, cut) - begin, 0)
        while len(data) < wanted:
            part = os.pread(self._file.fileno(), wanted - len(data), size * begin + len(data))
            if not part:
                raise OSError("a scratch file is shorter than it was")
            data += part
        past = np.frombuffer(data, self._kind)
        return np.concatenate([past, waiting]) if len(waiting) else past

    def whole(self) -> np.ndarray:
        """As `Store`: the file itself, once the disk has taken all. Where it will not, all is in memory."""
        with self._lock:
            while len(self._waiting) and self._lock.wait(PATIENCE_S):
                pass  # woken after each piece that is written
            written = self._written
        if written < len(self) or not written:
            return self.read(0, len(self))
        return np.asarray(np.memmap(self._file, self._kind, "c", shape=written))

    def write(self) -> None:
        """Put on the disk what waits. Raises OSError; then it still waits."""
        size = self._kind.itemsize
        while True:
            with self._lock:
                records = self._waiting.read(0, min(len(self._waiting), max(1, PIECE_BYTES // size)))
            if not len(records):
                return
            block, done = memoryview(records.tobytes()), 0
            while done < len(block):
                done += os.pwrite(self._file.fileno(), block[done:], size * self._written + done)
            with self._lock:
                self._waiting.drop(len(records))
                self._written += len(records)
                self._lock.notify_all()
