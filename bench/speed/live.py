"""Live latency with real processes: three bridges, a station, a plain Zenoh subscriber, on loopback.

    python bench/speed/live.py --seconds 600 -- gcs run --station {station} --no-view --seconds 620

The command after ``--`` is the station; ``{station}`` becomes a station file that fits. Without one, an
echo stands in that answers each measurement with a state at once, so the bus alone is measured.
The time of a measurement is the instant it was put; its state carries that time.
"""

import itertools
import json
import math
import random
import signal
import subprocess
import sys
import tempfile
import time
from pathlib import Path

import pymap3d
import zenoh

from gcs.contract.messages import InsMeasurement, PolarMeasurement, State
from gcs.contract.wire.bus import Bus

FIRST_S = 10.0  # of the start, not counted
LAST_S = 1.0  # nor of the end: what is newest then waits for sources that have ended, as long as hold_s
ENDPOINT = "tcp/127.0.0.1:17447"
ORIGIN = (-35.363261, 149.16523, 584.0)
RATES_HZ = {"ins": 50.0, "theo-north": 20.0, "radar-1": 20.0}
SITES = {
    "theo-north": (-35.34982, 149.16155, 612.0),
    "theo-east": (-35.36, 149.172, 600.0),
    "theo-south": (-35.3710, 149.1700, 600.0),
    "radar-1": (-35.3714, 149.1586, 589.0),
}
SIGMA = {  # range metres; angles degrees
    "theo-north": (1.0, 0.003),
    "theo-east": (1.0, 0.003),
    "theo-south": (1.0, 0.003),
    "radar-1": (5.0, 0.05),
}
STATION = f"""
[range]
name = "demo"
origin = {{ lat_deg = {ORIGIN[0]}, lon_deg = {ORIGIN[1]}, alt_m = {ORIGIN[2]} }}
[mavlink]
link = ""
[bus]
endpoint = "{ENDPOINT}"
[[sensor]]
name = "theo-north"
kind = "theodolite"
position = {{ lat_deg = -35.34982, lon_deg = 149.16155, alt_m = 612.0 }}
[[sensor]]
name = "radar-1"
kind = "radar"
position = {{ lat_deg = -35.3714, lon_deg = 149.1586, alt_m = 589.0 }}
"""


def measure(name: str, t_ns: int, noise: random.Random) -> InsMeasurement | PolarMeasurement:
    """What ``name`` sees of an aircraft on a circle: radius 400 m, 20 m/s, 200 m above the origin."""
    turn = 20.0 / 400.0 * (t_ns / 1e9 % 1e5)
    e, n = 400.0 * math.sin(turn), 400.0 * math.cos(turn)
    lat, lon, alt = pymap3d.enu2geodetic(e, n, 200.0, *ORIGIN)
    if name == "ins":
        velocity = {"ve_mps": 20.0 * math.cos(turn), "vn_mps": -20.0 * math.sin(turn), "vu_mps": 0.0}
        place = {"lat_deg": float(lat), "lon_deg": float(lon), "alt_msl_m": float(alt)}
        return InsMeasurement(t_ns=t_ns, arrival_ns=t_ns, geoid_separation_m=0.0, **place, **velocity)
    azimuth, elevation, distance = map(float, pymap3d.geodetic2aer(lat, lon, alt, *SITES[name]))
    range_m, angle_deg = SIGMA[name]
    return PolarMeasurement(
        t_ns=t_ns,
        arrival_ns=t_ns,
        range_m=distance + noise.gauss(0.0, range_m),
        azimuth_deg=azimuth + noise.gauss(0.0, angle_deg),
        elevation_deg=elevation + noise.gauss(0.0, angle_deg),
    )


def bridge(name: str, seconds: float) -> None:
    """Put measurements of one source at its rate."""
    noise, period_s = random.Random(name), 1.0 / RATES_HZ[name]
    with Bus.open("demo", "uav1", mode="client", endpoint=ENDPOINT) as bus:
        bus.declare_alive(name)
        begin = time.monotonic()
        for number in range(int(seconds * RATES_HZ[name])):
            time.sleep(max(0.0, begin + number * period_s - time.monotonic()))
            bus.publish("raw", measure(name, time.time_ns() // 1000 * 1000, noise), name)


def echo() -> None:
    """A station that thinks nothing: one state for each measurement."""
    zeros, seq = (0.0, 0.0, 0.0), 0
    with Bus.open("demo", "uav1", endpoint=ENDPOINT) as bus:
        raw = bus.subscribe("raw/*")
        while True:
            for _, measurement in raw.drain():
                state = State(
                    t_ns=measurement.t_ns,
                    seq=seq,
                    lat_deg=ORIGIN[0],
                    lon_deg=ORIGIN[1],
                    alt_m=ORIGIN[2],
                    position_enu_m=zeros,
                    velocity_enu_mps=zeros,
                    acceleration_enu_mps2=zeros,
                    covariance=[1.0 / 3.0] * 45,
                    quality=100,
                    reset_counter=0,
                )
                bus.publish("state", state)
                seq += 1


def connect() -> zenoh.Session:
    """A plain Zenoh session to the station, as soon as it listens."""
    config = zenoh.Config()
    config.insert_json5("mode", '"client"')
    config.insert_json5("connect/endpoints", json.dumps([ENDPOINT]))
    config.insert_json5("connect/timeout_ms", "120000")
    return zenoh.open(config)


def report(received: list[tuple[int, bytes]], seconds: float) -> str:
    """One paragraph: states received, gaps in their order, latency from measurement put to state received."""
    states = [(arrival_ns, json.loads(payload)) for arrival_ns, payload in received]
    if not states:
        return "no state came: is the filter still compiling? once it is, ask again"
    numbers = [state["seq"] for _, state in states]
    gaps = sum(after != before + 1 for before, after in itertools.pairwise(numbers))
    begin_ns = states[0][1]["t_ns"] + round(FIRST_S * 1e9)
    end_ns = states[-1][1]["t_ns"] - round(LAST_S * 1e9)
    counted = [(at, state["t_ns"]) for at, state in states if begin_ns < state["t_ns"] < end_ns]
    found = sorted((arrival_ns - t_ns) / 1e6 for arrival_ns, t_ns in counted)
    p50, p99, worst = (found[int(share * (len(found) - 1))] for share in (0.5, 0.99, 1.0))
    expected = int(sum(seconds * rate for rate in RATES_HZ.values()))
    return (
        f"{expected} measurements put; {len(states)} states received, numbers {numbers[0]} to {numbers[-1]}, "
        f"{gaps} out of order, missing or twice\n"
        f"latency put to received after {FIRST_S:g} s, n = {len(found)}: "
        f"p50 {p50:.2f} ms, p99 {p99:.2f} ms, worst {worst:.2f} ms"
    )


def soak(seconds: float, command: list[str]) -> str:
    """Run all processes and return the report."""
    me = [sys.executable, "-m", "bench", "live"]
    received: list[tuple[int, bytes]] = []
    with tempfile.TemporaryDirectory() as folder:
        station_file = Path(folder, "station.toml")
        station_file.write_text(STATION)
        middle = [part.format(station=station_file) for part in command] or [*me, "--role", "echo"]
        station = subprocess.Popen(middle, cwd=folder if command else None)
        try:
            with connect() as session:
                subscriber = session.declare_subscriber(
                    "demo/uav1/state",
                    lambda sample: received.append((time.time_ns(), sample.payload.to_bytes())),
                )
                time.sleep(1.0)
                role = ["--seconds", str(seconds), "--role"]
                bridges = [subprocess.Popen([*me, *role, name]) for name in RATES_HZ]
                for running in bridges:
                    running.wait()
                time.sleep(1.0)
                subscriber.undeclare()
        finally:
            station.send_signal(signal.SIGINT)
            station.wait(30)
    return report(received, seconds)
