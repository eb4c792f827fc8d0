"""The demo: a recorded flight sent again over UDP as its autopilot did, simulated instruments beside it."""

import socket
import threading
import time
from contextlib import ExitStack
from functools import partial
from pathlib import Path
from typing import Annotated

import numpy as np
from cyclopts import Parameter

from bridges import feed
from bridges.instruments import KINDS
from bridges.tlog import flight as tlog_flight
from bridges.tlog import tlog
from bridges.tlog.scan import STAMP
from gcs.commands.compose import open_bus
from gcs.commands.options import Config, stopped
from gcs.commands.serve import serve
from gcs.contract import config as configuration
from gcs.contract.messages import InputError
from gcs.outputs.console import say

SAMPLE = Path(__file__).resolve().parents[1] / "sample"  # of a clone: a link to logs/sample
FLIGHT = SAMPLE / "flight.tlog"
AFTER_S = 2.0  # the last measurements are on their way for less than this


def command(
    *,
    seconds: Annotated[
        float | None, Parameter(help="end after so long; runs until stopped by default")
    ] = None,
    view: Annotated[bool, Parameter(help="show it in the browser")] = True,
    out: Annotated[Path | None, Parameter(help="run folder; logs/runs/<now> by default")] = None,
    config: Config = (),
) -> None:
    """The sample flight with theodolites and a radar, live through Zenoh, in the browser.

    Until the flight is over or ``seconds`` have passed, and with the view until it is stopped.
    """
    stop = stopped()
    if not FLIGHT.is_file():
        raise InputError(f"{FLIGHT}: the sample flight is not here; install the package again")
    resolved = configuration.load(SAMPLE / "station.toml", config)
    say(f"theodolite and radar feeds are simulated from the flight's truth: see {SAMPLE / 'README.md'}")
    feeds = partial(_start, resolved, stop)
    serve(resolved, out, stop, view=view, seconds=seconds, beside=feeds)


def _start(resolved: configuration.Station, stop: threading.Event, stack: ExitStack) -> threading.Event:
    """Start every feed at the same moment of the flight; returns the event that says it is over."""
    log = tlog.read(FLIGHT)
    begin_ns = int(tlog_flight.ins(log, resolved.vehicle.system_id)["t_ns"].min())
    players = [threading.Thread(target=send, args=(log, resolved.mavlink.link, stop), daemon=True)]
    for sensor in resolved.sensor:
        rows, bad = KINDS[sensor.kind].read(SAMPLE / f"{sensor.name}.csv", sensor.name)
        due = feed.timeline(sensor.name, rows, bad)
        bus = stack.enter_context(open_bus(resolved, mode="client"))
        bus.declare_alive(sensor.name)
        players.append(
            threading.Thread(
                target=feed.play, args=(bus, due, stop), kwargs={"begin_ns": begin_ns}, daemon=True
            )
        )
    over = threading.Event()

    def wait() -> None:
        for player in players:
            player.join()
        stop.wait(AFTER_S)
        over.set()

    for thread in (*players, threading.Thread(target=wait, daemon=True)):
        thread.start()
    return over


def send(log: tlog.Tlog, link: str, stop: threading.Event) -> None:
    """Send a log's frames to ``link`` (udpin:HOST:PORT), paced by their receipt stamps."""
    _, host, port = link.split(":")
    due_s = (log.receipt_us - log.receipt_us[0]) / 1e6
    begins = log.frames["offset"]
    ends = np.append(begins[1:] - STAMP, log.data.size)  # the sample is undamaged: record follows record
    data = log.data.tobytes()
    started = time.monotonic()
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as radio:
        for due, begin, end in zip(due_s.tolist(), begins.tolist(), ends.tolist(), strict=True):
            wait = due - (time.monotonic() - started)
            if wait > 0 and stop.wait(wait):
                return
            radio.sendto(data[begin:end], (host, int(port)))
