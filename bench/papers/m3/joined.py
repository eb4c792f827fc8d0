"""Screening joined with the trajectory filter, which is what the screening paper asks for at its end.

The paper's record, flown: the range with its outliers comes from a radar that also measures azimuth and
elevation, without outliers. The filter has no other sensor. ``either`` joins it with our screening,
``five_point`` with the one that watches every channel in the main job.
"""

from typing import NamedTuple

import numpy as np

from bench.papers.m3 import screening
from filters import methods
from filters.models.rows import AZIMUTH, ELEVATION, ISOLATED, PATCH, RANGE, ROW, Sensor
from filters.screening.channels import ChannelScreening
from filters.screening.screening import OUTLIER
from filters.simulation import simulate

ANGLE_RAD = np.radians(0.05)


class Joined(NamedTuple):
    """(false alarms, share of the isolated found, share in runs found) by whom."""

    screening: tuple[float, float, float]
    trajectory: tuple[float, float, float]
    either: tuple[float, float, float]
    five_point: tuple[float, float, float]


def joined(
    seed: int,
    size: tuple[float, float] = screening.SIZE,
    points: int = screening.POINTS,
    *,
    regular: bool = False,
) -> Joined:
    """The first ``points`` of a record through both; a value counts as found when it is not let through."""
    made = screening.RadarRecord(
        *(column[:points] for column in screening.record(seed, size, regular=regular))
    )
    sensor, rows, label = _radar(made, np.random.default_rng(seed))
    one = methods.make("default", [sensor])
    steps = [one.step(part) for part in np.array_split(rows, len(rows) // 300)]
    verdicts = np.concatenate([step.verdicts for step in (*steps, one.finish())])
    verdicts = verdicts[verdicts["final"]]
    refused = np.zeros(len(rows), bool)
    refused[verdicts["id"]] = np.isin(verdicts["verdict"], (ISOLATED, PATCH))
    own = rows["channel"] == RANGE
    refused, watched = refused[own], ChannelScreening([sensor]).doubts(rows)[own]
    doubted = screening.screened(made, screening.OURS).flag[np.isfinite(made.values)] == OUTLIER
    judged = doubted, refused, doubted | refused, watched | refused
    return Joined(*(_score(found, label) for found in judged))


def _radar(made: screening.RadarRecord, rng: np.random.Generator) -> tuple[Sensor, np.ndarray, np.ndarray]:
    """The radar, (n,) ROW of what it says, and the (k,) labels of the ranges that came."""
    sigma = np.full(13, np.nan)
    sigma[[RANGE, AZIMUTH, ELEVATION]] = made.sigma.mean(), ANGLE_RAD, ANGLE_RAD
    east, north = (column[: len(made.values)] for column in screening.flight_path())
    azimuth = np.arctan2(east, north) + rng.normal(0.0, ANGLE_RAD, len(east))
    elevation = np.arctan2(screening.HEIGHT_M, np.hypot(east, north))
    elevation = elevation + rng.normal(0.0, ANGLE_RAD, len(east))
    there = np.isfinite(made.values)
    values = np.column_stack([made.values, azimuth, elevation])[there]
    rows = np.zeros(values.size, ROW)
    rows["id"], rows["value"] = np.arange(values.size), values.ravel()
    rows["channel"] = np.tile([RANGE, AZIMUTH, ELEVATION], len(values))
    t_ns = simulate.T0_NS + np.round(made.t_s[there] * 1e9).astype(np.int64)
    rows["t_ns"] = np.repeat(t_ns, 3)
    return Sensor("radar", "radar", sigma), rows, made.label[there]


def _score(found: np.ndarray, label: np.ndarray) -> tuple[float, float, float]:
    share = (float(found[label == kind].mean()) for kind in (simulate.ISOLATED, simulate.PATCH))
    return float(np.count_nonzero(found & (label == simulate.NONE))), *share
