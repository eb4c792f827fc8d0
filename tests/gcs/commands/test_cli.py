"""The command line with bad input: one line that names file, line and remedy, exit code 2, no traceback."""

import json
import os
import re
import socket
import subprocess
import sys
from pathlib import Path

import pytest

from gcs.commands.cli import main

SAMPLE = Path(__file__).resolve().parents[3] / "logs" / "sample"
FLIGHT, STATION, FEED = SAMPLE / "flight.tlog", SAMPLE / "station.toml", SAMPLE / "theo-north.csv"


@pytest.fixture
def refused(monkeypatch, capsys):
    """Gives the one line that a refusal prints."""

    def refused(*arguments) -> str:
        monkeypatch.setattr(sys, "argv", ["gcs", *map(str, arguments)])
        with pytest.raises(SystemExit) as left:
            main()
        lines = capsys.readouterr().err.strip().splitlines()
        assert left.value.code == 2, lines
        assert len(lines) == 1, lines
        assert lines[0].startswith("gcs: ")
        return lines[0]

    return refused


@pytest.fixture
def station(tmp_path):
    """Writes the sample's station file with a change."""

    def write(old: str = "", new: str = "") -> Path:
        text = STATION.read_text(encoding="utf-8")
        assert old in text
        path = tmp_path / "station.toml"
        path.write_text(text.replace(old, new, 1), encoding="utf-8")
        return path

    return write


def test_logs_that_are_none(refused, tmp_path):
    assert "no such file" in refused("replay", tmp_path / "nowhere.tlog")
    empty = tmp_path / "empty.tlog"
    empty.touch()
    assert "empty" in refused("replay", empty)
    picture = tmp_path / "picture.tlog"
    picture.write_bytes(b"\x89PNG\r\n\x1a\n" + bytes(range(256)) * 40)
    assert str(picture) in refused("replay", picture)


def test_station_files_that_are_wrong(refused, station):
    assert "station.toml:" in refused("replay", FLIGHT, "--station", station("estimate", "estmate"))
    assert "lat_deg" in refused("replay", FLIGHT, "--station", station("lat_deg = -35.", "lat_deg = 95."))


def test_feeds_that_are_wrong(refused, tmp_path):
    line = refused("replay", FLIGHT, "--station", STATION, "--feed", f"theo-west={FEED}")
    assert "theo-west" in line
    assert "theo-north" in line
    header = tmp_path / "header.csv"
    header.write_text(FEED.read_text().replace("azimuth_deg", "azimut", 1))
    assert "header.csv:1" in refused("replay", FLIGHT, "--station", STATION, "--feed", f"theo-north={header}")


def test_a_feed_in_radians_is_called_so(refused, tmp_path):
    lines = FEED.read_text().splitlines()
    at = lines[0].split(",").index("azimuth_deg")
    changed = [lines[0]]
    for line in lines[1:]:
        fields = line.split(",")
        for column in (at, at + 1):
            fields[column] = str(float(fields[column]) * 3.141592653589793 / 180) if fields[column] else ""
        changed.append(",".join(fields))
    path = tmp_path / "radians.csv"
    path.write_text("\n".join(changed))
    line = refused(
        "replay", FLIGHT, "--station", STATION, "--feed", f"theo-north={path}", "--out", tmp_path / "run"
    )
    assert "radians" in line


def test_a_feed_of_another_day_is_called_so(refused, tmp_path):
    path = tmp_path / "yesterday.csv"
    path.write_text("t,range_m,azimuth_deg,elevation_deg\n1500000000.0,800.0,10.0,20.0\n")
    line = refused(
        "replay", FLIGHT, "--station", STATION, "--feed", f"theo-north={path}", "--out", tmp_path / "run"
    )
    assert "clock" in line


def test_usage(refused):
    assert "speed" in refused("replay", FLIGHT, "--speed", "fast")
    assert "sped" in refused("replay", FLIGHT, "--sped", "1")
    assert "method" in refused("replay", FLIGHT, "--method", "magic")
    assert "KEY=VALUE" in refused("replay", FLIGHT, "--config", "height")


@pytest.mark.parametrize("speed", ["1e300", "nan", "0", "-1", "inf"])
def test_speeds_that_cannot_be(refused, speed):
    assert "--speed" in refused("replay", FLIGHT, "--speed", speed)


@pytest.mark.parametrize("seconds", ["1e300", "nan", "0"])
def test_durations_that_cannot_be(refused, seconds):
    assert "--seconds" in refused("run", "--station", STATION, "--no-view", "--seconds", seconds)


def test_folders_that_cannot_be_written(refused, tmp_path):
    (tmp_path / "file").touch()
    for out in (tmp_path / "file", tmp_path / "file" / "below"):
        assert f"--out {out}" in refused("replay", FLIGHT, "--out", out)
        assert f"--out {out}" in refused("run", "--station", STATION, "--no-view", "--out", out)


def test_settings_that_cannot_be(refused):
    for setting in ("filter.cell_s=0", "filter.lag_scans=abc", "ins.height_m=1e-300", "view.port=99999"):
        assert f"--config {setting}: " in refused("replay", FLIGHT, "--config", setting)


def test_feeds_alone_need_an_origin(refused, tmp_path):
    text = STATION.read_text(encoding="utf-8")
    (tmp_path / "station.toml").write_text(re.sub("(?m)^origin.*$", "", text), encoding="utf-8")
    feeds = ("--feed", f"theo-north={FEED}", "--out", tmp_path / "run")
    assert "[range] origin" in refused("replay", "--station", tmp_path / "station.toml", *feeds)
    assert "nothing to replay" in refused("replay", "--station", STATION, "--out", tmp_path / "run")


def test_ports_that_are_taken(refused, tmp_path):
    with socket.socket() as taken:
        taken.bind(("127.0.0.1", 0))
        taken.listen()
        port = taken.getsockname()[1]
        view = refused("replay", FLIGHT, "--view", "--config", f"view.port={port}", "--out", tmp_path)
        assert str(port) in view
        bus = f"bus.endpoint=tcp/127.0.0.1:{port}"
        assert str(port) in refused(
            "run", "--station", STATION, "--no-view", "--config", bus, "--out", tmp_path
        )


@pytest.mark.network
def test_no_router(refused, tmp_path):
    with socket.socket() as free:
        free.bind(("127.0.0.1", 0))
        port = free.getsockname()[1]
    options = ("--publish", "--config", "bus.mode=client", f"bus.endpoint=tcp/127.0.0.1:{port}")
    assert "no Zenoh router" in refused("replay", FLIGHT, *options, "--out", tmp_path)


def test_a_refusal_leaves_no_traceback():
    """The same through the real command."""
    command = [sys.executable, "-m", "gcs", "replay", "nowhere.tlog"]
    done = subprocess.run(command, capture_output=True, text=True, timeout=60, check=False)
    assert done.returncode == 2
    assert done.stderr.count("\n") == 1


def test_screen_writes_beside_what_it_was_given(monkeypatch, capsys, tmp_path):
    monkeypatch.setattr(sys, "argv", ["gcs", "screen", str(FEED), "--out", str(tmp_path)])
    with pytest.raises(SystemExit) as left:
        main()
    assert not left.value.code
    assert "azimuth" in capsys.readouterr().err
    written = {path.name for path in tmp_path.iterdir()}
    assert written == {"theo-north.cleaned.csv", "theo-north.flags.csv", "theo-north.svg"}


def test_screen_refuses_what_is_no_feed(refused, tmp_path):
    assert "No such file" in refused("screen", tmp_path / "nothing.csv")
    assert "median" in refused("screen", FEED, "--out", tmp_path, "--method", "median")


def test_recordings_that_are_none(refused, tmp_path):
    nothing = tmp_path / "run.mcap"
    assert f"{nothing}: No such file" in refused("replay", nothing)
    nothing.write_bytes(b"\x89MCAP0\r\n")
    assert "no recording of a run" in refused("replay", nothing)


def test_a_replay_whose_folder_is_incomplete_has_failed(monkeypatch, capsys, tmp_path):
    """The disk does not take the track."""
    out = tmp_path / "run"
    arguments = ["gcs", "replay", "--station", STATION, "--feed", f"theo-north={FEED}", "--out", out]
    monkeypatch.setattr(sys, "argv", list(map(str, arguments)))
    monkeypatch.setattr("gcs.outputs.disk.LAST_TRY_S", 0.0)
    full = Path("/dev/full")
    open_file = os.open
    monkeypatch.setattr(
        "gcs.outputs.disk.os.open",
        lambda path, flags, mode: open_file(full if Path(path).name == "track.csv" else path, flags, mode),
    )
    with pytest.raises(SystemExit) as left:
        main()
    assert left.value.code == 1
    told = capsys.readouterr().err
    assert "missing rows: track.csv" in told
    assert "track.csv" in json.loads((out / "summary.json").read_text())["not_written"]
