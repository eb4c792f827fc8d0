"""Real instruments: boats seen by a ferry's radar and lidar, with satellite positions of the boats as truth.

Association is granted: of each scan the detection nearest to one boat's true place, within NEAR_M, is that
boat's. The ferry moves, so detections are put into the common frame, and from there into range and azimuth
about the ferry's mean place. Nobody sees the height. An estimator that can be told a height beforehand is;
to any other the instruments say elevation 0 with a sigma that stands for HEIGHT_SIGMA_M.
"""

import gzip
import json
from pathlib import Path
from typing import NamedTuple

import numpy as np

from bench.trials import flights, scene
from bench.trials.flights import Flight
from bench.trials.world import AZIMUTH, ELEVATION, RANGE, ROW, Sensor

SCENARIOS, BOATS = (3, 4, 5), (1, 2)
NEAR_M = 30.0
HEIGHT_M, HEIGHT_SIGMA_M = 0.0, 3.0
STEADY_S = 0.5  # half of the window for the boat's velocity


class Eye(NamedTuple):
    """An instrument of the ferry: its number in the files, 1-sigma of range m and azimuth rad.

    The sigmas are half of the 95th percentile against the truth: a boat is not a point.
    """

    number: int
    range_m: float
    azimuth_rad: float


EYES = {"radar": Eye(2, 6.0, np.radians(4.0)), "lidar": Eye(1, 3.0, np.radians(2.5))}


def load(
    data: Path, scenario: int, boat: int, names=tuple(EYES), flat: bool = False, estimate=()
) -> scene.Scene:
    """One boat through the instruments ``names``; ``flat``: without the elevation that nobody measured."""
    said, truth = (_read(data, scenario, what) for what in ("detections", "groundTruth"))
    flight = _boat(f"scenario{scenario}-{boat}", truth, boat)
    centre = np.mean([scan["ownshipPosition"] for scan in said], axis=0)[::-1]
    sensors, parts = [], []
    for k, name in enumerate(names):
        seen = _seen(said, EYES[name].number, flight, centre)
        far_m = float(np.median(seen[:, 1]))
        sensors.append(_sensor(name, centre, HEIGHT_SIGMA_M / far_m, flat, estimate))
        parts.append(_rows(k, seen, flat))
    return scene.recorded(flight, sensors, parts)


def _read(data: Path, scenario: int, what: str) -> list:
    file = data / "autoferry" / f"scenario{scenario}_{what}.json.gz"
    if not file.is_file():
        raise FileNotFoundError(f"{file}: no such file; is --data the folder with the flights?")
    return json.loads(gzip.decompress(file.read_bytes()))


def _boat(name: str, truth: list, boat: int) -> Flight:
    """A boat's true way; files give north, east, down."""
    places = {fix["time"]: fix["position"] for both in truth for fix in both if fix["targetID"] == boat}
    t_s = np.array(sorted(places))
    north, east = np.array([places[t][:2] for t in t_s]).T
    p = np.column_stack([east, north, np.full(len(t_s), HEIGHT_M)])
    return flights.from_places(name, t_s, p, STEADY_S)


def _seen(said: list, number: int, flight: Flight, centre: np.ndarray) -> np.ndarray:
    """(k, 3) UTC s, range m, azimuth rad about ``centre`` (2,) east north of one boat's detections."""
    out = []
    end_s = flight.truth.t_s[-1]
    for scan in said:
        since_s = scan["time"] - flight.t0_ns * 1e-9
        if scan["sensorID"] != number or not len(scan["measurement"]) or not 0.0 <= since_s <= end_s:
            continue
        north, east = np.array(scan["measurement"], float) + np.array(scan["ownshipPosition"])[:, None]
        there = flights.state_at(flight.truth, np.array([since_s]))[0][0, :2]
        off_m = np.hypot(east - there[0], north - there[1])
        k = np.argmin(off_m)
        if off_m[k] <= NEAR_M:
            e, n = east[k] - centre[0], north[k] - centre[1]
            out.append((scan["time"], np.hypot(e, n), np.arctan2(e, n) % (2 * np.pi)))
    return np.array(out).reshape(-1, 3)


def _sensor(name: str, centre: np.ndarray, elevation_rad: float, flat: bool, estimate) -> Sensor:
    sigma = np.full(13, np.nan)
    sigma[RANGE], sigma[AZIMUTH] = EYES[name].range_m, EYES[name].azimuth_rad
    if not flat:
        sigma[ELEVATION] = elevation_rad
    return Sensor(name, "radar", sigma, np.array([*centre, HEIGHT_M]), estimate=tuple(estimate))


def _rows(sensor: int, seen: np.ndarray, flat: bool) -> np.ndarray:
    """ROW of (k, 3) detections, with elevation 0 unless ``flat``."""
    values = np.column_stack([seen[:, 1:], np.zeros(len(seen))])[:, : 2 if flat else 3]
    rows = np.zeros(values.shape, ROW)
    rows["t_ns"] = np.round(seen[:, :1] * 1e9).astype(np.int64)
    rows["sensor"], rows["channel"], rows["value"] = sensor, np.arange(values.shape[1]), values
    return rows.ravel()
