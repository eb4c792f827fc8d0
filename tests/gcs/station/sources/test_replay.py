"""The main job on the sample flight: nothing lost, the same files every time, near the truth."""

import csv
import json
import time
from collections import Counter
from itertools import pairwise
from pathlib import Path

import numpy as np
import pytest

from gcs.contract import config
from gcs.outputs.record import Record
from gcs.station.ledger import NO_TIME
from gcs.station.session import Session
from gcs.station.sources import replay
from gcs.station.sources.playback import EMPTY_NS, STEP_NS, Playback

SAMPLE = Path(__file__).resolve().parents[4] / "logs" / "sample"
FEEDS = {name: SAMPLE / f"{name}.csv" for name in ("theo-north", "theo-east", "radar-1")}


def play(out: Path, feeds: dict[str, Path], step_ns: int = STEP_NS, seconds: float = np.inf) -> dict:
    """Replay the sample flight into ``out``, ``step_ns`` of data at a time, the first ``seconds`` of it."""
    station = config.load(SAMPLE / "station.toml")
    flight = replay.load(SAMPLE / "flight.tlog", station, feeds)
    session = Session(station, flight.frame, [Record(out, station, flight.frame)])
    session.enter_air(flight.air)
    whole = replay.batch(flight, session.intake)
    end_ns = min(flight.end_ns + replay.APART_NS, flight.start_ns + seconds * 1e9)
    edges = np.arange(flight.start_ns, end_ns, step_ns)
    for begin, end in pairwise([NO_TIME, *edges.tolist()]):
        inside = (whole.valid_ns >= begin) & (whole.valid_ns < end)
        session.enter(replay.Batch(*(column[inside] for column in whole)))
        session.advance(int(end))
    return session.finish(flight.about)


def table(path: Path) -> list[dict]:
    with path.open(encoding="utf-8", newline="") as file:
        return list(csv.DictReader(file))


@pytest.fixture(scope="module")
def run(sample_run):
    """What the command left, the flight as it was read, and the summary."""
    flight = replay.load(SAMPLE / "flight.tlog", config.load(SAMPLE / "station.toml"), FEEDS)
    return sample_run, flight, json.loads((sample_run / "summary.json").read_text(encoding="utf-8"))


def test_every_value_has_exactly_one_verdict(run):
    out, flight, summary = run
    came_in = sum(np.isfinite(flight.ins[name]).sum() for name in ("lat_deg", "ve_mps", "ae_mps2")) * 3
    for measured, bads in flight.feeds.values():
        channels = ("range_m", "azimuth_deg", "elevation_deg", "range_rate_mps")
        came_in += sum(np.isfinite(measured[name]).sum() for name in channels) + len(bads)
    rows = table(out / "verdicts.csv")
    assert len(rows) == came_in
    counted = Counter((row["sensor"], row["channel"] or "line", row["verdict"]) for row in rows)
    stated = {
        (sensor, channel, verdict): n
        for sensor, channels in summary["verdicts"].items()
        for channel, verdicts in channels.items()
        for verdict, n in verdicts.items()
    }
    assert counted == stated


@pytest.mark.slow
def test_the_same_bits_however_the_data_are_cut(run, tmp_path):
    """Also by hand, without the command, which adds to the summary what only it knows."""
    out, _, whole = run
    play(tmp_path, FEEDS, step_ns=70_000_000)
    for name in ("track.csv", "smoothed.csv", "verdicts.csv", "separation.csv", "station.toml"):
        assert (tmp_path / name).read_bytes() == (out / name).read_bytes(), name
    summary = json.loads((tmp_path / "summary.json").read_text(encoding="utf-8"))
    assert {key: whole.get(key) for key in summary} == summary


def test_the_separation_of_each_sensor_is_written_four_times_a_second(run):
    out, flight, _ = run
    rows = table(out / "separation.csv")
    seconds = (flight.end_ns - flight.start_ns) * 1e-9
    counts = Counter(row["sensor"] for row in rows)
    assert set(counts) == {"ins", *FEEDS}
    assert all(3.5 < count / seconds < 4.1 for count in counts.values())
    assert {row["t_ns"] for row in rows} <= {row["t_ns"] for row in table(out / "track.csv")}


def test_summary_states_settings_rates_and_gaps(run):
    _, _, summary = run
    assert summary["settings"]["method"] == "default"
    assert summary["settings"]["station"]["sensor"][0]["name"] == "theo-north"
    assert summary["software"]["version"]
    paces = summary["pace"]
    assert paces["theo-north"]["rate_hz"] == pytest.approx(20.0, rel=0.01)
    assert paces["radar-1"]["rate_hz"] == pytest.approx(10.0, rel=0.01)
    assert paces["theo-east"]["gaps"] >= 1  # the sample has drop-outs
    assert paces["theo-east"]["longest_gap_s"] > 1.0


def test_every_track_tells_how_far_it_holds(run):
    """The columns come last; a level is a number above the state's own sigma, or empty."""
    out, _, _ = run
    for name in ("track.csv", "smoothed.csv"):
        rows = table(out / name)
        assert list(rows[0])[-3:] == ["protection_h_m", "protection_v_m", "ambiguous"]
        assert {row["ambiguous"] for row in rows} <= {"0", "1"}
        for row in rows:
            for level, sigma in (("protection_h_m", "sigma_e_m"), ("protection_v_m", "sigma_u_m")):
                assert row[level] == "" or float(row[sigma]) < float(row[level]) < float("inf")
        assert all(np.isfinite(float(row["sigma_e_m"])) for row in rows)
    told = [row["protection_h_m"] != "" for row in table(out / "track.csv")]
    assert np.mean(told) > 0.8


def test_near_the_truth(run):
    """Within a metre and a half of the simulator's own track, newest state and best estimate.

    Nearly all of it is along the course: the flight's time is what most clocks say, and these are 40 ms
    behind.
    """
    out, flight, _ = run
    truth = np.genfromtxt(SAMPLE / "truth.csv", delimiter=",", names=True)
    enu = flight.frame.to_enu(truth["lat_deg"], truth["lon_deg"], truth["alt_m"])
    for name in ("track.csv", "smoothed.csv"):
        rows = table(out / name)
        t_s = np.array([int(row["t_ns"]) for row in rows]) / 1e9
        seen = np.array([[float(row[axis]) for axis in ("e_m", "n_m", "u_m")] for row in rows])
        inside = (t_s > truth["t_ns"][0] / 1e9 + 5) & (t_s < truth["t_ns"][-1] / 1e9)
        true = np.stack([np.interp(t_s, truth["t_ns"] / 1e9, enu[:, k]) for k in range(3)], axis=1)
        rms = np.sqrt(np.mean(np.sum((seen - true)[inside] ** 2, axis=1)))
        assert rms < 1.5, name


@pytest.mark.slow
def test_damaged_feed_lines_cost_only_themselves(tmp_path):
    """NaN, 1e300, text, a missing field, rows repeated and out of order: all judged, the others untouched.

    The first minute of the sample.
    """
    lines = (SAMPLE / "radar-1.csv").read_text().splitlines()[:601]
    header, rows = lines[0], lines[1:]
    damaged = list(rows)
    fields = damaged[100].split(",")
    damaged[100] = ",".join([fields[0], "1e300", *fields[2:]])
    damaged[200] = ",".join([damaged[200].split(",")[0], "nan", *damaged[200].split(",")[2:]])
    damaged[300] = "what is this"
    damaged[400], damaged[450] = damaged[450], damaged[400]
    damaged.insert(500, damaged[499])
    path = tmp_path / "radar-1.csv"
    path.write_text("\n".join([header, *damaged]) + "\n")
    summary = play(tmp_path / "run", FEEDS | {"radar-1": path}, seconds=70.0)
    counts = Counter()
    for channel in summary["verdicts"]["radar-1"].values():
        counts.update(channel)
    channels = sum(bool(field) for field in rows[499].split(",")[1:])
    assert counts["invalid"] == 2
    assert counts["duplicate"] == channels
    clean = sum(bool(field) for row in rows for field in row.split(",")[1:])
    # line 300 lost its values and is one verdict instead, line 200 lost its range; 1e300 is still one value
    lost = sum(bool(field) for field in rows[300].split(",")[1:]) - 1 + 1
    assert sum(counts.values()) == clean - lost + channels


@pytest.mark.slow
def test_a_run_that_is_cut_off_leaves_what_was_final(tmp_path):
    station = config.load(SAMPLE / "station.toml")
    flight = replay.load(SAMPLE / "flight.tlog", station, FEEDS)
    session = Session(station, flight.frame, [Record(tmp_path, station, flight.frame)])
    whole = replay.batch(flight, session.intake)
    begun = whole.valid_ns < flight.start_ns + 40_000_000_000
    session.enter(replay.Batch(*(column[begun] for column in whole)))
    session.advance(int(whole.valid_ns[begun][-1]))
    assert len(table(tmp_path / "track.csv")) > 100
    assert len(table(tmp_path / "verdicts.csv")) > 100
    assert not (tmp_path / "summary.json").exists()


def test_playback_pauses_seeks_and_ends():
    playback = Playback(0, 10 * STEP_NS, np.arange(0, 10 * STEP_NS, 10**8), float("inf"))
    assert playback.upto() == STEP_NS
    playback.pause()
    playback.seek(5 * STEP_NS)
    assert [playback.upto() for _ in range(4)] == [k * STEP_NS for k in (2, 3, 4, 5)]
    playback.seek(0)
    assert playback.upto() is None
    playback.play()
    assert playback.upto() == STEP_NS
    playback.stop()
    assert playback.upto() == STEP_NS


YEARS_NS = 5 * 365 * 86_400 * 10**9


@pytest.mark.parametrize("speed", [10.0, float("inf")])
def test_years_between_two_logs_are_passed_over(speed):
    """Two seconds of data, five years of nothing, two seconds: as long as four seconds."""
    second = np.arange(0, 2 * STEP_NS, 10**8)
    times_ns = np.concatenate([second, YEARS_NS + second])
    end_ns = int(times_ns[-1])
    playback = Playback(0, end_ns, times_ns, speed)
    steps = []
    while not steps or steps[-1] < end_ns:
        steps.append(playback.upto())
        time.sleep(0.001)
        assert len(steps) < 10_000
    assert steps == sorted(steps)
    assert not [step for step in steps if EMPTY_NS < step < YEARS_NS]
    playback.pause()
    playback.seek(0)
    assert playback.upto() is None
    playback.seek(YEARS_NS + 10**9)
    for _ in range(10):
        if (reached := playback.upto()) == YEARS_NS + 10**9:
            break
    assert reached == YEARS_NS + 10**9


def test_summary_is_json_without_nan(run):
    text = (run[0] / "summary.json").read_text(encoding="utf-8")
    json.loads(text, parse_constant=lambda name: pytest.fail(f"{name} in summary.json"))


def test_feeds_alone_are_a_flight(tmp_path):
    """Two instruments without an aircraft's word: the same trajectory, every value in the record."""
    station = config.load(SAMPLE / "station.toml")
    feeds = {name: FEEDS[name] for name in ("theo-north", "radar-1")}
    flight = replay.load(None, station, feeds)
    station = replay.heard(station, feeds)
    assert [sensor.name for sensor in station.sensor] == list(feeds)
    playback = Playback(flight.start_ns, flight.end_ns, flight.times_ns, float("inf"))

    def session() -> Session:
        return Session(station, flight.frame, [Record(tmp_path, station, flight.frame)])

    summary = replay.run(flight, session, playback, stay=False)
    assert summary["complete"]
    assert summary["log"] is None
    assert {row["sensor"] for row in table(tmp_path / "verdicts.csv")} == set(feeds)
    used = summary["verdicts"]["theo-north"]["range"]["used"]
    assert used > 0.8 * len(flight.feeds["theo-north"][0])
    assert len(table(tmp_path / "smoothed.csv")) > 1000


def test_an_instrument_without_a_feed_has_no_vote():
    station = config.load(SAMPLE / "station.toml")
    assert replay.heard(station, {}).sensor == []


def alone() -> dict[str, dict[str, int]]:
    """Counts by channel of ten seconds, from before take-off, with one theodolite alone."""
    late = "sensor.theo-north.latency_s={ range_m = 0.06, elevation_deg = 0.01 }"
    station = config.load(SAMPLE / "station.toml", [late])
    flight = replay.load(None, station, {"theo-north": FEEDS["theo-north"]})
    session = Session(replay.heard(station, flight.feeds), flight.frame, [])
    whole, upto_ns = replay.batch(flight, session.intake), flight.start_ns + 10_000_000_000
    session.enter(replay.Batch(*(column[whole.valid_ns < upto_ns] for column in whole)))
    session.advance(upto_ns)
    return session.finish({})["verdicts"]["theo-north"]


def share_used(counts: dict[str, int]) -> float:
    return (counts.get("used", 0) + counts.get("deweighted", 0)) / sum(counts.values())


def test_a_lone_instrument_starts_though_its_channels_are_of_different_instants():
    counts = alone()
    assert set(counts) == {"range", "azimuth", "elevation"}
    assert min(share_used(channel) for channel in counts.values()) > 0.8
    assert share_used(counts["range"]) > 0.9
    assert share_used(counts["azimuth"]) > 0.9


def test_a_lone_instrument_sees_the_climb():
    assert share_used(alone()["elevation"]) > 0.9
