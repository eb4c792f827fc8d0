"""A recording gives the run again, bit for bit, and as much of it as is left when it was cut or damaged."""

import json
from contextlib import suppress

import numpy as np
import pytest
from mcap.reader import make_reader
from mcap.records import Chunk
from mcap.stream_reader import StreamReader

from gcs.contract.messages import AIR, AirData, Bad, InputError, PolarMeasurement, State
from gcs.outputs import recording as writing
from gcs.outputs.publish import Publisher
from gcs.outputs.record import Record
from gcs.outputs.recording import RunRecorder
from gcs.station.health import Files, Monitor
from gcs.station.session import Session
from gcs.station.sources import replay
from gcs.station.sources.playback import Playback
from gcs.station.sources.recording import Recording
from tests.gcs.station import made

TABLES = ("track.csv", "smoothed.csv", "verdicts.csv", "separation.csv", "station.toml")


def nobody(_level: str, text: str) -> None:
    raise AssertionError(text)


def recorded(folder, turns) -> dict:
    """Fly live into ``folder``; returns the summary."""
    station, frame = made.station()
    recorder = RunRecorder(folder, station, frame, nobody, made.ABOUT)
    monitor = Monitor(["ins", *made.FEEDS], Files())
    sinks = [recorder, Publisher(frame, monitor, [recorder.target])]
    summary = made.fly(Session(station, frame, sinks), turns, recorder.turn)
    recorder.end()
    return summary


def write(path, turns):
    """Only the turns, into a recording at ``path``."""
    station, frame = made.station()
    path.parent.mkdir(exist_ok=True)
    recorder = RunRecorder(path.parent, station, frame, nobody, made.ABOUT)
    for now_ns, arrived in turns:
        recorder.turn(now_ns, arrived)
    recorder.end()
    return Recording(path)


def play(path, folder) -> dict:
    recording = Recording(path)
    station, frame = made.station()
    playback = Playback(recording.start_ns, recording.end_ns, recording.times_ns, float("inf"))
    return replay.run(
        recording,
        lambda: Session(station, frame, [Record(folder, station, frame, nobody)]),
        playback,
        stay=False,
    )


@pytest.fixture(scope="module")
def run(tmp_path_factory):
    folder = tmp_path_factory.mktemp("live")
    turns = made.turns(3.0)
    return folder, turns, recorded(folder, turns)


@pytest.fixture
def fine(monkeypatch):
    """A chunk ends after every turn."""
    monkeypatch.setattr(writing, "FLUSH_S", 0.0)


def test_the_replay_is_the_run(run, tmp_path):
    folder, turns, summary = run
    again = play(folder / "run.mcap", tmp_path)
    for name in TABLES:
        assert (tmp_path / name).read_bytes() == (folder / name).read_bytes(), name
    assert len((folder / "verdicts.csv").read_text().splitlines()) > 300
    assert len((folder / "separation.csv").read_text().splitlines()) > 20
    assert "torn line" in (tmp_path / "verdicts.csv").read_text()
    assert again["verdicts"] == summary["verdicts"]
    assert again["unknown_sources"] == {"stranger": 1}
    assert again["recording"] == {"turns": len(turns), "missing_turns": 0, "ended": True}


def test_what_came_in_is_kept_as_it_was(run):
    folder, turns, _ = run
    kept = [(turn.now_ns, turn.arrived) for turn in Recording(folder / "run.mcap").turns()]
    assert kept == turns


def test_another_program_reads_it(run):
    """The library's own reader by index, from the file alone: every topic, its schema, times in order."""
    folder, turns, _ = run
    with (folder / "run.mcap").open("rb") as file:
        reader = make_reader(file, validate_crcs=True)
        summary = reader.get_summary()
        found = list(reader.iter_messages())
        station = next(iter(reader.iter_attachments()))
        about = next(iter(reader.iter_metadata()))
    assert station.data == (folder / "station.toml").read_bytes()
    assert about.metadata == made.ABOUT
    assert summary.statistics.message_count == len(found)
    topics = {channel.topic for _, channel, _ in found}
    raw = {f"/raw/{name}" for name in ("ins", "air", *made.FEEDS)}
    foxglove = {"/state/odometry", "/state/location", "/tf", "/events"}
    assert topics == raw | foxglove | {"/turn", "/raw/radar-1/bad", "/raw/stranger/bad"}
    assert sum(channel.topic == "/turn" for _, channel, _ in found) == len(turns)
    for schema, channel, message in found:
        described = json.loads(schema.data)
        assert (channel.message_encoding, schema.encoding) == ("json", "jsonschema")
        assert described["title"] == schema.name
        assert "$ref" not in schema.data.decode()
        assert set(described["required"]) <= set(json.loads(message.data))
    times = [message.log_time for _, _, message in found]
    assert times == sorted(times)


def test_states_are_there_for_foxglove(run, tmp_path):
    folder, _, _ = run
    rows = np.genfromtxt(folder / "track.csv", delimiter=",", names=True)
    with (folder / "run.mcap").open("rb") as file:
        found = [json.loads(m.data) for _, _, m in make_reader(file).iter_messages("/state/location")]
    assert len(found) == len(rows)
    np.testing.assert_allclose([fix["latitude"] for fix in found], rows["lat_deg"], rtol=0, atol=2e-9)
    sigma = np.sqrt([fix["position_covariance"][8] for fix in found])
    np.testing.assert_allclose(sigma, rows["sigma_u_m"], rtol=1e-3, atol=1e-4)


@pytest.mark.usefixtures("fine")
def test_cut_anywhere_it_gives_what_came_before(tmp_path):
    turns = made.turns(0.3)
    whole = write(tmp_path / "run.mcap", turns)
    data = whole.path.read_bytes()
    cut = tmp_path / "cut.mcap"
    longest = 0
    for size in [*range(0, len(data), 197), len(data) - 1]:
        cut.write_bytes(data[:size])
        kept = []
        with suppress(InputError):  # before the first whole chunk
            kept = [(turn.now_ns, turn.arrived) for turn in Recording(cut).turns()]
        assert kept == turns[: len(kept)], size
        assert len(kept) >= longest
        longest = len(kept)
    assert longest == len(turns)


@pytest.mark.usefixtures("fine")
def test_damage_costs_the_chunks_it_hits(tmp_path):
    turns = made.turns(0.5)
    path = write(tmp_path / "run.mcap", turns).path
    data = path.read_bytes()
    first = data.index(b"theo-north")  # in the station file: chunks come after it
    noise = np.random.default_rng(1)
    for _ in range(40):
        hit = bytearray(data)
        hit[int(noise.integers(first + 3000, len(data)))] ^= 1 << int(noise.integers(8))
        path.write_bytes(hit)
        kept = [(turn.now_ns, turn.arrived) for turn in Recording(path).turns()]
        assert all(turn in turns for turn in kept)


@pytest.mark.usefixtures("fine")
def test_lost_turns_are_counted(tmp_path):
    turns = made.turns(0.5)
    path = write(tmp_path / "run.mcap", turns).path
    data = bytearray(path.read_bytes())
    with path.open("rb") as file:
        chunks = [r for r in StreamReader(file, emit_chunks=True).records if isinstance(r, Chunk)]
    middle = chunks[10].data
    data[data.index(middle) + len(middle) // 2] ^= 0x10
    path.write_bytes(data)
    summary = play(path, tmp_path)
    assert summary["recording"] == {"turns": len(turns) - 1, "missing_turns": 1, "ended": True}


def test_odd_messages_are_kept_too(tmp_path):
    """Infinite, without a time, from before 1970, of another kind than its key says."""
    state = State(
        t_ns=5,
        seq=0,
        lat_deg=0.0,
        lon_deg=0.0,
        alt_m=0.0,
        position_enu_m=(0.0, 0.0, 0.0),
        velocity_enu_mps=(0.0, 0.0, 0.0),
        acceleration_enu_mps2=(0.0, 0.0, 0.0),
        covariance=[0.0] * 45,
        quality=1,
        reset_counter=0,
    )
    odd = [
        ("radar-1", PolarMeasurement(t_ns=1, arrival_ns=2, range_m=float("inf"), azimuth_deg=0.1)),
        ("radar-1", PolarMeasurement(t_ns=-(2**60), arrival_ns=-(2**60), range_m=1.0)),
        ("radar-1", Bad(source="radar-1", where="here", reason="ü\x00", t_ns=None)),
        ("radar-1", state),
        ("ins", AirData(t_ns=3, arrival_ns=4, **dict.fromkeys(AIR.names[2:7], -1.5), coordinated=False)),
    ]
    turns = [(10**18, odd), (10**18 + 5, []), (10**18 - 7, odd)]  # the station's clock steps back
    assert [(t.now_ns, t.arrived) for t in write(tmp_path / "run.mcap", turns).turns()] == turns


@pytest.mark.parametrize("content", [b"", b"\x89MCAP0\r\n", b"what is this" * 100, bytes(10_000)])
def test_what_is_no_recording_is_refused(tmp_path, content):
    path = tmp_path / "run.mcap"
    path.write_bytes(content)
    with pytest.raises(InputError, match=r"run\.mcap"):
        Recording(path)


def test_a_recording_that_is_not_there(tmp_path):
    with pytest.raises(InputError, match="No such file"):
        Recording(tmp_path / "run.mcap")
