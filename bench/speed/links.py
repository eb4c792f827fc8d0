"""One log twice: read after the flight, and message by message as a live link hands it on.

    python -m bench links FLIGHT.tlog ...

Live is the decoder of the link and the station's turns, at the log's receipt stamps, with no socket between.
For each log: values that came in and their verdicts, both ways, and how far the best estimates are apart
where both have one. What may differ, and why:

    clock     a log knows all SYSTEM_TIMEs of a boot, a link the last minute's; without any, a link learns the
              least delay while it goes, and begins 10 s later: 35 ms apart on codelever_16, and so a value in
              a manoeuvre may be judged otherwise; 6 m at worst where the autopilot is alone, 1 sigma 5 m
    climb     a wrong sign of the climb rate is found in the whole log, by a link five positions into a climb
    IMU       a link learns from the first 20 samples whether it is an accelerometer
    restart   rows of a boot whose clock is not known yet wait, and may then be late
"""

from collections.abc import Sequence
from pathlib import Path
from typing import NamedTuple

import msgspec
import numpy as np

from bridges.mavlink.decoder import Decoder
from bridges.tlog import flight as tlog_flight
from bridges.tlog import tlog
from gcs.contract.config import Position, RangeSection, Station, VehicleSection
from gcs.contract.frames import Frame
from gcs.contract.messages import AirData
from gcs.station.session import Session, Update
from gcs.station.sources import live, replay

TURN_NS = 20_000_000
MATCH_NS = 300_000_000  # of an epoch that both have, carried on by its velocity: stamps of a link differ


class Kept:
    """A sink for the best estimate and the summary."""

    def __init__(self) -> None:
        self.best = np.empty(0)
        self.summary: dict = {}

    def take(self, update: Update) -> None: ...

    def close(self, summary: dict, best: np.ndarray) -> None:
        self.summary, self.best = summary, best

    def counts(self) -> dict[str, int]:
        """By verdict, over all channels of the INS."""
        out: dict[str, int] = {}
        for channel in self.summary["verdicts"].get("ins", {}).values():
            for verdict, n in channel.items():
                out[verdict] = out.get(verdict, 0) + n
        return out


class Both(NamedTuple):
    """The two runs of one log."""

    live: Kept
    log: Kept

    def apart_m(self) -> np.ndarray:
        """(n,) distance of the best estimates at the epochs that both have."""
        ours, theirs = self.live.best, self.log.best
        if not (len(ours) and len(theirs)):
            return np.empty(0)
        at = np.clip(np.searchsorted(theirs["t_ns"], ours["t_ns"]), 1, len(theirs) - 1)
        at -= ours["t_ns"] - theirs["t_ns"][at - 1] < theirs["t_ns"][at] - ours["t_ns"]
        near = np.abs(ours["t_ns"] - theirs["t_ns"][at]) < MATCH_NS
        moved = ours["x"][:, :3] - theirs["x"][at][:, :3]
        ran_s = (ours["t_ns"] - theirs["t_ns"][at]) / 1e9
        return np.linalg.norm(moved - ran_s[:, None] * ours["x"][:, 3:6], axis=1)[near]


def both(log: Path, seconds: float | None = None, system_id: int | None = None) -> Both:
    """A log, or its first ``seconds`` of receipt, both ways. Raises LogError as ``tlog_flight.flight``."""
    read = tlog.read(log)
    vehicle = tlog_flight.flight(read, system_id).vehicle
    told = VehicleSection(system_id=vehicle.system_id)
    flight = replay.load(log, Station(vehicle=told), {})
    origin = Position(**dict(zip(("lat_deg", "lon_deg", "alt_m"), flight.frame, strict=True)))
    station = msgspec.structs.replace(Station(), range=RangeSection(origin=origin))
    until_us = read.receipt_us[0] + round((seconds or 1e9) * 1e6)
    if seconds:
        end_ns = int(flight.ins["arrival_ns"].min()) + round(seconds * 1e9)
        flight = flight._replace(ins=flight.ins[flight.ins["arrival_ns"] <= end_ns], end_ns=end_ns)
    return Both(_live(log, station, flight.frame, vehicle.system_id, until_us), _after(station, flight))


def _after(station: Station, flight: replay.MeasuredFlight) -> Kept:
    kept = Kept()
    session = Session(station, flight.frame, [kept])
    session.enter(replay.batch(flight, session.intake))
    session.enter_air(flight.air)
    session.finish({})
    return kept


def _live(log: Path, station: Station, frame: Frame, system_id: int, until_us: int) -> Kept:
    from pymavlink import mavutil

    kept = Kept()
    session = Session(station, frame, [kept])
    feeds = live.Arrivals(session.ledger.sensors, station.filter.lateness_s)
    decoder, link = Decoder(system_id), mavutil.mavlogfile(str(log))
    arrived: list = []
    turn_ns = 0
    while (message := link.recv_msg()) is not None:
        receipt_ns = round(message._timestamp * 1e6) * 1000
        if receipt_ns > until_us * 1000:
            break
        if message.get_type() != "BAD_DATA" and not message.get_type().startswith("UNKNOWN"):
            found = decoder.decode(message, receipt_ns)
            arrived += [("air" if isinstance(one, AirData) else "ins", one) for one in found]
        if receipt_ns - turn_ns >= TURN_NS:
            live.turn(session, feeds, arrived, receipt_ns)
            arrived, turn_ns = [], receipt_ns
    link.close()
    arrived += [("air" if isinstance(one, AirData) else "ins", one) for one in decoder.flush()]
    live.turn(session, feeds, arrived, turn_ns + TURN_NS)
    live.finish(session, feeds, {})
    return kept


def run(logs: Sequence[Path], seconds: float | None, system_id: int | None) -> None:
    """A line for each log."""
    for log in logs:
        try:
            got = both(log, seconds, system_id)
        except tlog.LogError as error:
            print(f"{log.name}: {error}")
            continue
        apart = got.apart_m()
        worst = f"median {np.median(apart):.4f} m, worst {apart.max():.3f} m" if len(apart) else "none"
        print(f"{log.name}\n   live {got.live.counts()}\n   log  {got.log.counts()}")
        print(f"   best estimates apart: {worst}; {len(apart)} of {len(got.log.best)} epochs", flush=True)
