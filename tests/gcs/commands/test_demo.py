"""The demo and the doctor, as an operator starts them."""

import json
import signal
import socket
import subprocess
import sys
import time
from pathlib import Path

import pytest

from gcs.commands import doctor
from tests.gcs.contract.ends import until

SAMPLE = Path(__file__).resolve().parents[3] / "logs" / "sample"


@pytest.fixture
def ports():
    """Free ports for the bus and the MAVLink link."""
    with socket.socket() as bus, socket.socket(type=socket.SOCK_DGRAM) as link:
        bus.bind(("127.0.0.1", 0))
        link.bind(("127.0.0.1", 0))
        return bus.getsockname()[1], link.getsockname()[1]


@pytest.mark.network
def test_the_demo_flies_live_and_ends(tmp_path, ports):
    """All four feeds arrive over Zenoh, MAVLink over UDP; the run folder is whole, the run replayed."""
    settings = f"bus.endpoint=tcp/127.0.0.1:{ports[0]}", f"mavlink.link=udpin:127.0.0.1:{ports[1]}"
    command = [sys.executable, "-m", "gcs", "demo", "--no-view", "--seconds", "8", "--out", str(tmp_path)]
    done = subprocess.run(
        [*command, "--config", *settings], capture_output=True, text=True, timeout=120, check=False
    )
    assert done.returncode == 0, done.stderr
    summary = json.loads((tmp_path / "summary.json").read_text())
    assert set(summary["verdicts"]) == {"ins", "theo-north", "theo-east", "radar-1"}
    assert all(channels for channels in summary["verdicts"].values())
    assert len((tmp_path / "track.csv").read_text().splitlines()) > 50
    for name in ("run.mcap", "link.tlog"):
        again = tmp_path / name.replace(".", "-")
        command = [sys.executable, "-m", "gcs", "replay", str(tmp_path / name), "--out", str(again)]
        done = subprocess.run(command, capture_output=True, text=True, timeout=120, check=False)
        assert done.returncode == 0, done.stderr
    for name in ("track.csv", "smoothed.csv", "verdicts.csv"):
        assert (tmp_path / "run-mcap" / name).read_bytes() == (tmp_path / name).read_bytes()
    assert (
        json.loads((tmp_path / "link-tlog" / "summary.json").read_text())["verdicts"]["ins"]["e"]["used"] > 10
    )


@pytest.mark.network
@pytest.mark.slow
def test_a_killed_station_leaves_a_recording_and_its_folder(tmp_path, ports):
    """Killed twice with the same command line: two folders, each with a recording that can be replayed."""
    settings = f"bus.endpoint=tcp/127.0.0.1:{ports[0]}", f"mavlink.link=udpin:127.0.0.1:{ports[1]}"
    out = tmp_path / "day"
    command = [sys.executable, "-m", "gcs", "demo", "--no-view", "--out", str(out), "--config", *settings]
    for folder in (out, tmp_path / "day-2"):
        with subprocess.Popen(command, stderr=subprocess.DEVNULL) as running:
            track = folder / "track.csv"
            assert until(lambda track=track: track.exists() and track.stat().st_size > 50_000, 60.0)
            running.kill()
        assert not (folder / "summary.json").exists()
        again = tmp_path / f"{folder.name}-again"
        replay = [sys.executable, "-m", "gcs", "replay", str(folder / "run.mcap"), "--out", str(again)]
        done = subprocess.run(replay, capture_output=True, text=True, timeout=120, check=False)
        assert done.returncode == 0, done.stderr
        told = json.loads((again / "summary.json").read_text())["recording"]
        assert told["turns"] > 50
        assert not told["ended"]
        assert not told["missing_turns"]
        kept = (folder / "track.csv").read_text().splitlines()[:-1]  # the last line may be torn
        played = (again / "track.csv").read_text().splitlines()
        # at the end of the recording rows still waited for others, which the kill has cost
        waiting_ns = int(played[-1].partition(",")[0]) - 500_000_000
        played = [
            line for line in played if not line[0].isdigit() or int(line.partition(",")[0]) < waiting_ns
        ]
        shared = min(len(kept), len(played))
        assert kept[:shared] == played[:shared]
        assert shared > 10


@pytest.mark.network
def test_two_signals_at_once_end_it_cleanly(tmp_path, ports):
    """As a stopped ``make demo`` sends them: one to the group, one from make."""
    settings = f"bus.endpoint=tcp/127.0.0.1:{ports[0]}", f"mavlink.link=udpin:127.0.0.1:{ports[1]}"
    command = [
        sys.executable,
        "-m",
        "gcs",
        "demo",
        "--no-view",
        "--out",
        str(tmp_path),
        "--config",
        *settings,
    ]
    running = subprocess.Popen(command, stderr=subprocess.PIPE, text=True)
    for line in running.stderr:
        if line.startswith("bus:"):
            break
    time.sleep(2.0)
    for _ in range(20):
        running.send_signal(signal.SIGTERM)
    assert running.wait(30) == 0
    running.stderr.close()
    assert (tmp_path / "summary.json").exists()


def test_the_doctor_finds_what_is_wrong(capsys, ports):
    bus = f"bus.endpoint=tcp/127.0.0.1:{ports[0]}"
    assert doctor.run(SAMPLE / "station.toml", (bus, f"view.port={ports[0]}"))
    told = {line.split()[0]: line.split()[-1] for line in capsys.readouterr().err.splitlines()}
    assert told["sensor.radar-1.sigma.range_m"].startswith(str(SAMPLE / "station.toml:"))
    assert (told["bus.endpoint"], told["filter.lag_scans"]) == ("--config", "default")
    assert not doctor.run(None, (bus,))  # no origin
    assert "origin is missing" in capsys.readouterr().err
    with socket.socket() as taken:
        taken.bind(("127.0.0.1", 0))
        taken.listen()
        port = taken.getsockname()[1]
        assert not doctor.run(SAMPLE / "station.toml", (f"bus.endpoint=tcp/127.0.0.1:{port}",))
    assert f"{port}" in capsys.readouterr().err
