"""What goes into an estimator and what comes out, as numpy structured arrays, and the sensors' models.

One row is one channel value. Angles in radians, lengths in metres, time in int64 ns UTC; an instrument's
range, azimuth and elevation in its own ENU frame, everything else in station ENU.
"""

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

CHANNELS = ("range", "azimuth", "elevation", "range_rate", "e", "n", "u", "ve", "vn", "vu", "ae", "an", "au")
RANGE, AZIMUTH, ELEVATION, RANGE_RATE, E, N, U, VE, VN, VU, AE, AN, AU = range(len(CHANNELS))
VERDICTS = ("used", "deweighted", "isolated", "patch", "invalid", "duplicate", "late")
USED, DEWEIGHTED, ISOLATED, PATCH, INVALID, DUPLICATE, LATE = range(len(VERDICTS))

ROW = np.dtype(
    [
        ("id", "i8"),  # counts every value that came in; the record knows where each came from
        ("t_ns", "i8"),  # valid time, the sensor's known latency already taken off
        ("sensor", "i2"),  # index into the estimator's sensors
        ("channel", "i1"),  # index into CHANNELS
        ("value", "f8"),
        ("sigma", "f8"),  # 1-sigma noise of this value, units of the value; 0: the sensor's own
    ]
)
TRACK = np.dtype(
    [
        ("t_ns", "i8"),
        ("x", "f8", (9,)),  # position m, velocity m/s, acceleration m/s², station ENU
        ("P", "f8", (9, 9)),  # its covariance
        ("quality", "i2"),  # 0 … 100; −1 failed
        ("reset_counter", "i4"),
        ("fixed_ns", "i8"),  # newest row used that says where it is or how fast it moves; 0: not told
        (
            "protection_h_m",
            "f8",
        ),  # holds although any one sensor lies; inf: nobody else is there, NaN: not told
        ("protection_v_m", "f8"),
        ("ambiguous", "?"),  # two hypotheses are nearly as likely, or one sensor alone says so
    ]
)
VERDICT = np.dtype(
    [
        ("id", "i8"),  # of the row
        ("predicted", "f8"),  # units of the row's value
        ("sigma", "f8"),  # 1-sigma of the innovation
        ("weight", "f8"),  # 0 … 1
        ("verdict", "i1"),  # index into VERDICTS
        ("reason", "i1"),  # index into outlier.REASONS
        ("final", "?"),
    ]
)
SEPARATION = np.dtype(
    [
        ("t_ns", "i8"),
        ("sensor", "i2"),  # index into the estimator's sensors: the one that is left out
        ("horizontal_m", "f8"),  # from the newest state to the one without this sensor
        ("vertical_m", "f8"),
        ("sigma_h_m", "f8"),  # 1 sigma of the one without it, in the horizontal direction known least
        ("sigma_v_m", "f8"),
    ]
)


class Sensor(NamedTuple):
    """One source as the estimator sees it."""

    name: str
    kind: str  # ins | theodolite | radar
    sigma: np.ndarray  # (13,) 1-sigma noise per channel of CHANNELS, NaN where the sensor has none
    offset_m: np.ndarray = np.zeros(3)  # instrument's position, station ENU
    rotation: np.ndarray = np.eye(3)  # station ENU → sensor ENU: p_sensor = rotation @ (p − offset_m)
    refraction: str = "none"  # none | optical | radar
    estimate: tuple[str, ...] = ()  # bias, clock: systematic errors to estimate
    zero_sigma: tuple[float, float, float] | None = None  # their priors: range m, azimuth, elevation rad
    clock_sigma_s: float | None = None  # None: the kind's usual prior
    slow: float = 1.0  # 1-sigma of an instrument's slow errors, in those of its noise


class Step(NamedTuple):
    """What one call of an estimator brings."""

    track: np.ndarray  # (k,) TRACK, one per new epoch, causal
    smoothed: np.ndarray  # (m,) TRACK, decisions final
    verdicts: np.ndarray  # (v,) VERDICT, new or changed
    separation: np.ndarray = np.zeros(0, SEPARATION)  # (s,) some times a second, of states in ``track``


def joined(parts: Sequence[np.ndarray], kind: np.dtype) -> np.ndarray:
    """All records of ``kind`` in ``parts``, of which there may be none; one part alone is not copied.

    numpy compares the fields of records that it concatenates, which takes longer than to copy a few.
    """
    full = [part for part in parts if len(part)]
    if len(full) < 2:
        return full[0] if full else np.zeros(0, kind)
    return np.concatenate(full)


def rehearsal(sensors: Sequence[Sensor]) -> np.ndarray:
    """(n,) ROW to warm an estimator up with: every channel of every sensor six times, 0.3 s apart."""
    said = [(s, c) for s, sensor in enumerate(sensors) for c in np.flatnonzero(sensor.sigma > 0)]
    rows = np.zeros(6 * len(said), ROW)
    for k in range(len(rows)):
        rows[k] = (k, k // len(said) * 300_000_000, *said[k % len(said)], 1.0, 0.0)
    return rows
