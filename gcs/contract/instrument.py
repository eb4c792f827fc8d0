"""One instrument as the station file describes it: ``[[sensor]]``, and the types that all sections share."""

from typing import Annotated, Literal

import msgspec
from msgspec import Meta

from gcs.contract import limits

Name = Annotated[str, Meta(pattern=r"^[a-z0-9]([a-z0-9-]*[a-z0-9])?$")]
Latitude = Annotated[float, Meta(ge=-90.0, le=90.0)]
Longitude = Annotated[float, Meta(ge=-180.0, le=180.0)]
Height = Annotated[float, Meta(ge=-1_000.0, le=100_000.0)]
Sigma = Annotated[float, Meta(ge=limits.SIGMA["range_m"][0], le=limits.SIGMA["range_m"][1])]
AngleSigma = Annotated[float, Meta(ge=limits.SIGMA["azimuth_deg"][0], le=limits.SIGMA["azimuth_deg"][1])]
Latency = Annotated[float, Meta(ge=-10.0, le=10.0)]
Angle = Annotated[float, Meta(ge=-360.0, le=360.0)]
Tilt = Annotated[float, Meta(ge=-45.0, le=45.0)]


class Section(msgspec.Struct, forbid_unknown_fields=True, kw_only=True, frozen=True):
    """A table of the station file: immutable, and an unknown name in it is refused."""


class Position(Section, frozen=True):
    """A place, WGS84."""

    lat_deg: Annotated[Latitude, Meta(description="WGS84")]
    lon_deg: Annotated[Longitude, Meta(description="WGS84")]
    alt_m: Annotated[Height, Meta(description="above the ellipsoid")]


class SensorSigma(Section, frozen=True):
    """Measurement noise, 1 sigma. Left out: what is usual for the kind (``KIND_SIGMA``)."""

    range_m: Annotated[Sigma | None, Meta(description="1 m for a theodolite, 5 m for a radar")] = None
    azimuth_deg: Annotated[AngleSigma | None, Meta(description="0.003° theodolite, 0.05° radar")] = None
    elevation_deg: Annotated[AngleSigma | None, Meta(description="0.003° theodolite, 0.05° radar")] = None
    range_rate_mps: Annotated[
        Sigma | None, Meta(description="0.5 m/s for a radar; theodolites have none")
    ] = None


class SensorPrior(Section, frozen=True):
    """How large a systematic error may be before it is known, 1 sigma."""

    range_m: Annotated[Sigma, Meta(description="a wrong prism constant or an uncalibrated delay")] = 5.0
    azimuth_deg: Annotated[AngleSigma, Meta(description="orientation to a mark some hundred metres away")] = (
        0.05
    )
    elevation_deg: Annotated[AngleSigma, Meta(description="levelling")] = 0.05
    clock_s: Annotated[float, Meta(ge=1e-6, le=10.0, description="a PC clock on NTP over a poor link")] = 0.1
    slow: Annotated[
        float, Meta(ge=0.0, le=10.0, description="errors that last for seconds, as multiples of `sigma`")
    ] = 1.0


class ChannelLatency(Section, frozen=True):
    """Known latency of each channel, for an instrument whose parts are read out at different times."""

    range_m: Annotated[Latency, Meta(description="of the range: distance meters integrate")] = 0.0
    azimuth_deg: Annotated[Latency, Meta(description="of the azimuth encoder")] = 0.0
    elevation_deg: Annotated[Latency, Meta(description="of the elevation encoder")] = 0.0
    range_rate_mps: Annotated[Latency, Meta(description="of the Doppler")] = 0.0


class MountTilt(Section, frozen=True):
    """How far a mount's vertical axis leans."""

    east: Annotated[
        Tilt, Meta(description="the axis leans so far east: targets in the east read higher by as much")
    ] = 0.0
    north: Annotated[
        Tilt, Meta(description="the axis leans so far north: targets in the north read higher by as much")
    ] = 0.0


KIND_SIGMA = {
    "theodolite": SensorSigma(range_m=1.0, azimuth_deg=0.003, elevation_deg=0.003),
    "radar": SensorSigma(range_m=5.0, azimuth_deg=0.05, elevation_deg=0.05, range_rate_mps=0.5),
}


class SensorSection(Section, frozen=True):
    """One instrument on the ground; one ``[[sensor]]`` each."""

    name: Annotated[Name, Meta(description="of its feed and its keys; ins and air are taken")]
    kind: Annotated[Literal["theodolite", "radar"], Meta(description="what it measures, and how well")]
    position: Annotated[Position, Meta(description="of its axes' crossing")]
    sigma: Annotated[SensorSigma, Meta(description="noise")] = SensorSigma()
    latency_s: Annotated[
        Latency | ChannelLatency,
        Meta(description="the known part: valid time = stamp − latency; one number, or a table per channel"),
    ] = 0.0
    tilt_deg: Annotated[MountTilt, Meta(description="of a mount that is not level")] = MountTilt()
    orientation_deg: Annotated[
        Angle, Meta(description="true azimuth at which it reads zero, so true azimuth = reading + this")
    ] = 0.0
    estimate: Annotated[
        list[Literal["bias", "clock"]], Meta(description="systematic errors to estimate while running")
    ] = []
    prior: Annotated[SensorPrior, Meta(description="of the systematic errors")] = SensorPrior()
    refraction: Annotated[
        Literal["none", "optical", "radar"], Meta(description="how the air bends its line of sight")
    ] = "none"

    @property
    def sigma_by_channel(self) -> dict[str, float]:
        """Noise per channel in input units, the kind's default where the file is silent."""
        usual = KIND_SIGMA[self.kind]
        named = {f: getattr(self.sigma, f) or getattr(usual, f) for f in SensorSigma.__struct_fields__}
        return {channel_of(f): s for f, s in named.items() if s is not None}

    @property
    def latency_by_channel(self) -> dict[str, float]:
        """The known latency of each channel in s."""
        stated = self.latency_s
        if isinstance(stated, ChannelLatency):
            return {channel_of(f): getattr(stated, f) for f in ChannelLatency.__struct_fields__}
        return {channel_of(f): stated for f in ChannelLatency.__struct_fields__}


def channel_of(field: str) -> str:
    """The channel that a field with a unit is about: ``range_rate`` of ``range_rate_mps``."""
    return field.rsplit("_", 1)[0]
