"""The messages on the bus, and the same as columns.

Every message is JSON by default (MessagePack by choice), tagged with its ``type``; the Zenoh encoding
string names the schema: ``application/json;gcs.State``. Frames and units: ``gcs/__init__.py``.

Every float that a source may leave out is ``float | None`` on the wire and NaN in columns.
"""

from collections.abc import Iterable
from typing import Annotated

import msgspec
import numpy as np

from gcs.contract.limits import WIRE_NS

INSTRUMENT_CHANNELS = ("range", "azimuth", "elevation", "range_rate")
INS_CHANNELS = ("e", "n", "u", "ve", "vn", "vu", "ae", "an", "au")
CHANNELS = INSTRUMENT_CHANNELS + INS_CHANNELS
VERDICTS = ("used", "deweighted", "isolated", "patch", "invalid", "duplicate", "late")
GRAVITY_MPS2 = 9.80665  # standard gravity, what is taken off a specific force
JSON = "application/json"
MSGPACK = "application/msgpack"


TimeNs = Annotated[int, msgspec.Meta(ge=-WIRE_NS, le=WIRE_NS)]  # what is beyond is refused when decoded
Count = Annotated[int, msgspec.Meta(ge=1, le=10**9)]


class InputError(ValueError):
    """Input or settings that cannot be used. The message is one line: which file, where, what to do."""


class _Message(msgspec.Struct, frozen=True, kw_only=True, tag_field="type"):
    """Base: immutable, keyword only, tagged by class name."""


class InsMeasurement(_Message, frozen=True, kw_only=True):
    """What the aircraft says about itself. Position, velocity and acceleration may come apart."""

    t_ns: TimeNs
    arrival_ns: TimeNs
    lat_deg: float | None = None
    lon_deg: float | None = None
    alt_msl_m: float | None = None  # as the receiver defines mean sea level
    geoid_separation_m: float | None = None  # ellipsoidal minus mean-sea-level height, the receiver's own
    ve_mps: float | None = None  # velocity, local ENU at the aircraft
    vn_mps: float | None = None
    vu_mps: float | None = None
    ae_mps2: float | None = None  # kinematic acceleration (gravity removed), local ENU at the aircraft
    an_mps2: float | None = None
    au_mps2: float | None = None
    dead_reckoned: bool = False  # position and velocity are the autopilot's own guess: it has lost GPS


class PolarMeasurement(_Message, frozen=True, kw_only=True):
    """What a theodolite or a radar saw, in its own local ENU frame."""

    t_ns: TimeNs
    arrival_ns: TimeNs
    range_m: float | None = None
    azimuth_deg: float | None = None  # clockwise from true north
    elevation_deg: float | None = None  # up from the local horizontal
    range_rate_mps: float | None = None  # positive when going away
    sigma_range_m: float | None = None  # 1-sigma noise of this one value; None: the station file's
    sigma_azimuth_deg: float | None = None
    sigma_elevation_deg: float | None = None
    sigma_range_rate_mps: float | None = None


class AirData(_Message, frozen=True, kw_only=True):
    """How the aircraft moves through the air, by its own sensors."""

    t_ns: TimeNs
    arrival_ns: TimeNs
    airspeed_mps: float  # calibrated: what the pitot tube would say at sea level
    alt_msl_m: float
    roll_deg: float
    pitch_deg: float
    yaw_deg: float  # clockwise from true north
    coordinated: bool  # a fixed wing, whose nose points where it flies through the air
    own_wind_e_mps: float | None = None  # the autopilot's estimate: where the air goes
    own_wind_n_mps: float | None = None


class Bad(_Message, frozen=True, kw_only=True):
    """Input that is no measurement. It travels like one, so that it gets its verdict: ``invalid``."""

    source: str  # the sensor's name
    where: str  # "theo-north.csv:17", "udp 127.0.0.1:9001 #3", "byte 4711"
    reason: str
    raw: str = ""  # the input itself, clipped
    t_ns: TimeNs | None = None  # when it says so itself
    count: Count = 1  # of lines or messages that this one stands for


class State(_Message, frozen=True, kw_only=True):
    """The cleaned state. On ``state`` as known now, on ``smoothed`` a window later with decisions final."""

    t_ns: TimeNs
    seq: int  # counts from 0 on each key
    lat_deg: float
    lon_deg: float
    alt_m: float
    position_enu_m: tuple[float, float, float]
    velocity_enu_mps: tuple[float, float, float]
    acceleration_enu_mps2: tuple[float, float, float]
    covariance: list[float]  # (45,) lower triangle by rows of the 9×9 covariance of p, v, a
    quality: int  # 0 … 100; −1 failed (as MAVLink ODOMETRY)
    reset_counter: int
    age_s: dict[str, float] = {}  # age of each sensor's newest measurement at ``t_ns``
    protection_h_m: float | None = None  # horizontally it holds within this even if any one sensor lies
    protection_v_m: float | None = None  # … in height; None: not told, or no bound
    ambiguous: bool = False  # another position fits the measurements nearly as well


class Verdict(_Message, frozen=True, kw_only=True):
    """What was done with one row, and why. A later message with the same row replaces it."""

    t_ns: TimeNs
    sensor: str
    channel: str
    value: float | None  # units of the input
    predicted: float | None
    sigma: float | None
    weight: float
    verdict: str
    reason: str
    position_enu_m: tuple[float, float, float] | None = None  # where it claims the target was, for the view
    final: bool = True


class Wind(_Message, frozen=True, kw_only=True):
    """The mean wind out of air data and the cleaned velocity, once a second while positions come."""

    t_ns: TimeNs
    speed_mps: float
    from_deg: float  # where it blows from, clockwise from true north
    e_mps: float  # where the air goes
    n_mps: float
    covariance: tuple[float, float, float]  # (m/s)²: east east, east north, north north
    known: bool  # observable: the flight has shown it, to 1 m/s in the worst direction
    airspeed_scale: float  # true airspeed over the measured one
    own_speed_mps: float | None = None  # the autopilot's estimate, to compare
    own_from_deg: float | None = None


class SystematicError(msgspec.Struct, frozen=True, kw_only=True):
    """One systematic error of a sensor, as the station estimates it now."""

    value: float
    sigma: float  # 1 sigma
    unit: str  # m | deg | m/s | s
    known: bool  # the flight has shown it: sigma is well below what was assumed beforehand


class SensorHealth(msgspec.Struct, frozen=True, kw_only=True):
    """One sensor's part of ``Health``."""

    rate_hz: float
    age_s: float | None  # None: nothing has come yet
    outlier_share: float  # of the rows of the last 10 s
    latency_s: float  # arrival minus validity, median of the last 10 s
    alive: bool  # liveliness token present; files are alive until their end
    rows: int = 0  # channel values since the start
    outliers: int = 0
    errors: dict[str, SystematicError] = {}  # by channel, and the clock or the latency


class PartHealth(msgspec.Struct, frozen=True, kw_only=True):
    """How one part of the station does: the link, the session, a sink."""

    running: bool = True  # false: it waits before it is tried again, or has ended
    hung: bool = False  # it has not turned for seconds
    failures: int = 0  # since the start


class Health(_Message, frozen=True, kw_only=True):
    """Published once a second."""

    t_ns: TimeNs
    sensors: dict[str, SensorHealth]
    queue_age_s: float = 0.0  # how long the oldest measurement waits to be taken in
    parts: dict[str, PartHealth] = {}  # of the station's own; none in a replay


class Event(_Message, frozen=True, kw_only=True):
    """Something an operator wants to know: start, end, reset, sensor lost, sensor back."""

    t_ns: TimeNs
    level: str  # info | warning | error
    text: str


class Instrument(msgspec.Struct, frozen=True, kw_only=True):
    """Where an instrument stands, in station ENU."""

    name: str
    kind: str  # theodolite | radar
    position_enu_m: tuple[float, float, float]


class Scene(_Message, frozen=True, kw_only=True):
    """What stands still: served to every view that opens."""

    range: str
    vehicle: str
    origin_lat_deg: float
    origin_lon_deg: float
    origin_alt_m: float
    instruments: list[Instrument]


RAW = InsMeasurement | PolarMeasurement | AirData | Bad
ANY = RAW | State | Wind | Verdict | Health | Event | Scene
TYPES = {t.__name__: t for t in ANY.__args__}

_json_encoder, _msgpack_encoder = msgspec.json.Encoder(), msgspec.msgpack.Encoder()
_json_decoder, _msgpack_decoder = msgspec.json.Decoder(ANY), msgspec.msgpack.Decoder(ANY)


def encode(message: ANY, media: str = JSON) -> tuple[bytes, str]:
    """Return (payload, encoding string)."""
    encoder = _msgpack_encoder if media == MSGPACK else _json_encoder
    return encoder.encode(message), f"{media};gcs.{type(message).__name__}"


def decode(payload: bytes, encoding: str = JSON) -> ANY:
    """The message in ``payload``. Raises ``msgspec.ValidationError`` when it is none of ours."""
    return (_msgpack_decoder if encoding.startswith(MSGPACK) else _json_decoder).decode(payload)


def schema() -> dict:
    """JSON schema of every message on the bus."""
    return msgspec.json.schema(ANY)


def columns(message_type: type[_Message]) -> np.dtype:
    """The numpy dtype of many measurements of one type: times int64, the rest float64 with NaN for None."""
    names = message_type.__struct_fields__
    return np.dtype([(name, "i8" if name.endswith("_ns") else "f8") for name in names])


INS = columns(InsMeasurement)
POLAR = columns(PolarMeasurement)
AIR = columns(AirData)


def to_columns(messages: Iterable[_Message], message_type: type[_Message]) -> np.ndarray:
    """(n,) structured array of ``columns(message_type)``."""
    rows = [
        tuple(np.nan if v is None else v for v in msgspec.structs.astuple(message)) for message in messages
    ]
    return np.array(rows, dtype=columns(message_type))
