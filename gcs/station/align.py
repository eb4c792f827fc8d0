"""Time alignment: one time-ordered stream of rows out of feeds with different clocks, delays and rates.

Live, a row waits until no earlier one can still be expected: every source that is talking has either passed
its time or is not due before it. ``hold_s`` bounds the wait; a source that is always later than that is not
waited for at all. What comes later is handed on at once; the filter's window takes it in or calls it late. In
replay all data are there, so the caller says how far.
"""

import numpy as np

from filters.models.rows import ROW

MEMORY_NS = 5_000_000_000  # repeats are looked for this far back: longer than any window, any resend
EARLY = 0.9  # a source is due after this part of its usual interval: allows for 10 % jitter
GONE_NS = 1_000_000_000  # a source silent for this long is no longer waited for


class Align:
    """Keeps rows that wait and remembers those released."""

    def __init__(self, hold_s: float):
        self._hold_ns = round(hold_s * 1e9)
        self._waiting = np.empty(0, dtype=ROW)
        self._released = np.empty(0, dtype=ROW)
        self._pace: dict[int, tuple[int, int, int]] = {}  # sensor → newest t, its arrival, usual interval
        self._arrivals: list[tuple[int, int]] = []  # (arrival, newest t) of what waits

    @property
    def waiting_ids(self) -> np.ndarray:
        """(w,) ids of the rows that wait."""
        return self._waiting["id"]

    def add(self, rows: np.ndarray, arrival_ns: int | None = None) -> None:
        """Take (n,) ROW in any order; ``arrival_ns`` where they came live."""
        self._waiting = np.concatenate([self._waiting, rows])
        if arrival_ns is None or not len(rows):
            return
        self._arrivals.append((arrival_ns, int(rows["t_ns"].max())))
        for sensor in np.unique(rows["sensor"]).tolist():
            newest = int(rows["t_ns"][rows["sensor"] == sensor].max())
            last, _, interval = self._pace.get(sensor, (newest, arrival_ns, 0))
            step = newest - last
            usual = step if interval == 0 else interval + (step - interval) // 8
            self._pace[sensor] = (max(newest, last), arrival_ns, usual if step > 0 else interval)

    def due_ns(self, now_ns: int) -> int:
        """The time up to which nothing earlier is still expected, or has been waited for long enough."""
        talking = [pace for pace in self._pace.values() if now_ns - pace[1] < GONE_NS]
        promptest = min((arrival - newest for newest, arrival, _ in talking), default=0)
        expected = [
            newest + int(EARLY * interval)
            for newest, arrival, interval in talking
            if arrival - newest - promptest <= self._hold_ns
        ]
        overdue = [newest for arrival, newest in self._arrivals if now_ns - arrival >= self._hold_ns]
        self._arrivals = [a for a in self._arrivals if now_ns - a[0] < self._hold_ns]
        return max([min(expected, default=0), *overdue])

    def release(self, upto_ns: int) -> tuple[np.ndarray, np.ndarray]:
        """(n,) ROW up to ``upto_ns`` in time order, and (d,) ids of rows that repeat an earlier one."""
        ready = self._waiting["t_ns"] <= upto_ns
        rows, self._waiting = self._waiting[ready], self._waiting[~ready]
        if not len(rows):
            return rows, rows["id"]
        begin = np.searchsorted(self._released["t_ns"], rows["t_ns"].min())
        known = np.concatenate([self._released[begin:], rows])
        fresh = np.arange(len(known)) >= len(known) - len(rows)
        order = np.lexsort((known["id"], known["channel"], known["sensor"], known["t_ns"]))
        known, fresh = known[order], fresh[order]
        repeats = np.zeros(len(known), dtype=bool)
        repeats[1:] = np.logical_and.reduce(
            [known[field][1:] == known[field][:-1] for field in ("t_ns", "sensor", "channel")]
        )
        duplicates, known, fresh = known["id"][repeats], known[~repeats], fresh[~repeats]
        oldest = np.searchsorted(self._released["t_ns"], known["t_ns"][-1] - MEMORY_NS, side="right")
        self._released = np.concatenate([self._released[min(oldest, begin) : begin], known])
        return known[fresh], duplicates
