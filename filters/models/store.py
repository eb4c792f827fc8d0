"""Records that only become more: what is final, which only the smoother of the whole flight reads.

They are kept in memory, or wherever who runs the flight has room for a day of them: ``Keep`` makes the place.
"""

from collections.abc import Callable
from typing import Protocol

import numpy as np


class Store(Protocol):
    """Records of one type, numbered from 0 in the order in which they came."""

    def __len__(self) -> int: ...

    def append(self, records: np.ndarray) -> None:
        """Take a copy of ``records`` (k,)."""

    def read(self, begin: int, end: int) -> np.ndarray:
        """(end − begin,) of them; not to be written to."""

    def whole(self) -> np.ndarray:
        """All of them, in an array that need not lie in memory. No `append` may follow."""


Keep = Callable[[np.dtype], Store]  # a new, empty store of records of this type


class InMemory:
    """A `Store` in memory. ``drop`` forgets the oldest: it is also what waits for a disk."""

    def __init__(self, kind: np.dtype):
        self._records, self._size = np.zeros(64, kind), 0

    def __len__(self) -> int:
        return self._size

    def append(self, records: np.ndarray) -> None:
        size = self._size + len(records)
        if size > len(self._records):
            grown = np.zeros(max(size, 2 * len(self._records)), self._records.dtype)
            grown[: self._size] = self._records[: self._size]
            self._records = grown
        self._records[self._size : size] = records
        self._size = size

    def read(self, begin: int, end: int) -> np.ndarray:
        return self._records[begin:end]

    def whole(self) -> np.ndarray:
        return self._records[: self._size]

    def drop(self, count: int) -> None:
        """Forget the first ``count``; the others are numbered anew."""
        self._records, self._size = self._records[count:].copy(), self._size - count
