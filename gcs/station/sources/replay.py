"""After the flight: a tlog, feed files or both through the same session, on the flight's own clock."""

import time
from collections.abc import Callable, Container, Iterator, Mapping
from pathlib import Path
from typing import NamedTuple, Protocol

import msgspec
import numpy as np

from bridges.instruments import KINDS
from bridges.tlog import flight as tlog_flight
from bridges.tlog import tlog
from gcs.contract.config import Station
from gcs.contract.frames import Frame, origin_frame
from gcs.contract.messages import AIR, CHANNELS, INS, INSTRUMENT_CHANNELS, Event, InputError
from gcs.station.intake import Batch, Intake, ins_sigma, merge
from gcs.station.ledger import NO_TIME
from gcs.station.session import FOREVER_NS, Session
from gcs.station.sources import stamps
from gcs.station.sources.courses import Sightings
from gcs.station.sources.inputs import digests
from gcs.station.sources.playback import Playback

APART_NS = 60_000_000_000  # a feed row this far outside the flight cannot belong to it
TURN_DEG = 5.0  # an instrument that disagrees with the aircraft by more than this is looking elsewhere


class MeasuredFlight(NamedTuple):
    """Everything that was measured, still in input units."""

    frame: Frame
    ins: np.ndarray  # (n,) INS
    air: np.ndarray  # (n,) AIR
    feeds: dict[str, tuple]  # name → ((m,) POLAR, list of Bad)
    about: dict  # what the summary says of the source
    start_ns: int
    end_ns: int

    @property
    def times_ns(self) -> np.ndarray:
        """(n,) int64, in order: when something was measured."""
        feeds = (rows["t_ns"] for rows, _ in self.feeds.values())
        return np.sort(np.concatenate([self.ins["t_ns"], self.air["t_ns"], *feeds]))

    def replay(self, session: Session) -> "FlightReplay":
        return FlightReplay(self, session)


class FlightReplay:
    """A measured flight on its way into a session."""

    def __init__(self, flight: MeasuredFlight, session: Session):
        self._about, self._session = flight.about, session
        self._whole, self._events = batch_and_events(flight, session.intake)
        self._taken = 0
        session.enter_air(flight.air)

    def take(self, upto_ns: int) -> None:
        """Everything valid up to ``upto_ns``."""
        until = int(np.searchsorted(self._whole.valid_ns, upto_ns, side="right"))
        self._session.enter(Batch(*(column[self._taken : until] for column in self._whole)))
        told = sum(event.t_ns <= upto_ns for event in self._events)
        self._session.advance(upto_ns, self._events[:told])
        self._taken, self._events = until, self._events[told:]

    def finish(self, *, complete: bool) -> dict:
        return self._session.finish(self._about | {"complete": complete})


class Replay(Protocol):
    """A flight that is taken into a session piece by piece."""

    def take(self, upto_ns: int) -> None: ...

    def finish(self, *, complete: bool) -> dict: ...


class Replayable(Protocol):
    """A flight that is over: measured, or recorded live."""

    @property
    def start_ns(self) -> int: ...

    @property
    def end_ns(self) -> int: ...

    @property
    def times_ns(self) -> np.ndarray: ...

    def replay(self, session: Session) -> Replay: ...


def load(log: Path | None, station: Station, feeds: dict[str, Path]) -> MeasuredFlight:
    """Read a flight; without a ``log`` the feeds alone are one.

    Raises ``InputError`` with one line that says which file, where and what to do.
    """
    kinds = {sensor.name: sensor.kind for sensor in station.sensor}
    for name in feeds:
        if name not in kinds:
            raise InputError(
                f"--feed {name}: the station has no sensor of that name; it has {', '.join(kinds) or 'none'}"
            )
    if log is None:
        return _feeds_alone(station, kinds, feeds)
    own = tlog_flight.flight(tlog.read(log), station.vehicle.system_id)
    ins = own.rows
    measured = {name: KINDS[kinds[name]].read(path, name) for name, path in feeds.items()}
    frame = _frame(station, ins)
    start_ns, end_ns = int(ins["t_ns"].min()), int(ins["t_ns"].max())
    where = ins[np.isfinite(ins["lat_deg"])]
    position = frame.to_enu(where["lat_deg"], where["lon_deg"], where["alt_msl_m"])
    seen = np.column_stack([where["t_ns"] / 1e9, position])
    for sensor in station.sensor:
        if sensor.name in measured and len(measured[sensor.name][0]):
            _check_feed(feeds[sensor.name], measured[sensor.name][0], seen, frame.place_sensor(sensor))
    about = {"log": own.report, "inputs": digests({"flight": log} | feeds)}
    return MeasuredFlight(frame, ins, own.air, measured, about, start_ns, end_ns)


def _feeds_alone(station: Station, kinds: Mapping[str, str], feeds: dict[str, Path]) -> MeasuredFlight:
    """A flight that only the ground has seen: no INS, no air data, the station's own origin."""
    if not feeds:
        raise InputError("nothing to replay: name a flight log, or --feed NAME=FILE.csv")
    if station.range.origin is None:
        raise InputError("feeds alone need [range] origin in the station file: no aircraft says where it is")
    measured = {name: KINDS[kinds[name]].read(path, name) for name, path in feeds.items()}
    times = np.concatenate([rows["t_ns"] for rows, _ in measured.values()])
    if not len(times):
        raise InputError(f"{', '.join(map(str, feeds.values()))}: not one line can be used")
    about = {"log": None, "inputs": digests(feeds)}
    return MeasuredFlight(
        origin_frame(station),
        np.empty(0, INS),
        np.empty(0, AIR),
        measured,
        about,
        int(times.min()),
        int(times.max()),
    )


def heard(station: Station, feeds: Container[str]) -> Station:
    """The station with the instruments that have a feed: one that is silent has no vote in the estimator."""
    return msgspec.structs.replace(station, sensor=[s for s in station.sensor if s.name in feeds])


def batch(flight: MeasuredFlight, intake: Intake) -> Batch:
    """All of a flight's values in order of valid time; those outside the flight are complained of."""
    return batch_and_events(flight, intake)[0]


def batch_and_events(flight: MeasuredFlight, intake: Intake) -> tuple[Batch, list[Event]]:
    """As ``batch``, and what an operator should know of the stamps, in order of time."""
    own = intake.ins(flight.ins)
    values = {name: intake.polar(name, measured) for name, (measured, _) in flight.feeds.items()}
    found = stamps.check(_as_seen(flight, intake, own))
    parts = [
        _complained(intake, of, found.wrong[name][of.entries["measurement"]]) if name in found.wrong else of
        for name, of in ({"ins": own} | values).items()
    ]
    parts += [intake.bad(name, bads) for name, (_, bads) in flight.feeds.items()]
    merged = merge(parts)
    outside = (merged.valid_ns < flight.start_ns - APART_NS) | (merged.valid_ns > flight.end_ns + APART_NS)
    outside &= merged.complaints == 0
    merged.complaints[outside] = intake.ledger.reason("not within a minute of the flight")
    timed = outside & (merged.entries["t_ns"] != NO_TIME)
    return merged, [*_outside(intake, flight, merged.entries["sensor"][timed]), *found.events]


def _outside(intake: Intake, flight: MeasuredFlight, sensor: np.ndarray) -> Iterator[Event]:
    """One event for each of the sensors (n,) that have values from another time."""
    for k, values in zip(*np.unique(sensor, return_counts=True), strict=True):
        text = f"{intake.names[k]}: {values} values are stamped over a minute outside the flight: refused"
        yield Event(t_ns=flight.start_ns, level="warning", text=text)


def _as_seen(flight: MeasuredFlight, intake: Intake, own: Batch) -> dict[str, Sightings]:
    """What every source saw, the aircraft itself first."""
    placed = (own.entries["channel"] == CHANNELS.index("e")) & (own.complaints == 0)
    where = np.full((len(flight.ins), 3), np.nan)
    where[own.entries["measurement"][placed]] = own.entries["position_m"][placed]
    valid_ns = flight.ins["t_ns"].copy()
    valid_ns[own.entries["measurement"]] = own.valid_ns
    seen = {"ins": Sightings(valid_ns, where, ins_sigma(intake.station.ins)[:3], polar=False)}
    for sensor in intake.station.sensor:
        if sensor.name in flight.feeds:
            rows, known = flight.feeds[sensor.name][0], sensor.sigma_by_channel
            values = np.stack([rows["range_m"], *np.radians([rows["azimuth_deg"], rows["elevation_deg"]])], 1)
            sigma = np.array([known.get(name, np.nan) for name in INSTRUMENT_CHANNELS[:3]])
            sigma[1:] = np.radians(sigma[1:])
            seen[sensor.name] = Sightings(rows["t_ns"], values, sigma, *intake.places[sensor.name])
    return seen


def _complained(intake: Intake, batch: Batch, wrong: np.ndarray) -> Batch:
    """The batch with the values (n,) bool complained of, where nothing else is wrong with them."""
    reason = intake.ledger.reason(stamps.OFF)
    return batch._replace(complaints=np.where(wrong & (batch.complaints == 0), reason, batch.complaints))


def run(flight: Replayable, new_session: Callable[[], Session], playback: Playback, *, stay: bool) -> dict:
    """Play a flight through; ``stay``: at its end wait for another seek. Returns the last summary."""
    while True:
        replay = flight.replay(new_session())
        while (upto_ns := playback.upto()) is not None:
            replay.take(upto_ns)
            if playback.stopped or upto_ns == playback.end_ns:
                break
        if upto_ns is None:
            continue
        if not playback.stopped:
            replay.take(FOREVER_NS)
        summary = replay.finish(complete=not playback.stopped)
        if not stay or playback.stopped or playback.upto() is not None:
            return summary


def _frame(station: Station, ins: np.ndarray) -> Frame:
    """The station's origin; without one, the flight's first position."""
    if station.range.origin:
        return origin_frame(station)
    first = ins[np.isfinite(ins["lat_deg"])][0]
    separation = station.ins.geoid_separation_m
    if separation is None:
        separation = float(np.nan_to_num(first["geoid_separation_m"]))
    return Frame(float(first["lat_deg"]), float(first["lon_deg"]), float(first["alt_msl_m"]) + separation)


def _check_feed(path: Path, measured: np.ndarray, flight: np.ndarray, place: tuple) -> None:
    """Refuse a feed that as a whole is from another time, or in radians.

    ``flight`` (n, 4): the aircraft's own t in s and station ENU; ``place``: offset and rotation.
    """
    t_s = measured["t_ns"] / 1e9
    inside = (t_s >= flight[0, 0] - APART_NS / 1e9) & (t_s <= flight[-1, 0] + APART_NS / 1e9)
    if not inside.any():
        spans = [" to ".join(_utc(t) for t in (span.min(), span.max())) for span in (t_s, flight[:, 0])]
        raise InputError(
            f"{path}: covers {spans[0]}, the flight {spans[1]}; check the clock and time zone of the feed"
        )
    offset, rotation = place
    seen = np.stack([np.interp(t_s[inside], flight[:, 0], flight[:, k]) for k in (1, 2, 3)], axis=1)
    east, north, _ = rotation @ (seen - offset).T
    expected, azimuth = np.degrees(np.arctan2(east, north)), measured["azimuth_deg"][inside]
    in_degrees, in_radians = (_median_turn(expected, a) for a in (azimuth, np.degrees(azimuth)))
    if in_degrees > TURN_DEG > in_radians:
        raise InputError(f"{path}: azimuth_deg is in radians; multiply azimuth and elevation by 57.29578")


def _median_turn(a_deg: np.ndarray, b_deg: np.ndarray) -> float:
    away = np.abs((a_deg - b_deg + 180.0) % 360.0 - 180.0)
    return float(np.median(away[np.isfinite(away)])) if np.isfinite(away).any() else 0.0


def _utc(t_s: float) -> str:
    return time.strftime("%Y-%m-%d %H:%M:%SZ", time.gmtime(t_s))
