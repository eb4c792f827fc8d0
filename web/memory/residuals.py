"""Every value's residual in sigmas, by sensor and channel, and what the sensors say of height and speed."""

import math
from typing import NamedTuple

import numpy as np

from gcs.contract.messages import Verdict
from web.memory.claims import KIND_OF, KINDS, Claim
from web.memory.rows import GrowingRows

MOST = 60_000  # values of one channel: 50 minutes at 20 Hz, then the past is thinned
RESIDUAL = np.dtype(  # off: in the channel's unit; kind: index into KINDS
    [("t_ns", "i8"), ("sigmas", "f4"), ("off", "f4"), ("kind", "u1")]
)
RAW = np.dtype(  # NaN: does not say
    [("t_ns", "i8"), ("place_m", "f4", (3,)), ("speed_mps", "f4"), ("kind", "u1"), ("stands_for", "i4")]
)
NOWHERE = (math.nan, math.nan, math.nan)
SPEED = ("ve", "vn", "vu")


def sigmas_off(verdict: Verdict) -> float:
    """How far a value is from its prediction, in sigmas of that difference; NaN where there is none."""
    return off(verdict) / verdict.sigma if verdict.sigma else math.nan


def off(verdict: Verdict) -> float:
    """Value less prediction, in the channel's unit, the short way round in azimuth; NaN without one."""
    if verdict.value is None or verdict.predicted is None:
        return math.nan
    apart = verdict.value - verdict.predicted
    return (apart + 180.0) % 360.0 - 180.0 if verdict.channel == "azimuth" else apart


def row(claim: Claim, verdict: Verdict) -> tuple:
    """RESIDUAL of one channel of a claim."""
    return claim.t_ns, sigmas_off(verdict), off(verdict), KIND_OF[verdict.verdict]


class Residuals:
    """Settled claims as columns, for the plots."""

    def __init__(self):
        self._channels: dict[str, dict[str, GrowingRows]] = {}
        self._raw: dict[str, GrowingRows] = {}

    def add(self, claim: Claim) -> None:
        columns = self._channels.setdefault(claim.sensor, {})
        for channel, verdict in claim.verdicts.items():
            rows = columns.get(channel) or columns.setdefault(channel, GrowingRows(RESIDUAL, MOST))
            rows.add(row(claim, verdict))
        raw = self._raw.get(claim.sensor) or self._raw.setdefault(claim.sensor, GrowingRows(RAW, MOST))
        raw.add((claim.t_ns, claim.position or NOWHERE, _speed(claim), KINDS.index(claim.kind), 1))

    def channels(self, sensor: str) -> list[str]:
        return list(self._channels.get(sensor, {}))

    def sensors(self) -> list[str]:
        return list(self._channels)

    def of(self, sensor: str, channel: str, from_ns: int, to_ns: int) -> np.ndarray:
        """(n,) RESIDUAL of that time."""
        return self._channels[sensor][channel].between(from_ns, to_ns)

    def raw(self, sensor: str, from_ns: int, to_ns: int) -> np.ndarray:
        """(n,) RAW of that time."""
        return self._raw[sensor].between(from_ns, to_ns)

    def all_raw(self, sensor: str) -> np.ndarray:
        """(n,) RAW of the whole flight."""
        return self._raw[sensor].view

    def clear(self) -> None:
        self._channels.clear()
        self._raw.clear()


class Statement(NamedTuple):
    """What one sensor said nearest to an instant."""

    sensor: str
    apart_s: float
    channel: str  # the one farthest off
    sigmas: float
    kind: str


def others_then(residuals: Residuals, pending: list[Claim], claim: Claim, within_ns: int) -> list[Statement]:
    """What every other sensor said nearest to the claim's instant: of its channels the one farthest off."""
    found = []
    recent: dict[str, Claim] = {}
    for other in pending:
        best = recent.get(other.sensor)
        if best is None or abs(other.t_ns - claim.t_ns) < abs(best.t_ns - claim.t_ns):
            recent[other.sensor] = other
    for sensor in {*residuals.sensors(), *recent} - {claim.sensor}:
        said = [
            (abs(int(one["t_ns"]) - claim.t_ns), channel, float(one["sigmas"]), KINDS[one["kind"]])
            for channel in residuals.channels(sensor)
            for one in residuals.of(sensor, channel, claim.t_ns - within_ns, claim.t_ns + within_ns)
        ]
        if sensor in recent and abs(recent[sensor].t_ns - claim.t_ns) <= within_ns:
            apart = abs(recent[sensor].t_ns - claim.t_ns)
            for channel, verdict in recent[sensor].verdicts.items():
                said.append((apart, channel, sigmas_off(verdict), KINDS[KIND_OF[verdict.verdict]]))
        if said:
            nearest = min(apart for apart, *_ in said)
            worst = max((s for s in said if s[0] == nearest), key=lambda s: np.nan_to_num(abs(s[2])))
            found.append(Statement(sensor, worst[0] / 1e9, *worst[1:]))
    return sorted(found)


def _speed(claim: Claim) -> float:
    parts = [claim.verdicts[name].value for name in SPEED if name in claim.verdicts]
    whole = len(parts) == len(SPEED) and None not in parts
    return math.hypot(*parts) if whole else math.nan  # type: ignore[arg-type]  # whole: no None
