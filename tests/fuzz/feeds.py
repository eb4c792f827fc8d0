"""What comes in over a wire or out of a file, made hostile: every decoder, and what its result may be.

A target makes one input from a seeded generator and says what is wrong with what is made of it. Only the
documented errors may be raised; a result must be one that the rest of the station can take.
"""

import copy
import random
import struct
import tempfile
from collections.abc import Callable
from functools import cache
from pathlib import Path
from typing import NamedTuple

import numpy as np
from pymavlink.dialects.v20 import ardupilotmega as dialect

from bridges import feed
from bridges.instant import time_ns
from bridges.instruments import KINDS
from bridges.mavlink.decoder import Decoder
from gcs.contract import config, limits, messages
from gcs.contract.frames import Frame
from gcs.contract.messages import JSON, MSGPACK, AirData, Bad, InputError, InsMeasurement, PolarMeasurement
from gcs.contract.wire.subscription import NOT_OURS
from gcs.station.session import Session
from tests.bridges.flights import flight, packed
from tests.fuzz import mutate, texts

ROOT = Path(__file__).resolve().parents[2]
SAMPLE = ROOT / "logs/sample"
STATION = (SAMPLE / "station.toml").read_bytes()
CSV = {
    name: b"\n".join((SAMPLE / f"{name}.csv").read_bytes().split(b"\n")[:40])
    for name in ("theo-north", "radar-1")
}
ARRIVAL_NS = 1767225600 * 10**9
KIND = {"theo-north": "theodolite", "radar-1": "radar"}
LINES = (
    b'{"t": 1767225600.125, "range_m": 812.4, "azimuth_deg": 12.25, "elevation_deg": 3.5}',
    b'{"t": "2026-01-01T00:00:00.5Z", "range_m": null, "azimuth_deg": 12.25, "sigma_azimuth_deg": 0.01}',
    b'{"t": 1767225600, "elevation_deg": -3, "sigma_elevation_deg": 0.002, "sigma_range_m": 1}',
)
MESSAGES = (
    PolarMeasurement(t_ns=ARRIVAL_NS, arrival_ns=ARRIVAL_NS, range_m=812.4, azimuth_deg=12.0),
    InsMeasurement(t_ns=1, arrival_ns=2, lat_deg=-35.3, lon_deg=149.1, alt_msl_m=600.0, ae_mps2=0.1),
    AirData(
        t_ns=1, arrival_ns=1, airspeed_mps=20.0, alt_msl_m=600.0, roll_deg=1.0, pitch_deg=2.0, yaw_deg=3.0,
        coordinated=True,
    ),
    Bad(source="theo-north", where="udp #1", reason="no JSON object", raw="x"),
)  # fmt: skip
RAW = {"theo-north": PolarMeasurement, "ins": InsMeasurement}
HEARD = tuple(
    dialect.__dict__[f"MAVLINK_MSG_ID_{name}"]
    for name in (
        *("HEARTBEAT", "SYSTEM_TIME", "ATTITUDE", "GPS_RAW_INT", "GPS2_RAW", "GLOBAL_POSITION_INT"),
        *("RAW_IMU", "SCALED_IMU", "SCALED_IMU2", "AIRSPEED", "SYS_STATUS", "WIND", "WIND_COV", "VFR_HUD"),
    )
)
SHORT = 2_000  # characters: no line that an operator reads is longer


class Target(NamedTuple):
    """One thing that is fed."""

    make: Callable[[random.Random], bytes]
    wrong: Callable[[bytes], str]  # what is wrong with what came of it; "" for nothing


def _csv(rng: random.Random) -> bytes:
    return texts.mangled(CSV[rng.choice(list(CSV))], rng, int(2 ** rng.uniform(0.0, 5.0)))


def _wrong_csv(data: bytes) -> str:
    """Each line below the header is rows or complaints, whichever kind of instrument reads it."""
    lines = data.decode("utf-8-sig", errors="replace").replace("\r\n", "\n").split("\n")[1:]
    filled = sum(bool(line) and not line.isspace() for line in lines)
    with tempfile.NamedTemporaryFile(suffix=".csv") as file:
        Path(file.name).write_bytes(data)
        for name, kind in KIND.items():
            try:
                rows, bad = KINDS[kind].read(Path(file.name), name)
            except InputError as error:
                if wrong := _wrong_line(str(error)):
                    return wrong
                continue
            told = len(rows) + len({complaint.where for complaint in bad if complaint.t_ns is None})
            if told < filled:
                return f"{filled} lines, {told} of them rows or complaints"
            if wrong := _wrong_rows(rows) or "".join(map(_wrong_bad, bad)):
                return wrong
    return ""


def _datagram(rng: random.Random) -> bytes:
    lines = b"\n".join(rng.choice(LINES) for _ in range(rng.choice((1, 1, 2, 5))))
    return (
        rng.randbytes(rng.randrange(200))
        if rng.random() < 0.05
        else texts.mangled(lines, rng, rng.randrange(1, 9))
    )


def _wrong_datagram(data: bytes) -> str:
    lines = [line for line in data.decode("utf-8", errors="replace").split("\n") if line.strip()]
    for kind in KINDS.values():
        found = kind.decode(data, ARRIVAL_NS, "theo-north", "udp 127.0.0.1:9001 #1")
        if len(found) < len(lines):
            return f"{len(lines)} lines, {len(found)} results"
        for message in found:
            if wrong := _wrong_raw("theo-north", message):
                return wrong
    return ""


def _payload(rng: random.Random) -> bytes:
    media = rng.choice((JSON, MSGPACK))
    payload, _ = messages.encode(rng.choice(MESSAGES), media)
    mangled = texts.mangled(payload, rng, rng.randrange(1, 6))
    return (b"J" if media == JSON else b"M") + mangled


def _wrong_payload(data: bytes) -> str:
    try:
        message = messages.decode(data[1:], JSON if data[:1] == b"J" else MSGPACK)
    except NOT_OURS:
        return ""
    if not isinstance(message, messages.RAW):
        return ""
    return _wrong_raw("ins" if isinstance(message, InsMeasurement) else "theo-north", message)


def _frames(rng: random.Random) -> bytes:
    """MAVLink 1 and 2 of all that is looked at: random contents, mostly with a right checksum."""
    out = b""
    for _ in range(rng.randrange(1, 20)):
        message = dialect.mavlink_map[rng.choice(HEARD)]
        size, two = message.unpacker.size, rng.random() < 0.5
        payload = bytearray(rng.randbytes(size) if rng.random() < 0.5 else bytes(size))
        for _ in range(rng.randrange(4)):
            at, value = rng.randrange(size), struct.pack("<f", rng.choice(mutate.FLOATS))
            payload[at : at + 4] = value[: size - at]
        seq = rng.randrange(256)
        head = bytes([0xFD, size, 0, 0, seq, 1, 1]) + message.id.to_bytes(3, "little")
        head = head if two else bytes([0xFE, size, seq, 1, 1, message.id & 255])
        frame = mutate.seal(head + bytes(payload)) or b""
        out += frame if rng.random() < 0.9 else texts.mangled(frame, rng, 1)
    return out


def _wrong_frames(data: bytes) -> str:
    """Behind a true flight of some seconds, so that the clock, the attitude and the fix are known."""
    link, decoder = dialect.MAVLink(None), copy.deepcopy(_flown())
    link.robust_parsing = True
    for message in link.parse_buffer(data) or ():
        for found in decoder.decode(message, ARRIVAL_NS):
            name = "ins" if isinstance(found, InsMeasurement) else "theo-north"
            if wrong := _wrong_raw(name, found):
                return wrong
    return ""


@cache
def _flown() -> Decoder:
    decoder = Decoder(None)
    for received in flight(2.5, fix_after_s=0.0):
        for message in dialect.MAVLink(None).parse_buffer(packed([received])[0][mutate.STAMP :]):
            decoder.decode(message, received.receipt_us * 1000)
    return decoder


def _station(rng: random.Random) -> bytes:
    return texts.mangled(STATION, rng, rng.randrange(1, 6))


def _wrong_station(data: bytes) -> str:
    """Refused in one line, or a station that is the same once written out and read again."""
    with tempfile.TemporaryDirectory() as folder:
        path, again = Path(folder) / "station.toml", Path(folder) / "resolved.toml"
        path.write_bytes(data)
        try:
            station = config.load(path)
        except InputError as error:
            return _wrong_line(str(error))
        again.write_text(config.dump(station), encoding="utf-8")
        if config.load(again) != station:
            return "read, written and read again it is another station"
        config.resolved(path)
    return ""


def _override(rng: random.Random) -> bytes:
    name = rng.choice(SETTINGS)
    value = rng.choice(
        (*texts.TOKENS, repr(rng.uniform(-1e3, 1e3)), "[]", "{}", "{ a = 1 }", "[1, 2]", '"x"')
    )
    text = f"{name}={value}".encode(errors="surrogatepass")
    return text if rng.random() < 0.7 else texts.mangled(text, rng, 1)


def _wrong_override(data: bytes) -> str:
    text = data.decode(errors="surrogateescape")  # as a command line comes in
    try:
        config.resolved(SAMPLE / "station.toml", [text])
    except InputError as error:
        return _wrong_line(str(error))
    return ""


SETTINGS = [setting.name for setting in config.resolved(SAMPLE / "station.toml")]


def _stamp(rng: random.Random) -> bytes:
    return texts.mangled(rng.choice(texts.TOKENS).encode(errors="surrogatepass"), rng, rng.randrange(3))


def _wrong_stamp(data: bytes) -> str:
    found = time_ns(data.decode(errors="replace"))
    inside = found is None or limits.FIRST_NS <= found < limits.LAST_NS
    return "" if inside else f"a time out of all bounds: {found}"


def _wrong_line(line: str) -> str:
    if "\n" in line or not line or len(line) > SHORT:
        return f"no line for an operator: {line[:300]!r}"
    return ""


def _wrong_bad(bad: Bad) -> str:
    if len(bad.reason) > SHORT or len(bad.raw) > limits.TEXT:
        return f"a complaint of {len(bad.reason)} characters about {len(bad.raw)}"
    return "" if messages.decode(*messages.encode(bad)) == bad else "a complaint that cannot be sent"


def _wrong_rows(rows: np.ndarray) -> str:
    for name, (low, high) in feed.LIMITS.items():
        values = rows[name][~np.isnan(rows[name])]
        if not ((values >= low) & (values <= high)).all():
            return f"{name} out of its limits: {values}"
    return ""


def _wrong_raw(name: str, message: messages.ANY) -> str:
    """Can it travel, and does each of its values come out of the intake as a row or a complaint?"""
    if isinstance(message, Bad):
        return _wrong_bad(message)
    if messages.decode(*messages.encode(message)) != message and "nan" not in str(message):
        return f"it cannot be sent: {message}"
    if isinstance(message, RAW[name]):
        session = _session()
        measured = messages.to_columns([message], RAW[name])
        batch = session.intake.ins(measured) if name == "ins" else session.intake.polar(name, measured)
        rows, invalid = session.intake.enter(batch)
        if not np.isfinite(rows["value"]).all() or len(rows) + len(invalid) != len(batch.entries):
            return f"{message}: {rows}"
    return ""


@cache
def _session() -> Session:
    """One for all: what came before must not matter."""
    station = config.load(SAMPLE / "station.toml")
    origin = station.range.origin
    assert origin
    return Session(station, Frame(origin.lat_deg, origin.lon_deg, origin.alt_m), [])


TARGETS = {
    "csv": Target(_csv, _wrong_csv),
    "datagram": Target(_datagram, _wrong_datagram),
    "payload": Target(_payload, _wrong_payload),
    "frames": Target(_frames, _wrong_frames),
    "station": Target(_station, _wrong_station),
    "override": Target(_override, _wrong_override),
    "stamp": Target(_stamp, _wrong_stamp),
}


def made(name: str, seed: int) -> bytes:
    """The input of one seed."""
    return TARGETS[name].make(random.Random(f"{name} {seed}"))
