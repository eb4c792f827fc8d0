"""The station file ``station.toml``: every setting, its default and its reason.

A wrong station file raises ``InputError``: one line with the file, the line, what is wrong and, for a
name nobody knows, the names that are valid.
"""

import re
import tomllib
from collections.abc import Sequence
from pathlib import Path
from typing import Annotated, Any, Literal

import msgspec
import tomli_w
from msgspec import Meta

from gcs.contract.messages import InputError

Name = Annotated[str, Meta(pattern=r"^[a-z0-9]([a-z0-9-]*[a-z0-9])?$")]
Latitude = Annotated[float, Meta(ge=-90.0, le=90.0)]
Longitude = Annotated[float, Meta(ge=-180.0, le=180.0)]
Height = Annotated[float, Meta(ge=-1_000.0, le=100_000.0)]
Sigma = Annotated[float, Meta(gt=0.0, le=1_000.0)]
AngleSigma = Annotated[float, Meta(gt=0.0, le=10.0)]


class _Section(msgspec.Struct, forbid_unknown_fields=True, kw_only=True, frozen=True):
    pass


class Position(_Section, frozen=True):
    """WGS84; ``alt_m`` is above the ellipsoid."""

    lat_deg: Latitude
    lon_deg: Longitude
    alt_m: Height


class RangeSection(_Section, frozen=True):
    origin: Position | None = None  # None: the flight's first position
    name: Name = "range"  # first chunk of every key


class VehicleSection(_Section, frozen=True):
    name: Name = "uav1"
    system_id: Annotated[int, Meta(ge=1, le=255)] | None = None  # None: the only vehicle in the log


class SensorSigma(_Section, frozen=True):
    """Measurement noise, 1 sigma. Left out: what is usual for the kind (``KIND_SIGMA``)."""

    range_m: Sigma | None = None
    azimuth_deg: AngleSigma | None = None
    elevation_deg: AngleSigma | None = None
    range_rate_mps: Sigma | None = None


class SensorPrior(_Section, frozen=True):
    """How large a systematic error may be before it is known, 1 sigma."""

    range_m: Sigma = 5.0  # a wrong prism constant or an uncalibrated delay
    azimuth_deg: AngleSigma = 0.05  # orientation to a mark some hundred metres away
    elevation_deg: AngleSigma = 0.05  # levelling
    clock_s: Sigma = 0.1  # a PC clock on NTP over a poor link


KIND_SIGMA = {
    "theodolite": SensorSigma(range_m=1.0, azimuth_deg=0.003, elevation_deg=0.003),
    "radar": SensorSigma(range_m=5.0, azimuth_deg=0.05, elevation_deg=0.05, range_rate_mps=0.5),
}


class SensorSection(_Section, frozen=True):
    name: Name
    kind: Literal["theodolite", "radar"]
    position: Position
    sigma: SensorSigma = SensorSigma()
    latency_s: Annotated[float, Meta(ge=-10.0, le=10.0)] = 0.0  # known: valid time = stamp − latency
    estimate: list[Literal["bias", "clock"]] = []  # systematic errors to estimate while running
    prior: SensorPrior = SensorPrior()
    refraction: Literal["none", "optical", "radar"] = "none"

    @property
    def sigma_by_channel(self) -> dict[str, float]:
        """Noise per channel in input units, the kind's default where the file is silent."""
        usual = KIND_SIGMA[self.kind]
        named = {f: getattr(self.sigma, f) or getattr(usual, f) for f in SensorSigma.__struct_fields__}
        return {f.rsplit("_", 1)[0]: s for f, s in named.items() if s is not None}


class InsSection(_Section, frozen=True):
    """The autopilot's own estimate. Defaults fit ArduPilot and PX4 with a single GPS receiver."""

    position_m: Sigma = 0.3  # white part of the position error; the slow part is the filter's bias state
    height_m: Sigma = 0.5
    velocity_mps: Sigma = 0.2  # EKF velocity during manoeuvres
    acceleration_mps2: Sigma = 1.5  # strap-down accelerometer through vibration and attitude error
    latency_s: Annotated[float, Meta(ge=-1.0, le=2.0)] = 0.0  # known part
    geoid_separation_m: Annotated[float, Meta(ge=-110.0, le=90.0)] | None = None  # None: the receiver's own


class MavlinkSection(_Section, frozen=True):
    link: str = "udpin:127.0.0.1:14550"  # where ground stations listen; any pymavlink address


class BusSection(_Section, frozen=True):
    mode: Literal["router", "client", "peer"] = "router"  # router: the station itself, for one machine
    endpoint: str = "tcp/127.0.0.1:7447"  # zenoh's own port, on loopback
    media: Literal["json", "msgpack"] = "json"  # msgpack where the link is thin


class ViewSection(_Section, frozen=True):
    port: Annotated[int, Meta(ge=1, le=65535)] = 8080


class AlignSection(_Section, frozen=True):
    hold_s: Annotated[float, Meta(ge=0.0, le=2.0)] = 0.3  # longest wait for a slower source, live only


class ScreeningSection(_Section, frozen=True):
    on: bool = (
        True  # each raw channel of the instruments watched alone too: a witness in the record, no judge
    )


class Station(_Section, frozen=True):
    range: RangeSection = RangeSection()
    vehicle: VehicleSection = VehicleSection()
    sensor: list[SensorSection] = []
    ins: InsSection = InsSection()
    mavlink: MavlinkSection = MavlinkSection()
    bus: BusSection = BusSection()
    view: ViewSection = ViewSection()
    align: AlignSection = AlignSection()
    screening: ScreeningSection = ScreeningSection()
    filter: dict[str, float | int | bool | str] = {}  # filters.smoother.estimator.Settings by name


def load(path: Path | None, overrides: Sequence[str] = ()) -> Station:
    """The station in ``path`` (defaults for None) with ``KEY=VALUE`` overrides such as ``ins.height_m=2``.

    Raises ``InputError``.
    """
    text = "" if path is None else _read(path)
    where = "station" if path is None else str(path)
    try:
        tree = tomllib.loads(text)
    except tomllib.TOMLDecodeError as error:
        what, line = re.fullmatch(r"(.*?)(?: \(at line (\d+), .*\))?", str(error)).groups()  # type: ignore[union-attr]
        raise InputError(f"{where}:{line or 1}: not TOML: {what[0].lower()}{what[1:]}") from None
    for override in overrides:
        _override(tree, override)
    try:
        station = msgspec.convert(tree, Station)
    except msgspec.ValidationError as error:
        raise InputError(_explain(where, text, str(error))) from None
    names = [sensor.name for sensor in station.sensor]
    for name in names:
        if name in ("ins", "air") or names.count(name) > 1:
            line = _line_of(text, ["sensor", len(names) - 1 - names[::-1].index(name), "name"])
            raise InputError(f"{where}:{line}: sensor name {name!r} is taken; give each its own")
    return station


def dump(station: Station) -> str:
    """The resolved station as TOML, every default written out."""

    def prune(node: Any) -> Any:
        if isinstance(node, dict):
            return {key: prune(value) for key, value in node.items() if value is not None}
        return [prune(item) for item in node] if isinstance(node, list) else node

    return tomli_w.dumps(prune(msgspec.to_builtins(station)))


def _read(path: Path) -> str:
    try:
        return path.read_text(encoding="utf-8")
    except FileNotFoundError:
        raise InputError(f"{path}: no such station file; name one with --station") from None
    except (OSError, UnicodeDecodeError) as error:
        raise InputError(f"{path}: not a readable text file ({error})") from None


def _override(tree: dict, override: str) -> None:
    """Set one dotted key; sensors go by name: ``sensor.theo-north.latency_s=0.1``."""
    key, equals, raw = override.partition("=")
    if not equals:
        raise InputError(f"--config {override}: expected KEY=VALUE, such as ins.height_m=2.0")
    try:
        value = tomllib.loads(f"x = {raw}")["x"]
    except tomllib.TOMLDecodeError:
        value = raw
    node, parts = tree, key.strip().split(".")
    if parts[0] == "sensor" and len(parts) > 2:
        sensors = {sensor.get("name"): sensor for sensor in tree.get("sensor", [])}
        if parts[1] not in sensors:
            raise InputError(f"--config {override}: no sensor {parts[1]!r}; there are {_names(sensors)}")
        node, parts = sensors[parts[1]], parts[2:]
    for part in parts[:-1]:
        node = node.setdefault(part, {})
        if not isinstance(node, dict):
            raise InputError(f"--config {override}: {part!r} is no section")
    node[parts[-1]] = value


def _explain(where: str, text: str, error: str) -> str:
    """msgspec's message, with the line in the file and the valid names."""
    what, _, path = error.partition(" - at `$")
    steps = [int(s) if s.isdigit() else s for s in re.findall(r"[\w-]+", path)]
    unknown = re.search(r"unknown field `(.+?)`", what)
    if unknown:
        steps.append(unknown[1])
        valid = _names(field.name for field in _type_at(steps[:-1]).fields)
        what = f"unknown name {unknown[1]!r}; valid names are {valid}"
    elif what.startswith("Invalid enum"):
        what = f"{what[0].lower()}{what[1:]}; valid are {_names(_type_at(steps).values)}"
    else:
        what = f"{'.'.join(map(str, steps))}: {what[0].lower()}{what[1:]}"
    return f"{where}:{_line_of(text, steps)}: {what}"


def _type_at(steps: list) -> Any:
    """msgspec's description of the type that ``steps`` leads to."""
    kind: Any = msgspec.inspect.type_info(Station)
    for step in steps:
        is_list = isinstance(kind, msgspec.inspect.ListType)
        kind = kind.item_type if is_list else next(f.type for f in kind.fields if f.name == step)
        if isinstance(kind, msgspec.inspect.UnionType):
            kind = next(t for t in kind.types if not isinstance(t, msgspec.inspect.NoneType))
    return kind


def _line_of(text: str, steps: list) -> int:
    """The line where the setting at ``steps`` stands: its own, else its section's, else 1."""
    section, key = steps[0] if steps else "", next((s for s in reversed(steps) if isinstance(s, str)), "")
    nth = next((s for s in steps if isinstance(s, int)), 0)
    found, current = 1, ""
    seen: dict[str, int] = {}
    for number, line in enumerate(text.splitlines(), 1):
        header = re.match(r"\s*\[+\s*([\w.-]+)\s*\]+", line)
        if header:
            current = header[1].split(".")[0]
            if line.lstrip().startswith("[[") and "." not in header[1]:
                seen[current] = seen.get(current, -1) + 1
        inside = current == section and seen.get(current, 0) == nth
        if header and (inside or header[1] == key):
            found = number
        elif (inside or (not current and key == section)) and re.search(
            rf"(^|[\s{{,]){re.escape(key)}\s*=", line
        ):
            return number
    return found


def _names(names: Any) -> str:
    return ", ".join(sorted(map(str, names))) or "none"
