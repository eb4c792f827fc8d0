"""``gcs replay run.mcap``: the run as it was flown, or with another method, setting or station."""

import contextlib
import json
import sys

import numpy as np
import pytest

from gcs.commands import replay as replaying
from gcs.commands.cli import main
from gcs.contract import messages
from gcs.outputs.recording import RunRecorder
from gcs.station.session import Session
from tests.gcs.station import made


@pytest.fixture(scope="module")
def live(tmp_path_factory):
    """A run folder, flown with a method of its own."""
    folder = tmp_path_factory.mktemp("live")
    station, frame = made.station()
    recorder = RunRecorder(folder, station, frame, lambda *_: None, made.ABOUT | {"method": "igg"})
    session = Session(station, frame, [recorder], "igg")
    made.fly(session, made.turns(1.5), recorder.turn)
    recorder.end()
    return folder


@pytest.fixture
def replay(monkeypatch, tmp_path, live, capsys):
    """Runs the command; gives the run folder and what the operator was told."""

    def replay(*options, code: int = 0):
        out = tmp_path / "run"
        arguments = ["gcs", "replay", live / "run.mcap", "--out", out, *options]
        monkeypatch.setattr(sys, "argv", list(map(str, arguments)))
        with pytest.raises(SystemExit) as left:
            main()
        assert (left.value.code or 0) == code
        told = capsys.readouterr().err
        return out, told

    return replay


def summary(folder) -> dict:
    return json.loads((folder / "summary.json").read_text())


def test_as_it_was_flown(live, replay):
    out, told = replay()
    for name in ("track.csv", "smoothed.csv", "verdicts.csv", "separation.csv", "station.toml"):
        assert (out / name).read_bytes() == (live / name).read_bytes(), name
    assert summary(out)["settings"] == summary(live)["settings"]
    assert f"run folder: {out}" in told


def test_with_another_method_and_setting(live, replay):
    out, _ = replay("--method", "default", "--config", "ins.height_m=7.5")
    settings = summary(out)["settings"]
    assert settings["method"] == "default"
    assert settings["station"]["ins"]["height_m"] == 7.5
    before, after = (np.genfromtxt(folder / "track.csv", delimiter=",", names=True) for folder in (live, out))
    assert len(after) > 10
    assert np.median(after["sigma_u_m"]) != np.median(before["sigma_u_m"])


def test_with_another_station(live, replay, tmp_path):
    """The radar is not in it: what it sent is counted as a stranger's."""
    text = (made.SAMPLE / "station.toml").read_text().replace('name = "radar-1"', 'name = "radar-9"')
    (tmp_path / "station.toml").write_text(text)
    out, _ = replay("--station", tmp_path / "station.toml")
    told = summary(out)
    assert set(told["verdicts"]) == {"ins", "theo-north", "theo-east", "radar-9"}
    assert told["unknown_sources"]["radar-1"] > 10
    assert not told["verdicts"]["radar-9"]


def test_an_earlier_replay_stays(live, replay):
    out, _ = replay()
    first = (out / "summary.json").read_bytes()
    _, told = replay("--method", "default")
    assert f"this run goes into {out}-2" in told
    assert (out / "summary.json").read_bytes() == first
    assert summary(out.with_name("run-2"))["settings"]["method"] == "default"


def test_at_a_given_speed_it_is_the_same(live, replay):
    out, _ = replay("--speed", "20")
    assert (out / "verdicts.csv").read_bytes() == (live / "verdicts.csv").read_bytes()


def test_feeds_are_in_the_recording(replay):
    _, told = replay("--feed", "radar-1=radar-1.csv", code=2)
    assert "holds its feeds already" in told
    assert told.count("\n") == 1


class ToldBus:
    """Keeps what is told and what can be asked for."""

    def __init__(self):
        self.told, self.asked = {}, {}

    def publish(self, subject, message, source=""):
        self.told[subject] = message

    def serve(self, subject, reply):
        self.asked[subject] = reply


def test_who_follows_a_replay_on_the_bus_is_told_the_scene(monkeypatch, tmp_path):
    def run(_flight, session, _playback, **_):
        session()
        return {"complete": True}

    bus = ToldBus()
    monkeypatch.setattr(replaying, "open_bus", lambda _station: contextlib.nullcontext(bus))
    monkeypatch.setattr(replaying.driver, "run", run)
    sample = made.SAMPLE / "flight.tlog"
    feeds = tuple(f"{name}={path}" for name, path in made.FEEDS.items())
    replaying.command(sample, station=made.SAMPLE / "station.toml", feed=feeds, publish=True, out=tmp_path)
    assert {one.name for one in bus.told["scene"].instruments} == set(made.FEEDS)
    assert messages.decode(*bus.asked["scene"]()) == bus.told["scene"]
    assert "schema" in bus.asked
