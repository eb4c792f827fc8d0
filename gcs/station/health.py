"""Health of the feeds: rates, ages and outlier shares over the last ten seconds of data, once a second."""

import time
from bisect import bisect_right
from collections import Counter, deque
from collections.abc import Callable, Iterator
from typing import Protocol

import numpy as np

from gcs.contract.messages import VERDICTS, Event, Health, PartHealth, SensorHealth, SystematicError
from gcs.station.session import Update

SPAN_NS = 10_000_000_000
KEPT_NS = 60_000_000_000  # verdicts change for so long at most: the longest window, and then some
PERIOD_NS = 1_000_000_000
BACK_NS = 1_000_000_000  # the flight's clock is so far behind what silence was taken for: it had stood still
CHECK_NS = 100_000_000  # between two looks for what is worth an event
SILENT_S, SILENT_SCANS = 1.5, 3.0  # no data for so long, and so many usual intervals, is worth attention
JUDGED = VERDICTS.index("invalid")  # verdicts below: the estimator's, on a value with a time that can be
OUTLIERS = [VERDICTS.index(name) for name in ("isolated", "patch", "invalid")]


class Feeds(Protocol):
    """What only the source of the measurements knows."""

    def latency_s(self, name: str) -> float: ...

    def alive(self, name: str) -> bool: ...

    def queue_age_s(self) -> float: ...

    def idle_s(self) -> float | None:
        """How long nothing has come; None: nothing comes by itself."""


class Files:
    """The feeds of a replay: always there, never late."""

    def latency_s(self, name: str) -> float:
        return 0.0

    def alive(self, name: str) -> bool:
        return True

    def queue_age_s(self) -> float:
        return 0.0

    def idle_s(self) -> float | None:
        return None


class Tally:
    """The values of one sensor: how many, how often, how many of them set aside by their newest verdict."""

    def __init__(self) -> None:
        self.rows = self.outliers = 0  # since the start
        self.stamps = [0]  # valid times of the newest measurements, in order; the first is from before
        self.interval_s = 0.0  # usual, between measurements
        self._known: dict[int, tuple[int, bool]] = {}  # value → when noted, and whether it is set aside
        self._old: deque[int] = deque()  # of these, outside the span
        self._span: deque[tuple[int, int, int]] = deque()  # time, measurement, value; of a line −1, count
        self._measurements: Counter[int] = Counter()
        self._recent = [0, 0]  # rows and outliers within the span
        self._now_ns = 0

    @property
    def newest_ns(self) -> int:
        return self.stamps[-1]

    @property
    def outlier_share(self) -> float:
        return self._recent[1] / self._recent[0] if self._recent[0] else 0.0

    def see(self, t_ns: list[int]) -> None:
        """Note the times of values, all that there are in this turn."""
        fresh = sorted({t for t in t_ns if t > self.newest_ns})
        if fresh and self.newest_ns:
            step_s = (fresh[-1] - self.newest_ns) / len(fresh) / 1e9
            self.interval_s += (step_s - self.interval_s) / (8.0 if self.interval_s else 1.0)
        self.stamps = [self.newest_ns, *fresh]

    def take(self, rows: np.ndarray, now_ns: int) -> None:
        """Note (n,) ENTRY, new ones and those whose verdict has changed."""
        bad = np.isin(rows["verdict"], OUTLIERS).tolist()
        fields = (rows[name].tolist() for name in ("t_ns", "measurement", "channel", "count"))
        if now_ns < self._now_ns:  # time went back: what was noted later is of now
            self._span = deque((min(t_ns, now_ns), which, key) for t_ns, which, key in self._span)
        self._now_ns, before_ns = now_ns, min(now_ns, self._now_ns)
        for t_ns, measurement, channel, count, outlier in zip(*fields, bad, strict=True):
            at_ns = min(max(t_ns, before_ns), now_ns)  # a stamp may be anything
            if channel < 0:  # a line that was no measurement, or many of them; never judged again
                self._span.append((at_ns, -1, count))
                self._count(count, count, recent=True)
                continue
            key = measurement * 16 + channel
            before = self._known.get(key)
            self._known[key] = at_ns if before is None else before[0], outlier
            if before is None:
                self._span.append((at_ns, measurement, key))
                self._measurements[measurement] += 1
                self._count(1, int(outlier), recent=True)
            elif before[1] != outlier:
                recent = before[0] >= self._edge_ns
                self._count(0, int(outlier) - int(before[1]), recent=recent)

    def forget(self, now_ns: int) -> None:
        """Let go of what lies outside the span, and of what cannot change any more."""
        while self._span and self._span[0][0] < now_ns - SPAN_NS:
            _, measurement, key = self._span.popleft()
            if measurement < 0:
                self._recent[0] -= key
                self._recent[1] -= key
                continue
            self._recent[0] -= 1
            self._recent[1] -= self._known[key][1]
            self._measurements[measurement] -= 1
            if not self._measurements[measurement]:
                del self._measurements[measurement]
            self._old.append(key)
        while self._old and self._known[self._old[0]][0] < now_ns - KEPT_NS:
            del self._known[self._old.popleft()]

    @property
    def _edge_ns(self) -> int:
        """When the oldest value of the span was noted."""
        return self._span[0][0] if self._span else self._now_ns

    def rate_hz(self, now_ns: int) -> float:
        if not self._span:
            return 0.0
        span_s = (now_ns - self._span[0][0]) / 1e9
        return len(self._measurements) / span_s if span_s > 0.0 else 0.0

    def _count(self, rows: int, outliers: int, *, recent: bool) -> None:
        self.rows += rows
        self.outliers += outliers
        if recent:
            self._recent[0] += rows
            self._recent[1] += outliers


class Monitor:
    """Watches the verdicts go by. All times are the data's own, and go on while nothing comes live.

    Several sinks may ask about one update; it is noted once.
    """

    def __init__(self, sensors: list[str], feeds: Feeds, parts: Callable[[], dict[str, PartHealth]] = dict):
        self.now_ns = 0
        self._sensors, self._feeds, self._parts = sensors, feeds, parts
        self._tallies = {name: Tally() for name in sensors}
        self._data_ns = self._next_ns = self._checked_ns = self._resets = 0
        self._silent: set[str] = set()
        self._here: set[str] = set()
        self._seen: Update | None = None
        self._noted: Update | None = None
        self._due: list[Health | Event] = []

    def see(self, update: Update) -> None:
        """Note only how new an update's measurements are: so much a state has to wait for."""
        if update is self._seen:
            return
        self._seen, seen, first = update, dict[int, list[int]](), not self._data_ns
        valid = update.judged[update.judged["verdict"] < JUDGED]
        for sensor, t_ns in zip(valid["sensor"].tolist(), valid["t_ns"].tolist(), strict=True):
            seen.setdefault(sensor, []).append(t_ns)
        for sensor, times in seen.items():
            self._tallies[self._sensors[sensor]].see(times)
            self._data_ns = max(self._data_ns, *times)
        self._data_ns = max(self._data_ns, int(update.track["t_ns"].max(initial=0)))
        if first and self._data_ns:  # until now it was the station's own clock, the flight's may be behind
            self.now_ns = self._checked_ns = self._next_ns = 0

    def take(self, update: Update) -> list[Health | Event]:
        """Note an update; gives the messages that are due."""
        if update is self._noted:
            return self._due
        self.see(update)
        self._noted, self._due = update, self._take(update)
        return self._due

    def _take(self, update: Update) -> list[Health | Event]:
        clock_ns = self._clock_ns()
        if clock_ns < self.now_ns - BACK_NS:  # a recording that was paused: else no health until it is there
            self.now_ns = self._checked_ns = self._next_ns = clock_ns
        self.now_ns = max(self.now_ns, clock_ns)
        for index in np.unique(update.judged["sensor"]).tolist():
            rows = update.judged[update.judged["sensor"] == index]
            self._tallies[self._sensors[index]].take(rows, self.now_ns)
        messages: list[Health | Event] = list(self._restarts(update))
        if self.now_ns - self._checked_ns >= CHECK_NS:
            self._checked_ns = self.now_ns
            messages += self._silences()
        if self.now_ns >= self._next_ns:
            self._next_ns = self.now_ns + PERIOD_NS
            found = update.report().get("sensors", {})
            sensors = {name: self._health(name, found.get(name, {})) for name in self._sensors}
            queue_age_s, parts = self._feeds.queue_age_s(), self._parts()
            messages.append(Health(t_ns=self.now_ns, sensors=sensors, queue_age_s=queue_age_s, parts=parts))
        return messages

    def ages_s(self, t_ns: int) -> dict[str, float]:
        """Age at ``t_ns`` of each sensor's newest measurement until then; silent sensors are left out."""
        ages = {}
        for name, tally in self._tallies.items():
            newest_ns = tally.stamps[max(0, bisect_right(tally.stamps, t_ns) - 1)]
            if newest_ns:
                ages[name] = (t_ns - newest_ns) / 1e9
        return ages

    def _clock_ns(self) -> int:
        idle_s = self._feeds.idle_s()
        if idle_s is None:
            return self._data_ns
        return (self._data_ns + round(idle_s * 1e9)) if self._data_ns else time.time_ns()

    def _health(self, name: str, found: dict) -> SensorHealth:
        tally = self._tallies[name]
        tally.forget(self.now_ns)
        return SensorHealth(
            rate_hz=tally.rate_hz(self.now_ns),
            age_s=(self.now_ns - tally.newest_ns) / 1e9 if tally.newest_ns else None,
            outlier_share=tally.outlier_share,
            latency_s=self._feeds.latency_s(name),
            alive=self._feeds.alive(name),
            rows=tally.rows,
            outliers=tally.outliers,
            errors={error: _systematic(**one) for error, one in found.get("errors", {}).items()},
        )

    def _restarts(self, update: Update) -> Iterator[Event]:
        resets = int(update.track["reset_counter"].max(initial=self._resets))
        if resets > self._resets:
            yield self._event("warning", f"filter re-initialised, {resets} so far")
        self._resets = resets
        if update.failed:
            yield self._event("error", "no state: the filter has lost the target, or has failed")

    def _silences(self) -> Iterator[Event]:
        here = {name for name in self._sensors if self._feeds.alive(name)}
        for name in sorted(self._here - here):
            yield self._event("warning", f"{name}: its bridge is gone")
        for name in sorted(here - self._here) if self._feeds.idle_s() is not None else ():
            yield self._event("info", f"{name}: its bridge is there")
        self._here = here
        silent = {name for name, tally in self._tallies.items() if self._is_silent(tally)}
        for name in sorted(silent - self._silent):
            yield self._event("warning", f"{name} is silent")
        for name in sorted(self._silent - silent):
            yield self._event("info", f"{name} is back")
        self._silent = silent

    def _is_silent(self, tally: Tally) -> bool:
        limit_s = max(SILENT_S, SILENT_SCANS * tally.interval_s)
        return tally.newest_ns > 0 and self.now_ns - tally.newest_ns > limit_s * 1e9

    def _event(self, level: str, text: str) -> Event:
        return Event(t_ns=self.now_ns, level=level, text=text)


def _systematic(value: float, sigma: float, unit: str, *, observable: bool, **_) -> SystematicError:
    """An entry of the estimator's report; angles become degrees."""
    turn = float(np.degrees(1.0)) if unit == "rad" else 1.0
    unit = "deg" if unit == "rad" else unit
    return SystematicError(value=value * turn, sigma=sigma * turn, unit=unit, known=observable)
