"""What is known of the outliers in a part of the picture, by sensor and channel."""

from collections import defaultdict
from collections.abc import Callable
from typing import NamedTuple

import numpy as np

from gcs.contract.messages import Verdict
from web.memory.claims import ACCEPTED, Claim
from web.memory.flight import SeenFlight
from web.memory.residuals import off, sigmas_off

Inside = Callable[[np.ndarray], np.ndarray]  # (n, 3) station ENU → (n,) bool


class Refused(NamedTuple):
    """One channel's refused values in the box."""

    sensor: str
    channel: str
    values: int
    share: float  # of the sensor's measurements in the box
    sigmas: float  # mean of the residuals in σ, NaN: none has a prediction
    off: float  # mean of value less prediction, in the channel's unit


class Boxed(NamedTuple):
    """What lies in the box."""

    outliers: list[Claim]
    measured: int  # measurements with a place in it, outliers too
    channels: list[Refused]  # the most frequent first


def boxed(flight: SeenFlight, inside: Inside) -> Boxed:
    """Outliers and measurements whose claimed place is ``inside``, those still open to revision too."""
    placed = [claim for claim in flight.claims.pending() if claim.position]
    open_ = [claim for claim, there in zip(placed, _inside(placed, inside), strict=True) if there]
    settled = [*flight.outliers]
    outliers = [claim for claim, there in zip(settled, _inside(settled, inside), strict=True) if there]
    outliers += [claim for claim in open_ if claim.kind != ACCEPTED]
    measured: dict[str, int] = defaultdict(int)
    for claim in open_:
        measured[claim.sensor] += 1
    for sensor in flight.residuals.sensors():
        rows = flight.residuals.all_raw(sensor)
        measured[sensor] += int(rows["stands_for"][inside(rows["place_m"].astype(float))].sum())
    values: dict[tuple[str, str], list[Verdict]] = defaultdict(list)
    for claim in outliers:
        for verdict in claim.refused:
            values[claim.sensor, verdict.channel].append(verdict)
    channels = [
        Refused(
            *key,
            len(refused),
            min(1.0, len(refused) / max(measured[key[0]], 1)),
            _mean([sigmas_off(verdict) for verdict in refused]),
            _mean([off(verdict) for verdict in refused]),
        )
        for key, refused in values.items()
    ]
    return Boxed(outliers, sum(measured.values()), sorted(channels, key=lambda one: -one.values))


def _inside(claims: list[Claim], inside: Inside) -> np.ndarray:
    return inside(np.array([claim.position for claim in claims], float).reshape(-1, 3))


def _mean(values: list[float]) -> float:
    known = np.array(values)[np.isfinite(values)]
    return float(known.mean()) if len(known) else float("nan")
