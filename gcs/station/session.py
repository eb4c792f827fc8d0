"""The loop, the same for live and replay.

measurements → intake → align → screening, estimator → air → ledger → sinks
"""

from collections.abc import Callable, Mapping, Sequence
from functools import partial
from typing import NamedTuple, Protocol

import msgspec
import numpy as np

from filters import methods
from filters.correction.correction import off
from filters.models.rows import SEPARATION, Step
from filters.models.settings import Settings
from filters.models.store import InMemory, Keep
from filters.screening.channels import ChannelScreening, NoScreening
from filters.smoother import status
from filters.smoother.snapshots import WrongClock
from gcs import __version__
from gcs.contract import limits
from gcs.contract.config import Station
from gcs.contract.frames import Frame
from gcs.contract.messages import INS_CHANNELS, Event, InputError, Wind
from gcs.station.air import Air
from gcs.station.align import Align
from gcs.station.guarded import Estimator, GuardedSink, Relay
from gcs.station.intake import Batch, Intake, sensors_of, settings_of
from gcs.station.ledger import Ledger
from gcs.station.pace import Pace

FOREVER_NS = np.iinfo(np.int64).max
GUESS_M = 1_000.0  # 1 sigma: worse than this, dead reckoning too says nothing that an operator can use
LOW, HIGH = np.array([limits.CHANNEL[name] for name in INS_CHANNELS]).T  # of a state: position, velocity, …
PIECE = 10_000  # states looked at together: a best estimate may have millions
LOST_NS = 1_000_000_000  # of measurements without a state: the filter has lost the target


class Update(NamedTuple):
    """What one turn of the loop brought, for the sinks."""

    track: np.ndarray  # (k,) TRACK, causal, one per epoch
    smoothed: np.ndarray  # (m,) TRACK, decisions final
    judged: np.ndarray  # (v,) ENTRY whose verdict is new or has changed
    retired: np.ndarray  # (r,) ENTRY, final, in order of arrival
    ledger: Ledger  # gives names and ``reason_texts``
    told: Sequence[Wind | Event] = ()  # of the air
    report: Callable[[], dict] = dict  # the estimator's own, of this moment
    failed: bool = False  # measurements come, and no state can be told any more
    remarks: Mapping[int, str] | None = None  # texts of ``retired`` alone; the ledger soon forgets them
    separation: np.ndarray = np.zeros(0, SEPARATION)  # (s,) of the newest states, where the method tells it


class Sink(Protocol):
    """Takes updates. ``close``, called once, gets the summary and the best estimate, (n,) TRACK."""

    def take(self, update: Update) -> None: ...

    def close(self, summary: dict, best: np.ndarray) -> None: ...


class Session:
    """One flight, from its first measurement to its summary; ``keep`` makes the places for what is final."""

    def __init__(
        self,
        station: Station,
        frame: Frame,
        sinks: Sequence[Sink],
        method: str = "default",
        correction: Callable = off,
        keep: Keep = InMemory,
    ):
        self.sensors = sensors_of(station, frame)
        self.ledger = Ledger([sensor.name for sensor in self.sensors], status.REASONS)
        self.intake = Intake(station, frame, self.ledger)
        self.align = Align(station.align.hold_s)
        settings = settings_of(station, frame)
        self.estimator = Relay(partial(_make_estimator, method, self.sensors, settings, correction, keep))
        self._settings = {
            "method": method,
            "learned_correction": correction is not off,
            "filter": {name: None if value != value else value for name, value in settings._asdict().items()},
            "station": msgspec.to_builtins(station),
        }
        self.screening = ChannelScreening(self.sensors) if station.screening.on else NoScreening()
        self.air = Air()
        self.sinks = list(sinks)
        self._judged: list[np.ndarray] = []
        self._state_ns = 0  # of the newest state
        self._senseless = 0  # states that were not told
        self._pace = [Pace() for _ in self.sensors]  # of what reached the filter

    def supervise(self) -> list[GuardedSink]:
        """Go on where a sink or the estimator fails, as a live flight must; returns the sinks as guarded."""
        guarded = [GuardedSink(sink) for sink in self.sinks]
        self.sinks = list[Sink](guarded)
        self.estimator.forgiving = True
        return guarded

    def enter(self, batch: Batch, arrival_ns: int | None = None) -> None:
        """Take measurements in; ``arrival_ns`` where they came live."""
        rows, invalid = self.intake.enter(batch)
        self._judged.append(invalid)
        self.align.add(rows, arrival_ns)

    def enter_air(self, samples: np.ndarray) -> None:
        """Take (n,) AIR in."""
        self.air.enter(samples)

    def take_back(self, name: str, before_ns: int, newest_ns: int, moved_s: float) -> None:
        """What a source has said since its clock went wrong is forgotten; see `WrongClock`."""
        if name in self.ledger.sensors:
            wrong = WrongClock(before_ns, newest_ns, moved_s)
            self.estimator.take_back(self.ledger.sensors.index(name), wrong)

    def advance(self, upto_ns: int, events: Sequence[Event] = ()) -> None:
        """One turn of the loop, over everything valid up to ``upto_ns``; the source's ``events`` go along."""
        rows, repeats = self.align.release(upto_ns)  # one time-ordered stream
        for sensor in set(rows["sensor"].tolist()):
            self._pace[sensor].take(rows["t_ns"][rows["sensor"] == sensor])
        self._judged.append(
            self.ledger.dismiss(
                repeats, "duplicate", self.ledger.reason("this channel already has a value at this time")
            )
        )
        self.ledger.doubt(rows["id"][self.screening.doubts(rows)])  # each channel by itself
        step = self._estimate(rows)  # state and verdicts
        track, notices = self.air.step(step.track, upto_ns)  # wind, or dead reckoning
        track = self._known_only(track)
        self._hand_on(step._replace(track=track), [*notices, *events], failed=self._lost(rows, track))
        self.estimator.rest(upto_ns)  # what need not be done before the state is told

    def finish(self, about: dict) -> dict:
        """Take in what still waits, make every verdict final, and give each sink the summary.

        ``about`` is what only the source knows, such as the log's damage; it joins the summary.
        """
        self.advance(FOREVER_NS)
        self._hand_on(self.estimator.finish())
        best = self._known_only(self.estimator.smooth())
        summary = about | self.summary()
        for sink in self.sinks:
            sink.close(summary, best)
        return summary

    def summary(self) -> dict:
        """Settings, counts by verdict of every sensor and channel, and the estimator's own report."""
        return {
            "software": {"name": "gcs", "version": __version__},
            "settings": self._settings,
            "verdicts": self.ledger.count_table(),
            "doubted_by_screening": self.ledger.count_table(doubted=True),
            "pace": {name: self._pace[k].report() for k, name in enumerate(self.ledger.sensors)},
            "height": {"geoid_separation_from": self.intake.separation_source},
            "estimator": self.estimator.report(),
            "states_not_told": self._senseless,
            "wind": self.air.report(),
        }

    def _estimate(self, rows: np.ndarray) -> Step:
        before = self.estimator.failures
        step = self.estimator.step(rows)
        if self.estimator.failures > before:
            why = self.ledger.reason("the estimator failed here and began anew")
            self._judged.append(self.ledger.abandon(self.align.waiting_ids, why))
        return step

    def _known_only(self, track: np.ndarray) -> np.ndarray:
        """Of (k,) TRACK those that say something; the rest is counted and goes nowhere."""
        if not len(track):
            return track
        good = np.concatenate([says_something(track[k : k + PIECE]) for k in range(0, len(track), PIECE)])
        self._senseless += int((~good).sum())
        return track if good.all() else track[good]

    def _lost(self, rows: np.ndarray, track: np.ndarray) -> bool:
        """Has there been a state, and none for LOST_NS of measurements? Said once for each such stretch."""
        if len(track):
            self._state_ns = int(track["t_ns"][-1])
        newest_ns = int(rows["t_ns"].max(initial=0))
        if not self._state_ns or newest_ns - self._state_ns < LOST_NS:
            return False
        self._state_ns = 0
        return True

    def _hand_on(self, step: Step, notices: Sequence[Wind | Event] = (), *, failed: bool = False) -> None:
        ids = np.concatenate([*self._judged, self.ledger.judge(step.verdicts)])
        self._judged.clear()
        judged = self.ledger.at(ids)
        smoothed, retired = self._known_only(step.smoothed), self.ledger.retire()
        report = self.estimator.report
        update = Update(
            step.track, smoothed, judged, retired, self.ledger, notices, report, failed, self.ledger.parting,
            step.separation,
        )  # fmt: skip
        for sink in self.sinks:
            sink.take(update)


def says_something(track: np.ndarray) -> np.ndarray:
    """(k,) bool, whether each of (k,) TRACK is a state: numbers, a place that can be, no mere guess."""
    x, variance = track["x"], np.diagonal(track["P"], axis1=1, axis2=2)
    finite = np.isfinite(x).all(axis=1) & np.isfinite(track["P"]).all(axis=(1, 2))
    with np.errstate(invalid="ignore"):
        known = (variance >= 0.0).all(axis=1) & (variance[:, :3].max(axis=1, initial=0.0) <= GUESS_M**2)
        possible = ((x >= LOW) & (x <= HIGH)).all(axis=1)
    return finite & known & possible


def _make_estimator(
    method: str, sensors: list, settings: Settings, correction: Callable, keep: Keep
) -> Estimator:
    try:
        return methods.make(method, sensors, settings, correction, keep)
    except ValueError as error:
        raise InputError(str(error)) from None
