"""Rows in order of arrival that may come for hours: numpy columns of a fixed size."""

import numpy as np

SOME = 4_096  # rows that are moved at a time


class GrowingRows:
    """Structured rows with a field ``t_ns``, at most ``most``; then the past is thinned, evenly.

    The memory of all of them is taken at once: a page that has shown its first minutes needs no more after
    an hour, and none of it is copied meanwhile. A field ``stands_for``, where there is one, goes on counting
    what a row stands for.
    """

    def __init__(self, dtype: np.dtype, most: int):
        self._held = np.empty(most, dtype)
        self._held.view(np.uint8)[:] = 0  # written to, or the system would give it page by page
        self.clear()

    @property
    def view(self) -> np.ndarray:
        """(n,) what is held; to be read, not kept."""
        return self._held[: self._size]

    def add(self, row: tuple | np.void) -> None:
        if self._size == len(self._held):
            self._thin()
        self._held[self._size] = row
        self._size += 1

    def between(self, from_ns: int, to_ns: int) -> np.ndarray:
        """The rows from ``from_ns`` to ``to_ns``, both included; rows must be in order of time."""
        begin, end = np.searchsorted(self.view["t_ns"], [from_ns, to_ns + 1])
        return self.view[begin:end]

    def clear(self) -> None:
        self._size = 0
        self._past = 0  # so many, the first ones, are thinned already …
        self._stride = 2  # … to every so many-th row that came

    def _thin(self) -> None:
        """Thin a third of what is whole like all that is older; that, where it is over a third, once more.

        So the past is of one density, however long ago: to halve the oldest again and again would leave
        nothing of a long flight's beginning.
        """
        middle = self._past + (self._size - self._past) // 3
        past = self._pack(self._stride, self._past, middle, self._past)
        if past > len(self._held) // 3:
            past = self._pack(2, 0, past, 0)
            self._stride = min(2 * self._stride, len(self._held))
        self._past, self._size = past, self._pack(1, middle, self._size, past)

    def _pack(self, stride: int, begin: int, end: int, to: int) -> int:
        """Put every ``stride``-th row of those from ``begin`` to ``end`` where ``to`` is; where they end.

        Some at a time: a copy of them all would be taken from the system, and not all of it given back.
        """
        step = stride * SOME
        for k in range(begin, end, step):
            kept = _every(stride, self._held[k : min(k + step, end)])
            self._held[to : to + len(kept)] = kept
            to += len(kept)
        return to


def _every(stride: int, rows: np.ndarray) -> np.ndarray:
    """Every so many-th one, for itself and those behind it."""
    kept = rows[::stride].copy()
    if "stands_for" in (rows.dtype.names or ()) and len(rows):
        kept["stands_for"] = np.add.reduceat(rows["stands_for"], np.arange(0, len(rows), stride))
    return kept
