"""One source gone wild: wrong, well-formed values by the thousand a second, beside two that are well.

A station in a process of its own, three bridges, a plain subscriber, on loopback. What the other two lose,
how late their states come, what memory it costs and how long the station takes to end is printed.
"""

import json
import os
import signal
import subprocess
import sys
import tempfile
import time
from pathlib import Path

import numpy as np

from bench.speed import live
from gcs.contract.messages import PolarMeasurement
from gcs.contract.wire.bus import Bus

WILD = "radar-1"
CALM_S, AFTER_S = 15.0, 5.0  # before the flood, for comparison; after it
FIRST_S = 5.0  # of the calm, that are not counted: the start
RSS_S = 0.5


def pour(rate_hz: float, seconds: float) -> None:
    """Put wrong values of the wild source: somewhere else each time, all of them possible."""
    rng = np.random.default_rng(1)
    with Bus.open("demo", "uav1", mode="client", endpoint=live.ENDPOINT) as bus:
        bus.declare_alive(WILD)
        begin, number = time.monotonic(), 0
        while (gone := time.monotonic() - begin) < seconds:
            for _ in range(int(gone * rate_hz) - number):
                number += 1
                far, turn, up = rng.uniform((100.0, 0.0, 0.0), (9000.0, 360.0, 80.0)).tolist()
                t_ns = time.time_ns() // 1000 * 1000 + 1  # theirs end in 000: told apart by this
                wrong = {"range_m": far, "azimuth_deg": turn, "elevation_deg": up}
                bus.publish("raw", PolarMeasurement(t_ns=t_ns, arrival_ns=t_ns, **wrong), WILD)
            time.sleep(0.001)
        print(number, flush=True)


def soak(rate_hz: float, seconds: float) -> str:
    """Run it and return the report."""
    me = [sys.executable, "-m", "bench", "flood", "--rate-hz", str(rate_hz)]
    bridge = [sys.executable, "-m", "bench", "live", "--seconds", str(CALM_S + seconds + AFTER_S), "--role"]
    received: list[tuple[int, bytes]] = []
    events: list[str] = []
    with tempfile.TemporaryDirectory() as folder:
        station_file = Path(folder, "station.toml")
        station_file.write_text(live.STATION)
        command = ["-m", "gcs", "run", "--no-view", "--station", str(station_file), "--out", f"{folder}/run"]
        station = subprocess.Popen([sys.executable, *command])
        try:
            with live.connect() as session:
                session.declare_subscriber(
                    "demo/uav1/state",
                    lambda sample: received.append((time.time_ns(), sample.payload.to_bytes())),
                )
                session.declare_subscriber(
                    "demo/uav1/event",
                    lambda sample: events.append(json.loads(sample.payload.to_bytes())["text"]),
                )
                time.sleep(3.0)
                others = [subprocess.Popen([*bridge, name]) for name in live.RATES_HZ if name != WILD]
                began_ns, rss = time.time_ns(), [_rss(station, CALM_S)]
                wild = subprocess.Popen([*me, "--seconds", str(seconds), "--role"], stdout=subprocess.PIPE)
                flood_ns = time.time_ns()
                rss += [_rss(station, seconds), _rss(station, AFTER_S)]
                poured = int(wild.communicate(timeout=60)[0])
                for running in others:
                    running.wait(60)
                time.sleep(1.0)
        finally:
            asked = time.monotonic()
            station.send_signal(signal.SIGINT)
            station.wait(120)
        ended_s = time.monotonic() - asked
        summary = json.loads(Path(folder, "run", "summary.json").read_text())
    states = [(arrival_ns, json.loads(payload)["t_ns"]) for arrival_ns, payload in received]
    theirs = np.array([s for s in states if s[1] % 1000 == 0])
    late_ms = (theirs[:, 0] - theirs[:, 1]) / 1e6
    end_ns = flood_ns + round(seconds * 1e9)
    calm = (theirs[:, 1] > began_ns + FIRST_S * 1e9) & (theirs[:, 1] < flood_ns)
    during = (theirs[:, 1] >= flood_ns) & (theirs[:, 1] < end_ns)
    counts = {name: _lines(channels) for name, channels in summary["verdicts"].items()}
    due = {n: round((CALM_S + seconds + AFTER_S) * r) for n, r in live.RATES_HZ.items() if n != WILD}
    return (
        f"flood of {poured} messages in {seconds:g} s on {WILD}; in the summary {counts[WILD]}\n"
        f"others, put and in the summary: {', '.join(f'{n} {due[n]} {counts[n]}' for n in due)}\n"
        f"their states, put to received: calm {_latency(late_ms[calm])}; flood {_latency(late_ms[during])}\n"
        f"memory: calm {rss[0]:.0f} MB, flood {rss[1] - rss[0]:+.0f} MB, after {rss[2] - rss[0]:+.0f} MB\n"
        f"ended {ended_s:.1f} s after SIGINT; events: {'; '.join(events)}"
    )


def _rss(station: subprocess.Popen, seconds: float) -> float:
    """The largest resident memory within so many seconds, MB."""
    end, most = time.monotonic() + seconds, 0.0
    while time.monotonic() < end:
        time.sleep(RSS_S)
        most = max(most, resident_mb(station.pid))
    return most


def resident_mb(pid: int) -> float:
    """Resident memory of a process, MB."""
    pages = int(Path(f"/proc/{pid}/statm").read_text().split()[1])
    return pages * os.sysconf("SC_PAGE_SIZE") / 1e6


def _lines(channels: dict) -> int:
    """Measurements by the count of their first channel, and lines that stand for several."""
    first = next((sum(c.values()) for name, c in channels.items() if name != "line"), 0)
    return first + sum(channels.get("line", {}).values())


def _latency(ms: np.ndarray) -> str:
    if not len(ms):
        return "none"
    p50, p99 = np.percentile(ms, (50, 99))
    return f"p50 {p50:.1f}, p99 {p99:.1f}, worst {ms.max():.1f} ms of {len(ms)}"
