"""The lag of one source, arrival minus stamp, and whether it drifts.

A source's lag is watched twice a second, beyond what most lags have done meanwhile: a stall, and the pace
of a recording, is common to all. Where the newest ones lie on a line, steeper than any crystal's by far
and clearer than their noise is, its clock drifts. Nothing but a clock takes a lag down along a line; up
may also be a link that fills up, so that is looked at for longer.
"""

from collections import deque
from statistics import median

import numpy as np

S = 1_000_000_000
SPAN_NS = 1 * S  # a source's lag is the median of so long
FEWEST = 3  # … or of so many turns, of a slow source
WATCH_NS = S // 2  # how often a lag is looked at, for drifts …
WATCHED, LINE = 60, 17  # … how many of these are kept, and are a line at most
AHEAD_LINE, BEHIND_LINE = 4, 9  # … and at least, of one that goes down, and up
RECENT = 5  # … and two seconds of them
KNOWN = 9  # … and of all, for their noise
CLEAR, WORST = 8.0, 5.0  # how often a line's rise is its scatter, and the worst step before it
LONGEST_S = (LINE * WATCH_NS + SPAN_NS) / S  # a drift has begun less than so long before it is found
DRIFT, JUMP = 0.003, 0.1  # a crystal keeps to 0.0001; above is no drift


class Voter:
    """What is remembered of one source."""

    def __init__(self) -> None:
        self.lags: deque[tuple[int, int]] = deque(maxlen=256)  # (arrival, lag of the promptest) by turn
        self.lied_ns: int | None = None  # arrival of its newest lie, None while it is right
        self._usual: tuple[float, float] | None = None  # (rate, its lag at that rate when it spoke last)
        self.taken_ns = 0  # stamp of the newest measurement of it that was taken
        self.right_ns, self.right_s = 0, np.nan  # when it was right for the last time; its lag then, as below
        self.lied_s = 0.0  # for how long it had drifted, at most, when that was found
        self.drift = 0.0  # of its clock, s/s of lag; 0 while there is none
        self._apart: deque[tuple[float, float]] = deque(maxlen=WATCHED)  # time, lag beyond others', s

    def hear(self, lags: np.ndarray, arrival_ns: int) -> None:
        """Take (n,) lags of one turn: the second smallest of many, so that one wild stamp is no vote."""
        few = np.partition(lags, 1)[1] if len(lags) > 2 else lags.min()
        self._usual = None
        self.lags.append((arrival_ns, int(few)))
        while len(self.lags) > FEWEST and arrival_ns - self.lags[0][0] > SPAN_NS:
            self.lags.popleft()

    def lag_ns(self, now_ns: int, rate: float) -> int:
        """Its usual lag, carried on to now."""
        spoke_ns = self.lags[-1][0]
        if self._usual is None or self._usual[0] != rate:  # asked for several times a turn
            self._usual = rate, median(lag + rate * (spoke_ns - arrival) for arrival, lag in self.lags)
        return int(self._usual[1] + rate * (now_ns - spoke_ns))

    def least_ns(self, now_ns: int, rate: float) -> int:
        """The second smallest of late, carried on to now: delays have no upper end, a wild stamp no lower."""
        lags = sorted(int(lag + rate * (now_ns - arrival)) for arrival, lag in self.lags)
        return lags[min(1, len(lags) - 1)]

    def is_fast(self, now_ns: int) -> bool:
        """Does it speak often enough that its lag is of now?"""
        return now_ns - self.lags[-1][0] < SPAN_NS and self.span_ns() <= 2 * SPAN_NS

    def watch(self, now_s: float, apart_s: float) -> None:
        """Take its lag beyond what others' have grown by, twice a second: does it drift?"""
        self._apart.append((now_s, apart_s))
        known = np.array(self._apart)
        if self.drift:  # one look that a delay has disturbed does not end it, a jump does
            since_s, step_s = known[-1] - known[-2]
            jumped = abs(step_s) > JUMP * since_s
            self.drift *= not jumped and max(_share(known, self.drift), _share(known[:-1], self.drift)) > 0.5
            return
        found = line(known)
        self.drift = found if found and 0.5 < _share(known, found) < 1.5 else 0.0
        if self.drift:
            before = known[known[:, 0] <= now_s - LONGEST_S, 1]
            self.right_s = float(np.median(before[-RECENT:])) if len(before) else np.nan
            lied_s = (apart_s - self.right_s) / self.drift  # where the line meets what was before
            self.lied_s = min(lied_s + SPAN_NS / S, LONGEST_S) if lied_s > 0.0 else LONGEST_S

    def moved_s(self) -> float:
        """How far its clock is from where it was before its drift; infinite where that is not known."""
        moved = abs(self._apart[-1][1] - self.right_s)
        return moved if moved == moved else np.inf

    def span_ns(self) -> int:
        return self.lags[-1][0] - self.lags[0][0]

    def rate(self) -> float:
        """How fast its lags grow: the median of slopes (Theil 1950), each over half of the time."""
        known = list(self.lags)
        pairs = zip(known, known[len(known) // 2 :], strict=False)
        slopes = [(b[1] - a[1]) / (b[0] - a[0]) for a, b in pairs if b[0] > a[0]]
        return median(slopes) if slopes else 0.0


def line(known: np.ndarray) -> float:
    """The slope of the line in which lags (n, 2), time and value in s, end; 0 if they end in none.

    A lag that goes down has to come below all before it: else it is a link that empties itself. A line grows
    with every step; delays that grew once or twice and stayed are stairs, through which least squares would
    lay one too.
    """
    if len(known) < KNOWN:
        return 0.0
    for n in range(AHEAD_LINE, min(len(known), LINE) + 1):
        before = known[:-n, 1]
        if len(before) < 2 and n < KNOWN:
            continue
        t, lag = known[-n:].T
        t = t - t.mean()
        slope = float(t @ lag / (t @ t))
        about = np.sqrt(((lag - lag.mean() - slope * t) ** 2).sum() / (n - 2))
        worst = np.abs(np.diff(before)).max(initial=0.0)
        clear = abs(slope) * np.sqrt(t @ t) > max(CLEAR * about, WORST * worst)
        fresh = n >= BEHIND_LINE if slope > 0.0 else lag[-1] < before.min(initial=np.inf)
        steady = slope * np.median(np.diff(lag) / np.diff(t)) > slope**2 / 2
        if clear and fresh and DRIFT < abs(slope) < JUMP and steady:
            return slope
    return 0.0


def _share(known: np.ndarray, slope: float) -> float:
    """How much of a slope the last two seconds of lags (n, 2) have, 1: as steep.

    A drift that goes on may be steeper than it was found: a lag is of a whole second, so it begins slowly.
    """
    (before_s, before), (then_s, then) = known[-min(len(known), RECENT)], known[-1]
    return (then - before) / (slope * (then_s - before_s))
