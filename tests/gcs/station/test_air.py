"""Wind and dead reckoning in the loop: a made-up flight, cut into any pieces; and a recorded one."""

import csv
from collections import Counter
from pathlib import Path

import numpy as np
import pytest

from bridges.tlog import tlog
from filters.models.rows import TRACK
from filters.wind.wind import true_airspeed
from gcs.contract import config
from gcs.contract.messages import AIR, Event, Wind
from gcs.outputs.record import Record
from gcs.station.air import LOST_NS, Air
from gcs.station.session import Session
from gcs.station.sources import replay
from gcs.station.sources.playback import Playback
from tests.bridges.flights import without_fix

DATA = Path(__file__).parents[3] / "../shared/data"
SAMPLE = Path(__file__).parents[3] / "logs" / "sample"
T0_NS = 1_700_000_000_000_000_000
S_NS = 1_000_000_000
WIND = np.array([6.0, -5.0])  # east, north
TAS_MPS, HEIGHT_M = 20.0, 500.0
LOST_S = (60.0, 120.0)
LOST_SAMPLE_S = (115.0, 140.0)  # after the turns that show the wind


def circles(t_s: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """(n,) yaw rad and (n, 2) ground velocity: level circles of a minute, through moving air."""
    yaw = 2.0 * np.pi * t_s / 60.0
    return yaw, TAS_MPS * np.column_stack([np.sin(yaw), np.cos(yaw)]) + WIND


def flight(seconds: float = 150.0) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """(TRACK at 20 Hz, AIR at 10 Hz, true position of the air's times); no fix within LOST_S."""
    t_s = np.arange(0.0, seconds, 0.05)
    yaw, velocity = circles(t_s)
    position = np.concatenate([[[0.0, 0.0]], np.cumsum((velocity[1:] + velocity[:-1]) * 0.025, axis=0)])
    track = np.zeros(len(t_s), TRACK)
    track["t_ns"] = T0_NS + np.round(t_s * S_NS).astype(np.int64)
    track["x"][:, :2], track["x"][:, 2], track["x"][:, 3:5] = position, HEIGHT_M, velocity
    track["P"][:] = np.eye(9)
    lost = (t_s > LOST_S[0]) & (t_s < LOST_S[1])
    track["fixed_ns"] = np.where(lost, T0_NS + round(LOST_S[0] * S_NS), track["t_ns"])
    track["x"][lost] = 1e6  # an estimator that coasts on noise
    air = np.zeros(len(t_s[::2]), AIR)
    air["t_ns"] = track["t_ns"][::2] + 1
    air["airspeed_mps"] = TAS_MPS / true_airspeed(1.0, HEIGHT_M)
    air["alt_msl_m"], air["yaw_deg"], air["coordinated"] = HEIGHT_M, np.degrees(yaw[::2]), 1.0
    air["roll_deg"] = np.degrees(np.arctan(TAS_MPS * 2.0 * np.pi / 60.0 / 9.81))
    air["own_wind_e_mps"], air["own_wind_n_mps"] = 5.0, 0.0
    return track, air, position[::2]


def play(track: np.ndarray, air: np.ndarray, piece_ns: int) -> tuple[np.ndarray, list, Air]:
    """All of it, ``piece_ns`` at a time."""
    one, out, told = Air(), [], []
    one.enter(air)
    edges = np.arange(T0_NS, track["t_ns"][-1] + piece_ns, piece_ns)
    for begin, end in zip(edges - piece_ns, edges, strict=True):
        part = track[(track["t_ns"] > begin) & (track["t_ns"] <= end)]
        rows, said = one.step(part, int(end))
        out.append(rows)
        told += said
    return np.concatenate(out), told, one


@pytest.fixture(scope="module")
def flown():
    track, air, position = flight()
    return track, air, position, *play(track, air, S_NS)


def test_the_wind_is_found_and_compared(flown):
    *_, told, one = flown
    winds = [m for m in told if isinstance(m, Wind)]
    assert winds[-1].known
    assert winds[-1].speed_mps == pytest.approx(np.hypot(*WIND), abs=0.2)
    assert winds[-1].from_deg == pytest.approx(np.degrees(np.arctan2(-6.0, 5.0)) % 360, abs=2.0)
    assert winds[-1].own_from_deg == pytest.approx(270.0)
    assert one.report()["autopilot_median"]["speed_mps"] == pytest.approx(5.0)


def test_air_data_carry_on_where_positions_end(flown):
    _, air, position, rows, _, _ = flown
    gone = (rows["t_ns"] > T0_NS + 64 * S_NS) & (rows["t_ns"] < T0_NS + 119 * S_NS)
    reckoned = rows[gone]
    assert len(reckoned) == pytest.approx(550, abs=5)
    at = np.searchsorted(air["t_ns"], reckoned["t_ns"])
    off = reckoned["x"][:, :2] - position[at]
    assert np.abs(off).max() < 10.0
    nees = np.einsum("ki,kij,kj->k", off, np.linalg.inv(reckoned["P"][:, :2, :2]), off)
    assert nees.max() < 12.0
    assert np.all(np.linalg.eigvalsh(reckoned["P"]) > 0.0)
    sigma = np.sqrt(reckoned["P"][:, 0, 0])
    assert sigma[-1] > 2.0 * sigma[0]
    assert reckoned["x"][:, 2] == pytest.approx(HEIGHT_M)
    assert 0 <= reckoned["quality"].min() <= reckoned["quality"].max() <= 10


def test_reckoning_begins_late_and_ends_at_once(flown):
    _, _, _, rows, told, one = flown
    begun, ended = [m for m in told if isinstance(m, Event)]
    assert begun.t_ns - T0_NS - LOST_S[0] * S_NS == pytest.approx(LOST_NS, abs=0.1 * S_NS)
    assert ended.t_ns - T0_NS == pytest.approx(LOST_S[1] * S_NS, abs=0.1 * S_NS)
    assert begun.level == "warning"
    assert one.report()["states_reckoned"] == pytest.approx(580, abs=3)
    assert np.all(np.diff(rows["t_ns"]) > 0)
    after = rows["t_ns"] >= T0_NS + 121 * S_NS
    assert np.all(rows["fixed_ns"][after] == rows["t_ns"][after])


@pytest.mark.parametrize("piece_ns", [30_000_000, 7_000_000_000])
def test_pieces_do_not_matter(flown, piece_ns):
    track, air, _, rows, told, _ = flown
    again, said, _ = play(track, air, piece_ns)
    assert again.tobytes() == rows.tobytes()
    assert said == told


def test_without_air_data_nothing_changes():
    track, air, _ = flight()
    rows, told, one = play(track, air[:0], S_NS)
    assert rows.tobytes() == track.tobytes()
    assert told == []
    assert one.report() is None


def test_on_the_ground_nothing_is_reckoned():
    track, air, _ = flight()
    air["airspeed_mps"][air["t_ns"] > T0_NS + 50 * S_NS] = 3.0
    rows, told, _ = play(track, air, S_NS)
    assert rows.tobytes() == track.tobytes()
    assert not [m for m in told if isinstance(m, Event)]


class Keep:
    """A sink that remembers."""

    def __init__(self):
        self.track, self.told = [], []

    def take(self, update):
        self.track.append(update.track)
        self.told += update.told

    def close(self, summary, best):
        self.summary = summary


@pytest.mark.slow
def test_a_recorded_flight_without_any_position_for_a_minute():
    """Wind of 8 m/s from 310°; after the minute the error is a third of that of still air at most."""
    log = DATA / "plane_wind8.tlog"
    if not log.exists():
        pytest.skip(f"{log} is not there: the recorded flights are kept beside the repository")
    station, kept = config.load(None), Keep()
    loaded = replay.load(log, station, {})
    begin_ns, end_ns = (loaded.start_ns + s * S_NS for s in (300, 360))
    lost = (loaded.ins["t_ns"] > begin_ns) & (loaded.ins["t_ns"] < end_ns)
    there = loaded.ins[np.isfinite(loaded.ins["lat_deg"])]
    for name in ("lat_deg", "lon_deg", "alt_msl_m", "ve_mps", "vn_mps", "vu_mps"):
        loaded.ins[name][lost] = np.nan
    session = Session(station, loaded.frame, [kept])
    replay.run(
        loaded,
        lambda: session,
        Playback(loaded.start_ns, loaded.end_ns, loaded.times_ns, float("inf")),
        stay=False,
    )
    track = np.concatenate(kept.track)
    last = track[np.searchsorted(track["t_ns"], end_ns) - 1]
    true = loaded.frame.to_enu(there["lat_deg"], there["lon_deg"], there["alt_msl_m"])
    at = [np.interp(last["t_ns"] / 1e9, there["t_ns"] / 1e9, true[:, k]) for k in (0, 1)]
    off = last["x"][:2] - at
    assert np.hypot(*off) < 8.0 * 60.0 / 3.0
    assert off @ np.linalg.solve(last["P"][:2, :2], off) < 12.0
    found = kept.summary["wind"]
    assert found["median"]["speed_mps"] == pytest.approx(8.0, abs=0.3)
    assert found["median"]["from_deg"] == pytest.approx(310.0, abs=3.0)
    assert found["states_reckoned"] > 500


@pytest.mark.slow
def test_a_log_that_says_that_gps_was_lost(tmp_path):
    """The autopilot's own reckoning is refused, each value with its verdict; ours takes over."""
    log = tlog.read(SAMPLE / "flight.tlog")
    path = tmp_path / "flight.tlog"
    path.write_bytes(without_fix(log, *LOST_SAMPLE_S))
    station, kept = config.load(None), Keep()
    loaded = replay.load(path, station, {})
    session = Session(station, loaded.frame, [kept, Record(tmp_path, station, loaded.frame)])
    session.enter(replay.batch(loaded, session.intake))
    session.enter_air(loaded.air)
    summary = session.finish(loaded.about)

    lost = loaded.ins["dead_reckoned"] > 0
    begin_ns, end_ns = loaded.ins["t_ns"][lost][[0, -1]].tolist()
    assert (end_ns - begin_ns) / S_NS == pytest.approx(np.ptp(LOST_SAMPLE_S), abs=0.3)
    count = int(lost.sum())
    assert count == summary["log"]["positions_dead_reckoned"]
    assert summary["log"]["frames_bad_crc"] == {}
    with (tmp_path / "verdicts.csv").open(encoding="utf-8", newline="") as file:
        rows = list(csv.DictReader(file))
    invalid = [row for row in rows if row["verdict"] == "invalid"]
    # by accelerations alone the state is known too poorly in the end: the rest waits for the next fix
    waiting = [row for row in invalid if row["channel"] in ("ae", "an", "au")]
    assert all(row["reason"].startswith("no state yet") for row in waiting)
    assert len(waiting) < 150
    refused = [row for row in invalid if row not in waiting]
    assert {begin_ns, end_ns} <= {int(row["t_ns"]) for row in refused}
    assert {row["reason"] for row in refused} == {"no GPS fix, the autopilot's own dead reckoning"}
    assert Counter(row["channel"] for row in refused) == dict.fromkeys(
        ["e", "n", "u", "ve", "vn", "vu"], count
    )
    assert sum(row["channel"] == "e" for row in rows) == np.isfinite(loaded.ins["lat_deg"]).sum()
    moved_m = [float(row["value"]) for row in refused if row["channel"] == "e"]
    assert np.ptp(moved_m) > 100.0  # what was said is kept

    texts = [told.text for told in kept.told if isinstance(told, Event)]
    assert [text.split(":")[0] for text in texts] == ["no position or velocity for 2 s", "position is back"]
    truth = np.genfromtxt(SAMPLE / "truth.csv", delimiter=",", names=True)
    true = loaded.frame.to_enu(truth["lat_deg"], truth["lon_deg"], truth["alt_m"])
    track = np.concatenate(kept.track)
    last = track[np.searchsorted(track["t_ns"], end_ns) - 1]
    off = last["x"][:2] - [np.interp(last["t_ns"] / 1e9, truth["t_ns"] / 1e9, true[:, k]) for k in (0, 1)]
    assert np.hypot(*off) < 8.0 * np.ptp(LOST_SAMPLE_S) / 3.0
    assert off @ np.linalg.solve(last["P"][:2, :2], off) < 12.0
    assert last["quality"] < 10.0
