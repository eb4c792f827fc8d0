"""Real angle stations: a quadrotor seen by two that sweep the room with light, motion capture as truth.

A station sweeps for the azimuth and 8 ms later for the elevation, 30 or 60 times a second, from 2 to 5 m.
Data: Taffanel et al. 2021, *Lighthouse Positioning System: Dataset, Accuracy, and Precision for UAV Research*
(arXiv 2104.11523), the runs ``lh1_*`` with the first kind of stations. As there, the two frames and clocks
are brought together by the flight itself: the rigid motion (Arun et al. 1987) and the two ends of the
recording that leave the least between motion capture and where the vehicle thought it was.
"""

import itertools
import re
import struct
from pathlib import Path
from typing import NamedTuple

import numpy as np

from bench.trials import flights, scene
from bench.trials.world import AZIMUTH, ELEVATION, ROW, Sensor

STATIONS = 2
BURST_S = 2e-3  # the four receivers of a vehicle see one sweep within so long
SWEEPS_S = 0.08  # two sweeps of one kind at most so far apart make a straight line between them
AGREE_M = 0.1  # of the vehicle's own two lines of sight, where it says where it is
CLIP_M = 0.2  # a larger error between the frames counts as this
SEARCH_MS = ((100, 20), (20, 5), (5, 1))  # (span, step) of the ends of the recording
EVERY_S = 10.0  # a station is silent
STEADY_S = 0.05  # half of the window for the velocity
SEEN_S = 0.02  # motion capture saw it so shortly before and after


class Seen(NamedTuple):
    """A run: the scene, and what was brought together how well."""

    scene: scene.Scene
    left_m: float  # mean distance between motion capture and the vehicle's own position
    judged_ns: np.ndarray  # (k,) when motion capture saw it


def runs(data: Path) -> list[str]:
    """FOLDER/NUMBER of every run with stations of the first kind that has a truth."""
    files = sorted(data.glob("lh1_*/log[0-9][0-9]"))
    return [f"{file.parent.name}/{file.name[3:]}" for file in files if _truth_file(file).is_file()]


def load(data: Path, run: str, sigma_rad: float, spell_s: float = 0.0) -> Seen:
    """One run; each station in turn is silent for ``spell_s`` in EVERY_S, if that is not 0."""
    folder, number = run.split("/")
    log = data / folder / f"log{number}"
    if not log.is_file():
        raise FileNotFoundError(f"{log}: no such file; is --data the folder with lh1_*?")
    events = decode(log.read_bytes())
    t_s, p, left_m = _aligned(events, np.load(_truth_file(log)))
    flight = flights.from_places(run, t_s, p, STEADY_S)
    rows = _rows(events["lhAngle"])
    begin_ns, end_ns = flight.t0_ns, flight.t0_ns + round(flight.truth.t_s[-1] * 1e9)
    rows = rows[(rows["t_ns"] >= begin_ns) & (rows["t_ns"] < end_ns)]
    if spell_s:
        turn, since_ns = np.divmod(rows["t_ns"] - begin_ns, round(EVERY_S * 1e9))
        rows = rows[(turn == 0) | (rows["sensor"] != turn % STATIONS) | (since_ns >= spell_s * 1e9)]
    sensors = _sensors((data / folder / "system-config.yaml").read_text(), sigma_rad)
    return Seen(scene.recorded(flight, sensors, [rows]), left_m, _judged(t_s, rows))


def decode(data: bytes) -> dict[str, dict[str, np.ndarray]]:
    """Columns by name of each kind of event in a log of the vehicle, ``timestamp`` in ms."""
    (version, kinds), at = struct.unpack_from("<HH", data, 1), 5
    if data[0] != 0xBC or version not in (1, 2):
        raise ValueError("not a log of this vehicle, version 1 or 2")
    stamp = struct.Struct("<HI" if version == 1 else "<HQ")
    names: dict[int, tuple[str, list[str], struct.Struct]] = {}
    for _ in range(kinds):
        (number,) = struct.unpack_from("<H", data, at)
        name, at = _text(data, at + 2)
        (count,) = struct.unpack_from("<H", data, at)
        at, fields = at + 2, []
        for _ in range(count):
            field, at = _text(data, at)  # as "x(f)"
            fields.append(field)
        names[number] = name, [f[:-3] for f in fields], struct.Struct("<" + "".join(f[-2] for f in fields))
    found: dict[str, list[tuple]] = {name: [] for name, *_ in names.values()}
    while at < len(data) - 4:  # a checksum ends it
        number, when = stamp.unpack_from(data, at)
        name, _, layout = names[number]
        found[name].append((when / (1 if version == 1 else 1000), *layout.unpack_from(data, at + stamp.size)))
        at += stamp.size + layout.size
    columns = {name: ["timestamp", *fields] for name, fields, _ in names.values()}
    return {
        name: dict(zip(columns[name], np.array(said).T, strict=True)) for name, said in found.items() if said
    }


def _text(data: bytes, at: int) -> tuple[str, int]:
    end = data.index(0, at)
    return data[at:end].decode(), end + 1


def _truth_file(log: Path) -> Path:
    return log.with_name(f"mocap{log.name[3:]}.npy")


def _aligned(events: dict, capture: np.ndarray) -> tuple[np.ndarray, np.ndarray, float]:
    """Times (k,) s of the vehicle's clock and positions (k, 3) of motion capture in the stations' frame."""
    there_s, there = (capture[:, 0] - capture[0, 0]) / 1e3, capture[:, 1:4]
    ends = tuple(events["activeMarkerModeChanged"]["timestamp"][:2])
    if "lhCrossingBeam" in events:
        own = events["lhCrossingBeam"]
        p, good = np.column_stack([own["x"], own["y"], own["z"]]), own["delta"] < AGREE_M
    else:
        own = events["fixedFrequency"]
        p = np.column_stack([own[f"stateEstimate.{axis}"] for axis in "xyz"])
        good = np.ones(len(p), bool)

    def fit(begin_ms: float, end_ms: float) -> tuple[float, np.ndarray, np.ndarray]:
        when_s = (own["timestamp"] - begin_ms) / (end_ms - begin_ms) * there_s[-1]
        q = np.column_stack([np.interp(when_s, there_s, axis) for axis in there.T])
        use = good & (when_s > 0.0) & (when_s < there_s[-1]) & np.isfinite(q).all(axis=1)
        turn, shift = _rigid(q[use], p[use])
        apart_m = np.linalg.norm(q[use] @ turn.T + shift - p[use], axis=1)
        return np.minimum(apart_m, CLIP_M).mean(), turn, shift

    for span, step in SEARCH_MS:
        near = [np.arange(end - span, end + span + 1, step) for end in ends]
        ends = min(itertools.product(*near), key=lambda both: fit(*both)[0])
    (begin_ms, end_ms), (left_m, turn, shift) = ends, fit(*ends)
    seen = np.isfinite(there).all(axis=1)
    t_s = (begin_ms + there_s[seen] / there_s[-1] * (end_ms - begin_ms)) / 1e3
    return t_s, there[seen] @ turn.T + shift, float(left_m)


def _rigid(a: np.ndarray, b: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Rotation (3, 3) and shift (3,) that bring points ``a`` (k, 3) to ``b`` (k, 3)."""
    u, _, vt = np.linalg.svd((a - a.mean(axis=0)).T @ (b - b.mean(axis=0)))
    turn = (vt.T * [1.0, 1.0, np.linalg.det(vt.T @ u.T)]) @ u.T
    return turn, b.mean(axis=0) - turn @ a.mean(axis=0)


def _rows(said: dict[str, np.ndarray]) -> np.ndarray:
    """(k,) ROW in order of time: each sweep that all four receivers saw, in the middle of them.

    The stations give the angles of two planes. Azimuth and elevation are made of these; the first plane's
    angle by a straight line between its sweeps.
    """
    parts = []
    for station in range(STATIONS):
        t_s, across = _sweeps(said, station, 0)
        up_s, up = _sweeps(said, station, 1)
        k = np.clip(np.searchsorted(t_s, up_s), 1, len(t_s) - 1)
        between = (t_s[k - 1] <= up_s) & (up_s <= t_s[k]) & (t_s[k] - t_s[k - 1] < SWEEPS_S)
        elevation = np.arctan(np.tan(up) * np.cos(np.interp(up_s, t_s, across)))
        for when, value, channel in (
            (t_s, -across, AZIMUTH),
            (up_s[between], elevation[between], ELEVATION),
        ):
            rows = np.zeros(len(when), ROW)
            rows["t_ns"], rows["value"] = np.round(when * 1e9), value
            rows["sensor"], rows["channel"] = station, channel
            parts.append(rows)
    both = np.concatenate(parts)
    return both[np.argsort(both["t_ns"], kind="stable")]


def _sweeps(said: dict[str, np.ndarray], station: int, kind: int) -> tuple[np.ndarray, np.ndarray]:
    """Times (k,) s and angles (k,) rad of one station's sweeps of one kind."""
    mine = (said["basestation"] == station) & (said["sweep"] == kind)
    t_s, angle = said["timestamp"][mine] / 1e3, said["correctedAngle"][mine]
    first = np.flatnonzero(np.diff(t_s, prepend=-np.inf) > BURST_S)
    count = np.diff(np.append(first, len(t_s)))
    full = count == 4
    return (np.add.reduceat(t_s, first) / count)[full], (np.add.reduceat(angle, first) / count)[full]


def _sensors(config: str, sigma_rad: float) -> list[Sensor]:
    """Where each station stands and how it is turned: it looks along its x, the y to its left."""
    numbers = re.findall(r"-?\d+\.\d+(?:e-?\d+)?", config[config.index("geos:") :])
    geometry = np.array(numbers[: 12 * STATIONS], float).reshape(STATIONS, 12)
    sigma = np.full(13, np.nan)
    sigma[[AZIMUTH, ELEVATION]] = sigma_rad
    axes = np.array([[0.0, -1.0, 0.0], [1.0, 0.0, 0.0], [0.0, 0.0, 1.0]])
    return [
        Sensor(f"station-{k}", "theodolite", sigma, place[:3], axes @ place[3:].reshape(3, 3).T)
        for k, place in enumerate(geometry)
    ]


def _judged(t_s: np.ndarray, rows: np.ndarray) -> np.ndarray:
    """(k,) times of ``rows`` around which motion capture saw the vehicle, ns."""
    t_ns = np.unique(rows["t_ns"])
    k = np.clip(np.searchsorted(t_s, t_ns * 1e-9), 1, len(t_s) - 1)
    return t_ns[(t_s[k] - t_ns * 1e-9 < SEEN_S) & (t_ns * 1e-9 - t_s[k - 1] < SEEN_S)]
