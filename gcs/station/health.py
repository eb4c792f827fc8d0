"""Health of the feeds: rates, ages and outlier shares over the last ten seconds of data, once a second."""

from collections import deque
from collections.abc import Iterator
from typing import NamedTuple, Protocol

import numpy as np

from gcs.contract.messages import VERDICTS, Event, Health, SensorHealth, SystematicError
from gcs.station.ledger import NO_TIME
from gcs.station.session import Update

SPAN_NS = 10_000_000_000
PERIOD_NS = 1_000_000_000
SILENT_S = 2.0  # no data for this long is worth an operator's attention
OUTLIERS = [VERDICTS.index(name) for name in ("isolated", "patch", "invalid")]


class Tally(NamedTuple):
    """What came from one sensor between two updates."""

    begin_ns: int
    end_ns: int
    measurements: int
    rows: int
    outliers: int


class Feeds(Protocol):
    """What only the source of the measurements knows."""

    def latency_s(self, name: str) -> float: ...

    def alive(self, name: str) -> bool: ...

    def queue_age_s(self) -> float: ...


class Files:
    """The feeds of a replay: always there, never late."""

    def latency_s(self, name: str) -> float:
        return 0.0

    def alive(self, name: str) -> bool:
        return True

    def queue_age_s(self) -> float:
        return 0.0


class Monitor:
    """Watches the verdicts go by. All times are the data's own."""

    def __init__(self, sensors: list[str], feeds: Feeds):
        self.now_ns = 0
        self._sensors, self._feeds = sensors, feeds
        self._newest = dict.fromkeys(sensors, 0)
        self._recent: dict[str, deque[Tally]] = {name: deque() for name in sensors}
        self._totals = {name: [0, 0] for name in sensors}
        self._silent: set[str] = set()
        self._next_ns = 0
        self._resets = 0

    def take(self, update: Update) -> Iterator[Health | Event]:
        """Note an update; gives the messages that are due."""
        self._count(update)
        if len(update.track):
            self.now_ns = int(update.track["t_ns"][-1])
            yield from self._events(update)
        if self.now_ns >= self._next_ns:
            self._next_ns = self.now_ns + PERIOD_NS
            found = update.report().get("sensors", {})
            sensors = {name: self._health(name, found.get(name, {})) for name in self._sensors}
            yield Health(t_ns=self.now_ns, sensors=sensors, queue_age_s=self._feeds.queue_age_s())

    def ages_s(self, t_ns: int) -> dict[str, float]:
        """Age of each sensor's newest measurement at ``t_ns``; silent sensors are left out."""
        return {name: (t_ns - newest) / 1e9 for name, newest in self._newest.items() if newest}

    def _count(self, update: Update) -> None:
        judged = update.judged[update.judged["t_ns"] != NO_TIME]
        for index in np.unique(judged["sensor"]).tolist():
            name, rows = self._sensors[index], judged[judged["sensor"] == index]
            newest = int(rows["t_ns"].max())
            fresh = rows[rows["t_ns"] > self._newest[name]]  # a changed verdict is not counted twice
            if not len(fresh):
                continue
            begin, self._newest[name] = self._newest[name] or newest, newest
            outliers = int(np.isin(fresh["verdict"], OUTLIERS).sum())
            measurements = len(np.unique(fresh["measurement"]))
            self._recent[name].append(Tally(begin, newest, measurements, len(fresh), outliers))
            self._totals[name][0] += len(fresh)
            self._totals[name][1] += outliers

    def _health(self, name: str, found: dict) -> SensorHealth:
        recent = self._recent[name]
        while recent and recent[0].end_ns < self.now_ns - SPAN_NS:
            recent.popleft()
        span_s = (self.now_ns - recent[0].begin_ns) / 1e9 if recent else 0.0
        rows = sum(tally.rows for tally in recent)
        age_s = (self.now_ns - self._newest[name]) / 1e9 if self._newest[name] else None
        return SensorHealth(
            rate_hz=sum(tally.measurements for tally in recent) / span_s if span_s else 0.0,
            age_s=age_s,
            outlier_share=sum(tally.outliers for tally in recent) / rows if rows else 0.0,
            latency_s=self._feeds.latency_s(name),
            alive=self._feeds.alive(name),
            rows=self._totals[name][0],
            outliers=self._totals[name][1],
            errors={error: _systematic(**told) for error, told in found.get("errors", {}).items()},
        )

    def _events(self, update: Update) -> Iterator[Event]:
        resets = int(update.track["reset_counter"][-1])
        if resets > self._resets:
            yield Event(t_ns=self.now_ns, level="warning", text=f"filter re-initialised, {resets} so far")
        self._resets = resets
        silent = {name for name, age in self.ages_s(self.now_ns).items() if age > SILENT_S}
        for name in sorted(silent - self._silent):
            yield Event(t_ns=self.now_ns, level="warning", text=f"{name} is silent")
        for name in sorted(self._silent - silent):
            yield Event(t_ns=self.now_ns, level="info", text=f"{name} is back")
        self._silent = silent


def _systematic(value: float, sigma: float, unit: str, *, observable: bool, **_) -> SystematicError:
    """An entry of the estimator's report; angles become degrees."""
    turn = float(np.degrees(1.0)) if unit == "rad" else 1.0
    unit = "deg" if unit == "rad" else unit
    return SystematicError(value=value * turn, sigma=sigma * turn, unit=unit, known=observable)
