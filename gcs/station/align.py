"""Time alignment: one time-ordered stream of rows out of feeds with different clocks, delays and rates.

Live, a row waits until no earlier one can still be expected: every source that is talking has either passed
its time or is not due before it. ``hold_s`` bounds the wait; a source that is always later than that, or has
missed its turn by as much, is not waited for at all. What comes later is handed on at once; the filter's
window takes it in or calls it late. In replay all data are there, so the caller says how far.
"""

from collections import deque
from typing import NamedTuple

import numpy as np

from filters.models.rows import ROW

MEMORY_NS = 5_000_000_000  # repeats are looked for this far back: longer than any window, any resend
EARLY = 0.9  # a source may be due after this part of its usual interval, however steady it is …
MARGIN = 4.0  # … or so many usual deviations before it is over, where that is later
GAIN = 1 / 8  # of a new interval, in the usual one and its deviation
GONE_NS = 1_000_000_000  # a source silent for this long is not waited for, however slow it usually is
LONG_AGO_NS = -(2**62)


class Beat(NamedTuple):
    """When a source speaks: its newest time, when that came, its usual interval and deviation, all in ns."""

    newest_ns: int
    arrival_ns: int
    interval_ns: float = 0.0
    deviation_ns: float = 0.0

    def next(self, newest_ns: int, arrival_ns: int) -> "Beat":
        """With one more time. Mean and mean deviation as those of round trips: Jacobson 1988, appendix A."""
        step = newest_ns - self.newest_ns
        if step <= 0:
            return self._replace(arrival_ns=arrival_ns)
        if not self.interval_ns:
            return Beat(newest_ns, arrival_ns, step, (1.0 - EARLY) * step / MARGIN)
        off = step - self.interval_ns
        deviation = self.deviation_ns + GAIN * (abs(off) - self.deviation_ns)
        return Beat(newest_ns, arrival_ns, self.interval_ns + GAIN * off, deviation)

    @property
    def due_ns(self) -> int:
        """Nothing of this source is expected up to then."""
        quiet = max(EARLY * self.interval_ns, self.interval_ns - MARGIN * self.deviation_ns)
        return self.newest_ns + int(quiet)


class Align:
    """Keeps rows that wait and remembers those released."""

    def __init__(self, hold_s: float):
        self._hold_ns = round(hold_s * 1e9)
        self._waiting = np.empty(0, dtype=ROW)
        self._known: set[tuple[int, int, int]] = set()  # (time, sensor, channel) of what was released
        self._released: deque[tuple[int, int, int]] = deque()  # the same in this order
        self._beats: dict[int, Beat] = {}  # by sensor
        self._arrivals: list[tuple[int, int]] = []  # (arrival, newest t) of what waits

    @property
    def waiting_ids(self) -> np.ndarray:
        """(w,) ids of the rows that wait."""
        return self._waiting["id"]

    def add(self, rows: np.ndarray, arrival_ns: int | None = None) -> None:
        """Take (n,) ROW in any order; ``arrival_ns`` where they came live."""
        self._waiting = np.concatenate([self._waiting, rows], dtype=ROW)
        if arrival_ns is None or not len(rows):
            return
        self._arrivals.append((arrival_ns, int(rows["t_ns"].max())))
        for sensor in set(rows["sensor"].tolist()):
            newest_ns = int(rows["t_ns"][rows["sensor"] == sensor].max())
            beat = self._beats.get(sensor, Beat(newest_ns, arrival_ns))
            self._beats[sensor] = beat.next(newest_ns, arrival_ns)

    def pass_over(self, sensor: int) -> None:
        """What comes of a source is refused: nobody waits for it until a row of it is taken again."""
        if sensor in self._beats:
            self._beats[sensor] = self._beats[sensor]._replace(arrival_ns=LONG_AGO_NS)

    def due_ns(self, now_ns: int) -> int:
        """The time up to which nothing earlier is still expected, or has been waited for long enough."""
        talking = [beat for beat in self._beats.values() if now_ns - beat.arrival_ns < self._gone_ns(beat)]
        promptest = min((beat.arrival_ns - beat.newest_ns for beat in talking), default=0)
        expected = [
            beat.due_ns for beat in talking if beat.arrival_ns - beat.newest_ns - promptest <= self._hold_ns
        ]
        overdue = [newest for arrival, newest in self._arrivals if now_ns - arrival >= self._hold_ns]
        self._arrivals = [a for a in self._arrivals if now_ns - a[0] < self._hold_ns]
        return max([min(expected, default=0), *overdue])

    def _gone_ns(self, beat: Beat) -> float:
        """A source silent for this long is no longer waited for."""
        return min(GONE_NS, beat.interval_ns + self._hold_ns)

    def release(self, upto_ns: int) -> tuple[np.ndarray, np.ndarray]:
        """(n,) ROW up to ``upto_ns`` in time order, and (d,) ids of rows that repeat an earlier one."""
        ready = self._waiting["t_ns"] <= upto_ns
        rows, self._waiting = self._waiting[ready], self._waiting[~ready]
        rows = rows[np.lexsort([rows[name] for name in ("id", "channel", "sensor", "t_ns")])]
        fresh = np.ones(len(rows), dtype=bool)
        for k, key in enumerate(
            zip(*(rows[name].tolist() for name in ("t_ns", "sensor", "channel")), strict=True)
        ):
            fresh[k] = key not in self._known
            if fresh[k]:
                self._known.add(key)
                self._released.append(key)
        while self._released and self._released[0][0] < self._released[-1][0] - MEMORY_NS:
            self._known.discard(self._released.popleft())
        return rows[fresh], rows["id"][~fresh]
