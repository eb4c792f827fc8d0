"""``python -m bench recording``: what the recording costs, and what a killed station leaves.

The demo, live, for some time: the size of its recording, the tables of its replay beside the live ones, and
the time that its turns take to be encoded and written again. Then the demo killed with SIGKILL at random
instants: the recording's last turn tells what was lost, and a replay whether the rest can be used.
"""

import filecmp
import random
import signal
import subprocess
import sys
import tempfile
import time
from pathlib import Path

from mcap.reader import make_reader

from bridges.tlog import tlog
from gcs.commands.demo import FLIGHT
from gcs.contract import config
from gcs.contract.messages import InputError
from gcs.outputs.console import say
from gcs.outputs.disk import RunFile, to_operator
from gcs.outputs.recording import McapFile
from gcs.station.sources.recording import RECORDING, STATION, Recording

TABLES = ("track.csv", "smoothed.csv", "verdicts.csv", "separation.csv")
PORTS = "bus.endpoint=tcp/127.0.0.1:21447", "mavlink.link=udpin:127.0.0.1:21550"
GCS = [sys.executable, "-m", "gcs"]


def run(seconds: float, kills: int, seed: int = 1) -> None:
    """All three, one line each. Raises ``InputError`` for more seconds than the sample flight has."""
    log = tlog.read(FLIGHT)
    longest_s = (int(log.receipt_us[-1]) - int(log.receipt_us[0])) / 1e6
    if seconds > longest_s:
        raise InputError(f"--seconds {seconds:g}: the sample flight has {longest_s:.0f} s")
    with tempfile.TemporaryDirectory() as folder:
        whole = Path(folder, "whole")
        subprocess.run([*demo(whole), "--seconds", str(seconds)], check=True, capture_output=True)
        say(size(whole))
        say(f"replay of it: {', '.join(replayed(whole, Path(folder, 'again')))} the same, byte by byte")
        say(cost(whole, Path(folder, "cost")))
        noise, lost = random.Random(seed), []
        for number in range(kills):
            lost.append(kill(Path(folder, f"killed-{number}"), noise.uniform(3.0, 9.0)))
            say(f"kill {number + 1}: {lost[-1][0]:.2f} s lost, {lost[-1][1]} turns left, replayed")
        if lost:
            say(f"{kills} kills: at most {max(lost)[0]:.2f} s of the recording lost")


def demo(out: Path) -> list[str]:
    return [*GCS, "demo", "--no-view", "--out", str(out), "--config", *PORTS]


def size(folder: Path) -> str:
    """Megabytes an hour of each file, and messages by topic."""
    path = folder / RECORDING
    with path.open("rb") as file:
        summary = make_reader(file).get_summary()
    assert summary is not None
    assert summary.statistics is not None
    told = summary.statistics
    hours = (told.message_end_time - told.message_start_time) / 3.6e12
    counts = ", ".join(
        f"{summary.channels[channel].topic} {count}"
        for channel, count in sorted(told.channel_message_counts.items())
    )
    sizes = ", ".join(f"{p.name} {p.stat().st_size / 1e6 / hours:.0f}" for p in sorted(folder.iterdir()))
    return f"MB an hour: {sizes}; messages: {counts}"


def replayed(folder: Path, out: Path) -> list[str]:
    """The tables that a replay writes byte by byte as the live run did."""
    command = [*GCS, "replay", str(folder / RECORDING), "--out", str(out)]
    subprocess.run(command, check=True, capture_output=True)
    return [name for name in TABLES if filecmp.cmp(folder / name, out / name, shallow=False)]


def cost(folder: Path, out: Path) -> str:
    """Microseconds a message to encode and write what came in."""
    turns = list(Recording(folder / RECORDING).turns())
    about = {"version": "bench", "method": "default", "correction": "off"}
    out.mkdir()
    written = McapFile(RunFile(out / RECORDING, to_operator), config.load(folder / STATION), about)
    begun = time.perf_counter()
    for turn in turns:
        written.turn(turn.number, turn.now_ns, turn.arrived)
    took_s = time.perf_counter() - begun
    written.end_sync()
    written.end()
    count, flight_s = sum(len(turn.arrived) for turn in turns), (turns[-1].now_ns - turns[0].now_ns) / 1e9
    share = f"{1e6 * took_s / count:.0f} µs a message, {100 * took_s / flight_s:.2f} % of a core"
    return f"{count} messages in {len(turns)} turns of {flight_s:.0f} s, encoded and written: {share}"


def kill(out: Path, after_s: float) -> tuple[float, int]:
    """The demo killed so long after its first state; returns what the recording lacks in s, its turns."""
    with subprocess.Popen(demo(out), stderr=subprocess.DEVNULL) as running:
        track = out / "track.csv"
        while not track.exists() or track.stat().st_size < 1000:
            time.sleep(0.05)
        time.sleep(after_s)
        killed_ns = time.time_ns()
        running.send_signal(signal.SIGKILL)
    last_ns, count = 0, 0
    for turn in Recording(out / RECORDING).turns():
        last_ns, count = turn.now_ns, count + 1
    replay = [*GCS, "replay", str(out / RECORDING), "--out", str(out.with_name(out.name + "-again"))]
    subprocess.run(replay, check=True, capture_output=True)
    return (killed_ns - last_ns) / 1e9, count
