"""The station file ``station.toml``: every setting with its type, its range, its default and its reason.

This is the one source of all of them; ``docs/settings.md`` is written from it. Where the mathematics in
``filters/`` has a default of its own, a test holds the two equal.

A wrong station file raises ``InputError``: one line with the file, the line, what is wrong and what is valid.
"""

import re
from collections.abc import Sequence
from pathlib import Path
from typing import Annotated, Any, Literal

import msgspec
import tomli_w
from msgspec import Meta

from gcs.contract import station_text
from gcs.contract.instrument import (
    KIND_SIGMA,
    Height,
    Name,
    Position,
    Section,
    SensorSection,
    Sigma,
)
from gcs.contract.instrument import ChannelLatency as ChannelLatency
from gcs.contract.instrument import MountTilt as MountTilt
from gcs.contract.instrument import SensorPrior as SensorPrior
from gcs.contract.instrument import SensorSigma as SensorSigma
from gcs.contract.messages import InputError
from gcs.contract.station_text import Setting


class RangeSection(Section, frozen=True):
    """The test range."""

    origin: Annotated[
        Position | None,
        Meta(description="of the local frame; left out: the flight's first position, in a replay only"),
    ] = None
    name: Annotated[Name, Meta(description="first chunk of every key on the bus")] = "range"


class HeightPrior(Section, frozen=True):
    """What is known of the target's height before any measurement."""

    mean: Annotated[Height, Meta(description="in m above the ellipsoid")]
    sigma: Annotated[float, Meta(ge=0.01, le=100_000.0, description="in m, 1 sigma")]


class VehicleSection(Section, frozen=True):
    """The aircraft that is measured."""

    name: Annotated[Name, Meta(description="second chunk of every key on the bus")] = "uav1"
    system_id: Annotated[
        Annotated[int, Meta(ge=1, le=255)] | None,
        Meta(description="MAVLink; left out: the only vehicle in the log, or the first one heard"),
    ] = None
    height_m: Annotated[
        HeightPrior | None,
        Meta(
            description="for a target whose height no instrument sees; taken as a height above the origin's "
            "level plane, so right within some kilometres of the origin (at 10 km 8 m wrong)"
        ),
    ] = None


class InsSection(Section, frozen=True):
    """The autopilot's own estimate. Defaults fit ArduPilot and PX4 with a single GPS receiver."""

    position_m: Annotated[
        Sigma, Meta(description="white part of the horizontal position error; the slow part is a state")
    ] = 0.3
    height_m: Annotated[Sigma, Meta(description="the same of the height")] = 0.5
    velocity_mps: Annotated[Sigma, Meta(description="EKF velocity during manoeuvres")] = 0.2
    acceleration_mps2: Annotated[
        Sigma, Meta(description="strap-down accelerometer through vibration and attitude error")
    ] = 1.5
    latency_s: Annotated[float, Meta(ge=-1.0, le=2.0, description="known part; the rest is a state")] = 0.0
    geoid_separation_m: Annotated[
        Annotated[float, Meta(ge=-110.0, le=90.0)] | None,
        Meta(description="ellipsoidal minus mean-sea-level height; left out: the receiver's own"),
    ] = None


class MavlinkSection(Section, frozen=True):
    """The live link to the vehicle."""

    link: Annotated[str, Meta(description="any pymavlink address; empty: none")] = "udpin:127.0.0.1:14550"


File = Annotated[str, Meta(min_length=1)]


class TlsSection(Section, frozen=True):
    """Who this process is on the bus, and who signs for the others: PEM files, see docs/security."""

    root_ca: Annotated[File, Meta(description="certificate of the range's own authority")]
    certificate: Annotated[File, Meta(description="of this process; its common name is its role")]
    private_key: Annotated[File, Meta(description="of that certificate")]


class BusSection(Section, frozen=True):
    """Zenoh."""

    tls: Annotated[
        TlsSection | None,
        Meta(description="for an endpoint tls/HOST:PORT, where both ends show a certificate; paths as given"),
    ] = None

    mode: Annotated[
        Literal["router", "client", "peer"], Meta(description="router: the station itself, for one machine")
    ] = "router"
    endpoint: Annotated[str, Meta(description="Zenoh's own port, on loopback")] = "tcp/127.0.0.1:7447"
    media: Annotated[Literal["json", "msgpack"], Meta(description="msgpack where the link is thin")] = "json"
    rate_hz: Annotated[
        float,
        Meta(
            ge=1.0,
            le=10_000.0,
            description="measurements taken from one instrument, so that one gone wild cannot drown the "
            "others: fast angle stations give 110; what is beyond is refused and counted",
        ),
    ] = 200.0
    ins_rate_hz: Annotated[
        float,
        Meta(ge=1.0, le=10_000.0, description="the same of the autopilot, which has several messages a turn"),
    ] = 200.0

    @property
    def rates_hz(self) -> dict[str, float]:
        """How much is taken by source; "" for all others."""
        return {"": self.rate_hz, "ins": self.ins_rate_hz, "air": self.ins_rate_hz}


class ViewSection(Section, frozen=True):
    """The view in the browser."""

    port: Annotated[int, Meta(ge=1, le=65535, description="on loopback")] = 8080
    origins: Annotated[
        list[str],
        Meta(description="of pages that may talk to it beside this machine's own: https://HOST of a proxy"),
    ] = msgspec.field(default_factory=list)

    ground: Annotated[
        str,
        Meta(description="picture of the ground with a world file, or a GeoTIFF, in degrees; empty: none"),
    ] = ""

    def __post_init__(self) -> None:
        for origin in self.origins:
            if not re.fullmatch(r"https?://[^/\s]+", origin):
                raise ValueError(
                    f"{origin[:40]!r} is no origin; give https://HOST or https://HOST:PORT, no path"
                )


class AlignSection(Section, frozen=True):
    """Order in time."""

    hold_s: Annotated[
        float, Meta(ge=0.0, le=2.0, description="longest wait for a slower source, live only")
    ] = 0.3


class ScreeningSection(Section, frozen=True):
    """Each raw channel watched alone."""

    on: Annotated[bool, Meta(description="doubts go into the record and change no verdict")] = True


class FilterSection(Section, frozen=True):
    """The estimator; names and defaults are those of ``filters.models.settings.Settings``."""

    jerk_psd: Annotated[
        float, Meta(ge=1e-3, le=1e5, description="white jerk to begin with: 3 m/s³ held for a second")
    ] = 10.0
    gust_psd: Annotated[
        float, Meta(ge=1e-6, le=1e3, description="white acceleration to begin with: light turbulence")
    ] = 0.3
    ins_bias_sigma_m: Annotated[
        float, Meta(ge=1e-3, le=1e4, description="slow INS position error: a single-frequency receiver")
    ] = 2.5
    ins_bias_tau_s: Annotated[float, Meta(ge=0.1, le=1e6, description="how long it stays alike")] = 90.0
    lag_scans: Annotated[
        float, Meta(ge=1.0, le=100.0, description="of the slowest sensor, that may still change a decision")
    ] = 5.0
    shortest_lag_s: Annotated[
        float, Meta(ge=0.25, le=60.0, description="decisions wait at least so long for later rows")
    ] = 1.0
    longest_lag_s: Annotated[
        float, Meta(ge=0.25, le=600.0, description="… and no longer than this; not below shortest_lag_s")
    ] = 30.0
    lateness_s: Annotated[
        float, Meta(ge=0.0, le=60.0, description="a row may come so much later than the newest one")
    ] = 1.0

    def __post_init__(self) -> None:
        if self.longest_lag_s < self.shortest_lag_s:
            raise ValueError(f"longest_lag_s must not be below shortest_lag_s, {self.shortest_lag_s:g}")


class Station(Section, frozen=True):
    """The whole file."""

    range: RangeSection = RangeSection()
    vehicle: VehicleSection = VehicleSection()
    sensor: list[SensorSection] = msgspec.field(default_factory=list)
    ins: InsSection = InsSection()
    mavlink: MavlinkSection = MavlinkSection()
    bus: BusSection = BusSection()
    view: ViewSection = ViewSection()
    align: AlignSection = AlignSection()
    screening: ScreeningSection = ScreeningSection()
    filter: FilterSection = FilterSection()

    @property
    def sources(self) -> list[str]:
        """Who measures, in the estimator's order: the INS, then the instruments."""
        return ["ins", *(sensor.name for sensor in self.sensor)]


def load(path: Path | None, overrides: Sequence[str] = ()) -> Station:
    """The station in ``path`` (defaults for None) with ``KEY=VALUE`` overrides such as ``ins.height_m=2``.

    Raises ``InputError``.
    """
    given = station_text.read(path, overrides)
    try:
        station = msgspec.convert(given.tree, Station)
    except msgspec.ValidationError as error:
        raise InputError(station_text.explain(given, Station, str(error))) from None
    names = [sensor.name for sensor in station.sensor]
    for name in names:
        if name in ("ins", "air") or names.count(name) > 1:
            last = len(names) - 1 - names[::-1].index(name)
            where = station_text.where(given, ["sensor", last, "name"])
            raise InputError(f"{where}: sensor name {name!r} is taken; give each its own")
    return station


def resolved(path: Path | None, overrides: Sequence[str] = ()) -> list[Setting]:
    """Every setting that ``load`` gives, with where it comes from. Raises ``InputError``."""
    station = load(path, overrides)
    usual = {s.name: KIND_SIGMA[s.kind] for s in station.sensor}
    found = station_text.settings(station_text.read(path, overrides), msgspec.to_builtins(station))
    out = []
    for setting in found:
        section, *rest = setting.name.split(".")
        if section == "sensor" and rest[1:2] == ["sigma"] and setting.value is None:
            setting = setting._replace(value=getattr(usual[rest[0]], rest[2]), source="default of its kind")
        out.append(setting)
    return out


def dump(station: Station) -> str:
    """The resolved station as TOML, every default written out."""

    def prune(node: Any) -> Any:
        if isinstance(node, dict):
            return {key: prune(value) for key, value in node.items() if value is not None}
        return [prune(item) for item in node] if isinstance(node, list) else node

    return tomli_w.dumps(prune(msgspec.to_builtins(station)))
