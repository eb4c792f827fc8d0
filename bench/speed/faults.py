"""Parts of a running range killed, stopped and started again, each at a random instant, as often as asked.

Bridges and station are processes of their own; a client with history watches. For every fault: how long until
an event told of it, how long until all was as before, and which states the client never got.
"""

import contextlib
import itertools
import os
import random
import signal
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable, Iterator
from pathlib import Path

import numpy as np

from bench.speed import live
from gcs.contract.messages import Event, State
from gcs.contract.wire.bus import Bus

VICTIM = "theo-north"
BETWEEN_S = 3.0, 5.0  # faults are so far apart, at random
PATIENCE_S = 30.0
RUNS_S = 3_600.0  # of a bridge, longer than all of it


class Range:
    """The processes, and what the client has heard of them."""

    def __init__(self, folder: Path, bus: Bus):
        self._folder, self._runs = folder, 0
        self._told = bus.subscribe("state", "event")
        self.events: list[tuple[float, str]] = []
        self.states: list[tuple[float, State]] = []
        self.running: dict[str, subprocess.Popen] = {}

    def start(self, name: str) -> None:
        if name == "station":
            self._runs += 1
            file, out = self._folder / "station.toml", self._folder / f"run-{self._runs}"
            command = ["-m", "gcs", "run", "--no-view", "--station", str(file), "--out", str(out)]
            command += ["--config", "bus.mode=client"]
        elif name == "router":
            command = ["-c", ROUTER, live.ENDPOINT]
        else:
            command = ["-m", "bench", "live", "--seconds", str(RUNS_S), "--role", name]
        self.running[name] = subprocess.Popen([sys.executable, *command], stderr=subprocess.DEVNULL)

    def kill(self, name: str, number: int = signal.SIGKILL) -> None:
        self.running[name].send_signal(number)
        if number == signal.SIGKILL:
            self.running[name].wait()

    def listen(self, seconds: float, until: Callable[[], bool] = lambda: False) -> float | None:
        """Take in what is told; returns after how long ``until`` became true, None if it did not."""
        begin = time.monotonic()
        while (gone := time.monotonic() - begin) < seconds:
            for _, message in self._told.drain(0.05):
                if isinstance(message, Event):
                    self.events.append((time.monotonic(), message.text))
                elif isinstance(message, State):
                    self.states.append((time.monotonic(), message))
            if until():
                return gone
        return None

    def heard(self, since: float, *words: str) -> bool:
        return any(t >= since and VICTIM in text and any(w in text for w in words) for t, text in self.events)

    def sees(self, since: float, name: str = VICTIM) -> bool:
        """Has a state come since then that has a fresh measurement of ``name`` in it?"""
        return any(t >= since and s.age_s.get(name, 9.0) < 0.2 for t, s in self.states[-200:])


ROUTER = """
import sys, threading
from gcs.contract.wire.bus import Bus
with Bus.open("demo", "router", endpoint=sys.argv[1]):
    threading.Event().wait()
"""


def run(times: int, seed: int = 1) -> str:
    """All faults, ``times`` each; the report."""
    rng, lines = random.Random(seed), []
    with tempfile.TemporaryDirectory() as folder, contextlib.ExitStack() as stack:
        Path(folder, "station.toml").write_text(live.STATION)
        stack.enter_context(_environment())
        router = subprocess.Popen([sys.executable, "-c", ROUTER, live.ENDPOINT])
        stack.callback(router.kill)
        bus = Bus.open("demo", "uav1", mode="client", endpoint=live.ENDPOINT, waiting=lambda _line: True)
        scene = Range(Path(folder), stack.enter_context(bus))
        scene.running["router"] = router
        stack.callback(lambda: [process.kill() for process in scene.running.values()])
        for name in ("station", *live.RATES_HZ):
            scene.start(name)
        if scene.listen(120.0, lambda: scene.sees(0.0)) is None:
            return "no state came: the station did not start"
        for fault in (_bridge_killed, _bridge_stopped, _station_killed, _router_away):
            found = []
            for _ in range(times):
                scene.listen(rng.uniform(*BETWEEN_S))
                found.append(fault(scene))
            lines.append(_line(fault.__doc__ or "", found))
        scene.listen(2.0)
        lost = _lost([state.seq for _, state in scene.states])
        lines.append(f"states: {len(scene.states)} received, {lost} missing between those of one station")
    return "\n".join(lines)


def _bridge_killed(scene: Range) -> tuple[float | None, float | None]:
    """bridge killed and started again"""
    began = time.monotonic()
    scene.kill(VICTIM)
    told = scene.listen(PATIENCE_S, lambda: scene.heard(began, "gone", "silent"))
    scene.start(VICTIM)
    return told, _recovery(scene, VICTIM)


def _bridge_stopped(scene: Range) -> tuple[float | None, float | None]:
    """bridge stopped by SIGSTOP and let go on"""
    began = time.monotonic()
    scene.kill(VICTIM, signal.SIGSTOP)
    told = scene.listen(PATIENCE_S, lambda: scene.heard(began, "gone", "silent"))
    scene.kill(VICTIM, signal.SIGCONT)
    again = time.monotonic()
    return told, scene.listen(PATIENCE_S, lambda: scene.sees(again))


def _station_killed(scene: Range) -> tuple[float | None, float | None]:
    """station killed and started again; told: its first event"""
    scene.kill("station")
    again = time.monotonic()
    scene.start("station")
    told = scene.listen(PATIENCE_S, lambda: any(t >= again for t, _ in scene.events))
    back = scene.listen(PATIENCE_S, lambda: scene.sees(again))
    return told, None if back is None else time.monotonic() - again


def _router_away(scene: Range) -> tuple[float | None, float | None]:
    """router away for 10 s; told: nothing, it is the way for events"""
    scene.kill("router")
    scene.listen(10.0)
    scene.start("router")
    again = time.monotonic()
    return None, scene.listen(PATIENCE_S, lambda: scene.sees(again))


def _recovery(scene: Range, name: str) -> float | None:
    """Counted from when the new process is there: the start of Python is not the station's."""
    again = time.monotonic()
    scene.listen(PATIENCE_S, lambda: scene.heard(again, "is there"))
    there = time.monotonic()
    return scene.listen(PATIENCE_S, lambda: scene.sees(there, name))


def _line(what: str, found: list[tuple[float | None, float | None]]) -> str:
    def span(values: tuple) -> str:
        known = [value for value in values if value is not None]
        missing = f", {len(values) - len(known)} times not" if len(known) < len(values) else ""
        return f"median {np.median(known):.2f} s, worst {max(known):.2f} s{missing}" if known else "never"

    told, back = zip(*found, strict=True)
    return f"{what}, {len(found)} times: told after {span(told)}; as before after {span(back)}"


def _lost(numbers: list[int]) -> int:
    """Numbers missing, where they begin anew with each station."""
    return sum(b - a - 1 for a, b in itertools.pairwise(numbers) if b > a)


@contextlib.contextmanager
def _environment() -> Iterator[None]:
    """Processes import this tree, wherever they run."""
    before = os.environ.get("PYTHONPATH")
    os.environ["PYTHONPATH"] = str(Path(__file__).resolve().parents[2])
    try:
        yield
    finally:
        os.environ.pop("PYTHONPATH")
        if before is not None:
            os.environ["PYTHONPATH"] = before
