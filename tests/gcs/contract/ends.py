"""The other ends of the bus: clients, processes, plain Zenoh, and what they say."""

import contextlib
import json
import subprocess
import sys
import time
from pathlib import Path

import zenoh

from gcs.contract.messages import PolarMeasurement, State
from gcs.contract.wire.bus import Bus

ROOT = Path(__file__).parents[3]
PATIENCE_S = 60.0  # with what must come; a machine may be busy with the other half of the suite


def client(endpoint: str, **options) -> Bus:
    return Bus.open("demo", "uav1", mode="client", endpoint=endpoint, **options)


@contextlib.contextmanager
def process(code: str, *arguments: str):
    """A Python process with the bus imported; killed at the end if it is still there."""
    imports = "import sys, time\nfrom gcs.contract.wire.bus import Bus\nfrom gcs.contract.messages import *\n"
    command = [sys.executable, "-u", "-c", imports + code, *arguments]
    running = subprocess.Popen(command, cwd=ROOT, stdout=subprocess.PIPE, stderr=subprocess.STDOUT, text=True)
    try:
        yield running
    finally:
        running.kill()
        running.wait()
        running.stdout.close()


@contextlib.contextmanager
def plain_zenoh(endpoint: str):
    config = zenoh.Config()
    config.insert_json5("mode", '"client"')
    config.insert_json5("connect/endpoints", json.dumps([endpoint]))
    with zenoh.open(config) as session:
        yield session


def collect(subscription, count: int, seconds: float = PATIENCE_S) -> list:
    """The first ``count`` (source, message) pairs, or fewer after ``seconds``."""
    got, end = [], time.monotonic() + seconds
    while len(got) < count and time.monotonic() < end:
        got += subscription.drain()
    return got


def until(condition, seconds: float = PATIENCE_S) -> bool:
    end = time.monotonic() + seconds
    while not condition() and time.monotonic() < end:
        time.sleep(0.01)
    return condition()


def shot(number: int) -> PolarMeasurement:
    return PolarMeasurement(t_ns=number, arrival_ns=number, range_m=0.5)


def state(seq: int) -> State:
    zeros = (0.0, 0.0, 0.0)
    return State(
        t_ns=seq * 10**9,
        seq=seq,
        lat_deg=-35.5,
        lon_deg=149.25,
        alt_m=600.0,
        position_enu_m=zeros,
        velocity_enu_mps=zeros,
        acceleration_enu_mps2=zeros,
        covariance=[4.0, 0.0, 9.0, 0.0, 0.0, 16.0] + [0.0] * 39,
        quality=87,
        reset_counter=0,
    )
