"""A run folder as it is read again: tracks, values with their verdicts, summary, station.

What is missing or damaged is a remark and no error, as long as there is a track: the folder of a run that was
killed has no summary, and its last line may be torn.
"""

import json
import re
from collections import Counter
from pathlib import Path
from typing import NamedTuple

import numpy as np

from gcs.contract import config
from gcs.contract.config import Station
from gcs.contract.frames import Frame, origin_frame
from gcs.contract.messages import CHANNELS, VERDICTS, InputError
from gcs.report.basis import csvfile

STATE = (
    "t_ns", "lat_deg", "lon_deg", "alt_m", "e_m", "n_m", "u_m", "ve_mps", "vn_mps", "vu_mps", "ae_mps2",
    "an_mps2", "au_mps2", "sigma_e_m", "sigma_n_m", "sigma_u_m", "quality", "reset_counter",
    "protection_h_m", "protection_v_m", "ambiguous",
)  # fmt: skip
VALUE = ("t_ns", "sensor", "channel", "value", "predicted", "sigma", "weight", "verdict", "reason")
ERROR = ("t_ns", "sensor", "error", "value", "sigma", "prior_sigma")
APART = ("t_ns", "sensor", "horizontal_m", "vertical_m", "sigma_h_m", "sigma_v_m")
WIND = ("t_ns", "speed_mps", "from_deg", "sigma_mps", "known", "own_speed_mps", "own_from_deg")
EVENT = ("t_ns", "level", "text")
NO_TIME = np.iinfo(np.int64).min  # of a line whose time cannot be read
LINE = len(CHANNELS)  # the channel of a line that was no measurement
ACCEPTED, REFUSED = ("used", "deweighted"), ("isolated", "patch")
REASONS_KEPT = 2_000  # different reasons that are counted; damaged lines have one each
SPREAD = re.compile(r" \(\d+\.\d sigma\)")
VALUES = np.dtype(
    [
        ("t_ns", "i8"), ("sensor", "i2"), ("channel", "i2"), ("value", "f8"), ("predicted", "f8"),
        ("sigma", "f8"), ("weight", "f4"), ("verdict", "i1"),
    ]
)  # fmt: skip
SEPARATIONS = np.dtype([("t_ns", "i8"), ("sensor", "i2"), *((name, "f8") for name in APART[2:])])


class ErrorRow(NamedTuple):
    """One systematic error as it was estimated at one instant; angles in degrees."""

    t_ns: int
    sensor: str
    error: str
    value: float
    sigma: float
    prior_sigma: float


class Run(NamedTuple):
    """One run, read again."""

    folder: Path
    track: np.ndarray  # (n,) by STATE, what was known then
    smoothed: np.ndarray  # (m,) the same, the best estimate
    values: np.ndarray  # (v,) VALUES, in order of arrival
    by_sensor: dict[str, np.ndarray]  # those with a time, in order of time
    sensors: list[str]  # by VALUES' sensor: the INS, then as in the station file
    reasons: Counter[tuple[str, str, str]]  # how many by sensor, verdict and reason, sigmas left out
    errors: list[ErrorRow]
    apart: np.ndarray  # (a,) SEPARATIONS: how far the live state would move without a sensor
    wind: np.ndarray | None  # (w,) by WIND
    events: list[tuple[int, str, str]]  # t_ns, level, text
    summary: dict  # empty where the run did not end
    station: Station
    frame: Frame
    remarks: list[str]  # what is missing or damaged

    @property
    def heard(self) -> list[str]:
        """The sensors of which there is a value."""
        return [self.sensors[k] for k in np.unique(self.values["sensor"]).tolist()]

    @property
    def start_ns(self) -> int:
        return int(self.track["t_ns"][0])

    @property
    def end_ns(self) -> int:
        return int(self.track["t_ns"][-1])

    def seconds(self, t_ns: np.ndarray) -> np.ndarray:
        """(n,) s since the first state, of times (n,)."""
        return (t_ns - self.start_ns) * 1e-9

    def of(self, sensor: str) -> np.ndarray:
        """(k,) VALUES of one sensor that have a time, in order of time."""
        return self.by_sensor[sensor]


def load(folder: Path) -> Run:
    """The run in ``folder``. Raises InputError, one line, where there is no track to report on."""
    if not folder.is_dir():
        raise InputError(f"{folder}: no such folder; name the run folder of a replay or a live run")
    remarks: list[str] = []
    track, smoothed = (_track(folder / name, remarks) for name in ("track.csv", "smoothed.csv"))
    if not len(track):
        raise InputError(f"{folder}/track.csv: not one state; verdicts.csv says what became of the values")
    station = config.load(folder / "station.toml")
    sensors = station.sources
    values, reasons = _values(folder / "verdicts.csv", sensors, remarks)
    by_sensor = {name: _in_order(values[values["sensor"] == k]) for k, name in enumerate(sensors)}
    return Run(
        folder, track, smoothed if len(smoothed) else track, values, by_sensor, sensors, reasons,
        _errors(folder / "errors.csv"), _apart(folder / "separation.csv", sensors, remarks),
        csvfile.optional(folder / "wind.csv", WIND), _events(folder / "events.csv", remarks),
        _summary(folder / "summary.json", remarks), station, _frame(station, track[len(track) // 2]), remarks,
    )  # fmt: skip


def sigmas_off(values: np.ndarray) -> np.ndarray:
    """(n,) value minus prediction in its own 1-sigma, the short way round in azimuth; NaN without one."""
    off = values["value"] - values["predicted"]
    around = values["channel"] == CHANNELS.index("azimuth")
    with np.errstate(invalid="ignore", divide="ignore"):
        off = np.where(around, (off + 180.0) % 360.0 - 180.0, off)
        return np.where(values["sigma"] > 0.0, off / values["sigma"], np.nan)


def is_one_of(values: np.ndarray, names: tuple[str, ...]) -> np.ndarray:
    """(n,) bool: whose verdict is one of ``names``."""
    return np.isin(values["verdict"], [VERDICTS.index(name) for name in names])


def _track(path: Path, remarks: list[str]) -> np.ndarray:
    rows, damaged = csvfile.numbers(path, STATE)
    if damaged:
        remarks.append(f"{path.name}: {damaged} lines cannot be read and are left out")
    return rows[np.argsort(rows["t_ns"], kind="stable")]


def _values(path: Path, sensors: list[str], remarks: list[str]) -> tuple[np.ndarray, Counter]:
    reasons: Counter[tuple[str, str, str]] = Counter()
    parts, damaged = [np.empty(0, VALUES)], 0
    codes = {name: k for k, name in enumerate(CHANNELS)} | {"": LINE}
    judged, places = ({name: k for k, name in enumerate(names)} for names in (VERDICTS, sensors))
    for (t, sensor, channel, *figures, verdict, reason), bad in csvfile.texts(path, VALUE):
        rows = np.empty(len(t), VALUES)
        try:
            rows["t_ns"] = [int(x) if x else NO_TIME for x in t]
            rows["sensor"] = [places[x] for x in sensor]
            rows["channel"], rows["verdict"] = [codes[x] for x in channel], [judged[x] for x in verdict]
            for name, column in zip(("value", "predicted", "sigma", "weight"), figures, strict=True):
                rows[name] = [float(x) if x else np.nan for x in column]
        except (ValueError, KeyError) as error:
            raise InputError(f"{path}: {error} is no value of its column; the file was changed") from None
        parts.append(rows)
        damaged += bad
        for key in zip(sensor, verdict, reason, strict=True):
            if key[2]:
                said = (*key[:2], SPREAD.sub("", key[2]))
                full = len(reasons) >= REASONS_KEPT and said not in reasons
                reasons[(*key[:2], "others") if full else said] += 1
    if damaged:
        remarks.append(f"{path.name}: {damaged} lines cannot be read and are left out")
    return np.concatenate(parts), reasons


def _errors(path: Path) -> list[ErrorRow]:
    if not path.exists():
        return []
    rows = [row for block in csvfile.texts(path, ERROR) for row in zip(*block.columns, strict=True)]
    return [ErrorRow(int(t), sensor, error, *map(float, rest)) for t, sensor, error, *rest in rows]


def _apart(path: Path, sensors: list[str], remarks: list[str]) -> np.ndarray:
    """(a,) SEPARATIONS in order of time; none of a run by another method, or of an older version."""
    parts, damaged = [np.empty(0, SEPARATIONS)], 0
    for columns, bad in csvfile.texts(path, APART) if path.exists() else ():
        rows = []
        for t, sensor, *metres in zip(*columns, strict=True):
            try:
                rows.append((int(t), sensors.index(sensor), *map(float, metres)))
            except ValueError:  # torn, or of no sensor of this station
                bad += 1
        parts.append(np.array(rows, SEPARATIONS))
        damaged += bad
    if damaged:
        remarks.append(f"{path.name}: {damaged} lines cannot be read and are left out")
    return _in_order(np.concatenate(parts))


def _in_order(values: np.ndarray) -> np.ndarray:
    timed = values[values["t_ns"] != NO_TIME]
    return timed[np.argsort(timed["t_ns"], kind="stable")]


def _events(path: Path, remarks: list[str]) -> list[tuple[int, str, str]]:
    if not path.exists():
        remarks.append("events.csv is missing: the run is of an older version, and its events are not listed")
        return []
    rows = [row for block in csvfile.texts(path, EVENT) for row in zip(*block.columns, strict=True)]
    return [(int(t), level, text) for t, level, text in rows]


def _summary(path: Path, remarks: list[str]) -> dict:
    try:
        return json.loads(path.read_text(encoding="utf-8"))
    except FileNotFoundError:
        remarks.append(
            "the run did not end: summary.json is missing, so what only it holds (NIS, systematic errors, "
            "damage of the log) is missing here, and smoothed.csv is a window's view and not the flight's"
        )
    except ValueError:
        remarks.append("summary.json cannot be read, and what only it holds is missing here")
    return {}


def _frame(station: Station, state: np.void) -> Frame:
    """The station's origin; where the file has none, the one that a state's two positions stand for."""
    if station.range.origin:
        return origin_frame(station)
    place = [float(state[name]) for name in ("lat_deg", "lon_deg", "alt_m")]
    there = np.array([[state[name] for name in ("e_m", "n_m", "u_m")]])
    frame = Frame(*place)
    for _ in range(10):  # each turn leaves 1e-3 of what was wrong, some kilometres over the Earth's radius
        frame = Frame(*(float(x[0]) for x in frame.to_geodetic(frame.to_enu(*place) - there)))
    return frame
