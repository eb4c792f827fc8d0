"""The loop, the same for live and replay.

measurements → intake → align → witness, estimator → air → ledger → sinks
"""

from collections.abc import Callable, Sequence
from typing import NamedTuple, Protocol

import msgspec
import numpy as np

from filters import methods
from filters.correction.correction import off
from filters.models.settings import Settings
from filters.screening.witness import Nobody, Witness
from filters.smoother import status
from gcs import __version__
from gcs.contract.config import Station
from gcs.contract.frames import Frame
from gcs.contract.messages import Event, InputError, Wind
from gcs.station.air import Air
from gcs.station.align import Align
from gcs.station.intake import Batch, Intake, sensors_of, settings_of
from gcs.station.ledger import Ledger

FOREVER_NS = np.iinfo(np.int64).max
GAP, GAP_S = 5.0, 0.5  # a pause of so many usual intervals, and of at least so long, is a gap


class Update(NamedTuple):
    """What one turn of the loop brought, for the sinks."""

    track: np.ndarray  # (k,) TRACK, causal, one per epoch
    smoothed: np.ndarray  # (m,) TRACK, decisions final
    judged: np.ndarray  # (v,) ENTRY whose verdict is new or has changed
    retired: np.ndarray  # (r,) ENTRY, final, in order of arrival
    ledger: Ledger  # gives names and ``reason_texts``
    told: Sequence[Wind | Event] = ()  # of the air
    report: Callable[[], dict] = dict  # the estimator's own, of this moment


class Sink(Protocol):
    """Takes updates. ``close``, called once, gets the summary and the best estimate, (n,) TRACK."""

    def take(self, update: Update) -> None: ...

    def close(self, summary: dict, best: np.ndarray) -> None: ...


class Session:
    """One flight, from its first measurement to its summary."""

    def __init__(
        self,
        station: Station,
        frame: Frame,
        sinks: Sequence[Sink],
        method: str = "default",
        correction: Callable = off,
    ):
        self.sensors = sensors_of(station, frame)
        self.ledger = Ledger([sensor.name for sensor in self.sensors], status.REASONS)
        self.intake = Intake(station, frame, self.ledger)
        self.align = Align(station.align.hold_s)
        settings = settings_of(station, frame)
        self.estimator = _make_estimator(method, self.sensors, settings, correction)
        self._settings = {
            "method": method,
            "learned_correction": correction is not off,
            "filter": {name: None if value != value else value for name, value in settings._asdict().items()},
            "station": msgspec.to_builtins(station),
        }
        self.witness = Witness(self.sensors) if station.screening.on else Nobody()
        self.air = Air()
        self.sinks = sinks
        self._judged: list[np.ndarray] = []
        self._times: list[list[np.ndarray]] = [
            [] for _ in self.sensors
        ]  # valid times that reached the filter

    def enter(self, batch: Batch, arrival_ns: int | None = None) -> None:
        """Take measurements in; ``arrival_ns`` where they came live."""
        rows, invalid = self.intake.enter(batch)
        self._judged.append(invalid)
        self.align.add(rows, arrival_ns)

    def enter_air(self, samples: np.ndarray) -> None:
        """Take (n,) AIR in."""
        self.air.enter(samples)

    def advance(self, upto_ns: int) -> None:
        """One turn of the loop, over everything valid up to ``upto_ns``."""
        rows, repeats = self.align.release(upto_ns)  # one time-ordered stream
        for sensor, times in enumerate(self._times):
            times.append(rows["t_ns"][rows["sensor"] == sensor])
        self._judged.append(
            self.ledger.dismiss(
                repeats, "duplicate", self.ledger.reason("this channel already has a value at this time")
            )
        )
        self.ledger.doubt(rows["id"][self.witness.doubts(rows)])  # each channel by itself
        step = self.estimator.step(rows)  # state and verdicts
        track, told = self.air.step(step.track, upto_ns)  # wind, or dead reckoning
        self._hand_on(step._replace(track=track), told)

    def finish(self, about: dict) -> dict:
        """Take in what still waits, make every verdict final, and give each sink the summary.

        ``about`` is what only the source knows, such as the log's damage; it joins the summary.
        """
        self.advance(FOREVER_NS)
        self._hand_on(self.estimator.finish())
        summary, best = about | self.summary(), self.estimator.smooth()
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
            "pace": {name: pace(self._times[k]) for k, name in enumerate(self.ledger.sensors)},
            "height": {"geoid_separation_from": self.intake.separation_source},
            "estimator": self.estimator.report(),
            "wind": self.air.report(),
        }

    def _hand_on(self, step, told: Sequence[Wind | Event] = ()) -> None:
        ids = np.concatenate([*self._judged, self.ledger.judge(step.verdicts)])
        self._judged.clear()
        judged = self.ledger.at(ids)
        retired, report = self.ledger.retire(), self.estimator.report
        update = Update(step.track, step.smoothed, judged, retired, self.ledger, told, report)
        for sink in self.sinks:
            sink.take(update)


def pace(times: list[np.ndarray]) -> dict:
    """Rate and gaps of one sensor from its valid times, arrays of int64 ns."""
    step_s = np.diff(np.unique(np.concatenate([np.empty(0, np.int64), *times]))) / 1e9
    if not len(step_s):
        return {"rate_hz": 0.0, "gaps": 0, "longest_gap_s": 0.0}
    usual_s = float(np.median(step_s))
    gaps = step_s[step_s > max(GAP * usual_s, GAP_S)]
    return {"rate_hz": 1.0 / usual_s, "gaps": len(gaps), "longest_gap_s": float(step_s.max())}


def _make_estimator(method: str, sensors: list, settings: Settings, correction: Callable):
    try:
        return methods.make(method, sensors, settings, correction)
    except ValueError as error:
        raise InputError(str(error)) from None
