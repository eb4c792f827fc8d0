"""Rows in order of arrival that may grow for hours: numpy columns, with a bound."""

import numpy as np


class GrowingRows:
    """Structured rows with a field ``t_ns``. Beyond ``most`` the older half is thinned, two into one.

    A field ``stands_for``, where there is one, goes on counting what a row stands for.
    """

    def __init__(self, dtype: np.dtype, most: int):
        self._most = most
        self._held = np.empty(min(most, 1024), dtype)
        self._size = 0

    @property
    def view(self) -> np.ndarray:
        """(n,) what is held; to be read, not kept."""
        return self._held[: self._size]

    def add(self, row: tuple) -> None:
        if self._size == self._most:
            old, new = np.split(self.view.copy(), [self._most // 2])
            kept = np.concatenate([_halved(old), new])
            self._size = len(kept)
            self._held[: self._size] = kept
        elif self._size == len(self._held):
            self._held = np.resize(self._held, min(2 * self._size, self._most))
        self._held[self._size] = row
        self._size += 1

    def between(self, from_ns: int, to_ns: int) -> np.ndarray:
        """The rows from ``from_ns`` to ``to_ns``, both included; rows must be in order of time."""
        begin, end = np.searchsorted(self.view["t_ns"], [from_ns, to_ns + 1])
        return self.view[begin:end]

    def clear(self) -> None:
        self._size = 0


def _halved(rows: np.ndarray) -> np.ndarray:
    """Every second one, for itself and the next."""
    kept = rows[::2].copy()
    if "stands_for" in (rows.dtype.names or ()):
        kept["stands_for"][: len(rows) // 2] += rows["stands_for"][1::2]
    return kept
