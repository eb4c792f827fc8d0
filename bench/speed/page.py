"""The page of a long flight: what a viewer costs, how soon he sees it, and what he takes from the fusion.

    python -m bench page                          all of it, about 15 minutes
    python -m bench page bytes hour seek fusion   some of it

bytes   to one viewer live, five sensors at 20 Hz, while a flight is young and after most of an hour
hour    memory of the page's process over that hour, and the first picture of it in Chromium
seek    from a moved slider to the clock of that moment on the page, anywhere in the hour
fusion  latency of states, put to received, with no, one and ten viewers of ``gcs view``, one of them stalled

The hour is a station's own messages: a session flies a circle, and what it tells of it is told again and
again with later times, as fast as the page takes it in. But for the first picture a viewer is a websocket
that reads and does not draw: Chromium without a graphics card would take both cores from what is measured.
"""

import base64
import os
import subprocess
import sys
import tempfile
import threading
import time
from collections.abc import Iterator, Sequence
from contextlib import ExitStack, contextmanager, suppress
from pathlib import Path
from typing import Any

import imageio.v3 as imageio
import msgspec
import numpy as np
import viser
import websockets
import zstandard
from websockets.exceptions import ConnectionClosed
from websockets.sync.client import connect

from bench.speed import live, long
from bench.speed.flood import resident_mb
from gcs.contract.messages import ANY, Scene, State
from tests.web import browser
from tests.web.page import is_blue
from web.look.html import clock
from web.view import View

PARTS = ("bytes", "hour", "seek", "fusion")
AHEAD = 4_000  # messages, 5 s of flight, that may wait for the page while the hour goes by
SETTLE_S, COUNTED_S = 15.0, 45  # seconds of a viewer that are not counted, and that are
BLUE_PX, PATIENCE_S = 300, 120.0  # so many pixels of the track's colour: it is there
CAMERA = {
    "position": (-900.0, -1700.0, 900.0), "look_at": (0.0, 0.0, 100.0), "wxyz": (0.54, -0.81, -0.19, 0.13),
    "up_direction": (0.0, 0.0, 1.0), "fov": 0.9, "near": 1.0, "far": 1e5,
    "image_height": 700, "image_width": 560,
}  # fmt: skip
STEP_MIN = 5  # minutes of flight between two lines of its memory
SEEKS = 60
VIEWERS = (0, 1, 10)
Told = list[tuple[ANY, str]]


def run(parts: Sequence[str], minutes: float, seconds: float, repeats: int) -> None:
    """Measure and print."""
    wanted = set(parts or PARTS)
    with tempfile.TemporaryDirectory() as name, ExitStack() as stack:
        folder = Path(name)
        if wanted - {"fusion"}:
            long.tell(folder / "told")
        if "bytes" in wanted:
            with page(folder / "told", 0.0):
                print(f"bytes, minute 1: {_bytes()}", flush=True)
        if wanted - {"fusion"}:
            stack.enter_context(page(folder / "told", minutes - 1.0))
        if "bytes" in wanted:
            print(f"bytes, minute {minutes:g}: {_bytes()}", flush=True)
        if "hour" in wanted:
            print(f"first picture of {minutes:g} min: {_first_picture()}", flush=True)
        if "seek" in wanted:
            print(f"seek in {minutes:g} min: {_seek(minutes)}", flush=True)
        stack.close()
        for _ in range(repeats if "fusion" in wanted else 0):
            for viewers in VIEWERS:
                print(f"fusion, {viewers} viewers: {_fusion(folder, viewers, seconds)}", flush=True)


def serve(tape: Path, minutes: float) -> None:
    """The page, in a process of its own: some minutes of flight at once, then on as time passes."""
    still, told = msgspec.msgpack.decode(tape.read_bytes(), type=tuple[Scene, Told])
    view = View(still, port=long.PORT)
    live_ns, began_s, said = long.T0_NS + round(minutes * 60e9), 0.0, 0
    for message, source in _endless(told):
        t_ns = message.t_ns
        if isinstance(message, State) and not source:
            while t_ns < live_ns and view.seen[0].waiting > AHEAD:
                time.sleep(0.001)
            if t_ns >= long.T0_NS + said * STEP_MIN * 60_000_000_000:
                while view.seen[0].waiting:  # what is in the queue only because nobody flies so fast
                    time.sleep(0.001)
                told_mb = f"{STEP_MIN * said:3} min  {resident_mb(os.getpid()):6.1f} MB"
                print(f"   {told_mb}", file=sys.stderr, flush=True)
                said += 1
            if t_ns >= live_ns:
                if not began_s:
                    began_s = time.monotonic()
                    print("live", flush=True)
                time.sleep(max(0.0, (t_ns - live_ns) / 1e9 - (time.monotonic() - began_s)))
        view.put(message, source)


def _endless(told: Told) -> Iterator[tuple[Any, str]]:
    """All of it again and again, from ``long.T0_NS`` on."""
    first_ns = next(message.t_ns for message, source in told if isinstance(message, State) and not source)
    shift_ns = long.T0_NS - first_ns
    while True:
        for message, source in told:
            yield msgspec.structs.replace(message, t_ns=message.t_ns + shift_ns), source
        shift_ns += round(long.CIRCLE_S * 1e9)


@contextmanager
def page(tape: Path, minutes: float) -> Iterator[None]:
    """``serve``, once it has come to its last minute."""
    command = [sys.executable, "-m", "bench", "page", "--tape", str(tape), "--minutes", str(minutes)]
    serving = subprocess.Popen(command, stdout=subprocess.PIPE, text=True)
    try:
        assert serving.stdout
        serving.stdout.readline()
        yield
    finally:
        serving.kill()
        serving.wait()


class Watcher:
    """A viewer that reads what it is sent and draws nothing; ``stalled`` it does not even read."""

    def __init__(self, port: int = long.PORT, *, stalled: bool = False):
        self.received = 0  # bytes
        self.slider = ""  # its name in messages
        self._wanted: tuple[str, ...] = ()
        self._found = threading.Event()
        protocol = websockets.Subprotocol(f"viser-v{viser.__version__}")
        address = f"ws://127.0.0.1:{port}"
        self._link = connect(address, subprotocols=[protocol], max_size=None, max_queue=1, compression=None)
        self.send("ViewerCameraMessage", **CAMERA)
        if not stalled:
            threading.Thread(target=self._read, daemon=True).start()

    def send(self, kind: str, **fields: Any) -> None:
        self._link.send(msgspec.msgpack.encode({"type": kind, **fields}))

    def seconds_to(self, there_s: float, texts: tuple[str, ...]) -> float:
        """How long until one of the texts is on the page, after the slider was moved."""
        self._found.clear()
        self._wanted, began_s = texts, time.monotonic()
        self.send("GuiUpdateMessage", uuid=self.slider, updates={"value": there_s})
        return time.monotonic() - began_s if self._found.wait(60.0) else np.inf

    def close(self) -> None:
        self._link.close()

    def _read(self) -> None:
        unpack = zstandard.ZstdDecompressor()
        with suppress(ConnectionClosed):
            while True:
                frame = self._link.recv()
                self.received += len(frame)
                if self._wanted or not self.slider:
                    size, packed = (int.from_bytes(frame[k : k + 8], "little") for k in (0, 8))
                    text = unpack.decompress(frame[16 : 16 + packed], max_output_size=size)
                    self._look(msgspec.msgpack.decode(text)["messages"])

    def _look(self, told: list[dict]) -> None:
        for one in told:
            if one["type"] == "GuiSliderMessage":
                self.slider = one["uuid"]
            content = one.get("updates", {}).get("content", "")
            if any(text in content for text in self._wanted):
                self._wanted = ()
                self._found.set()


def _bytes() -> str:
    watcher = Watcher()
    time.sleep(SETTLE_S)
    first, before, began_s = watcher.received, watcher.received, time.monotonic()
    worst = 0
    for _ in range(COUNTED_S):
        time.sleep(1.0)
        worst, before = max(worst, watcher.received - before), watcher.received
    mean = (watcher.received - first) / (time.monotonic() - began_s)
    watcher.close()
    return f"{mean / 1e3:.0f} kB/s, most in a second {worst / 1e3:.0f}; to begin with {first / 1e6:.1f} MB"


def _first_picture() -> str:
    """From the address entered to the first composed picture with the track in it."""
    from playwright.sync_api import sync_playwright

    frames: list[tuple[float, str]] = []

    def take(frame: dict) -> None:
        frames.append((time.monotonic(), frame["data"]))
        devtools.send("Page.screencastFrameAck", {"sessionId": frame["sessionId"]})

    with sync_playwright() as playwright:
        chromium = playwright.chromium.launch(executable_path=browser.CHROMIUM, args=browser.ARGS)
        tab = chromium.new_page(viewport={"width": 1280, "height": 720})
        devtools = tab.context.new_cdp_session(tab)
        devtools.on("Page.screencastFrame", take)
        devtools.send("Page.startScreencast", {"format": "png"})
        began_s = time.monotonic()
        tab.goto(f"http://127.0.0.1:{long.PORT}")
        tab.get_by_text("Sensors").first.wait_for()
        panel_s = time.monotonic() - began_s
        looked, picture_s = 0, np.inf
        while np.isinf(picture_s) and time.monotonic() - began_s < PATIENCE_S:
            tab.wait_for_timeout(200)
            for at_s, data in frames[looked:]:
                pixels = imageio.imread(base64.b64decode(data))[..., :3].astype(int)
                middle = pixels[:, pixels.shape[1] // 3 : pixels.shape[1] * 2 // 3]  # between the panels
                if is_blue(middle).sum() >= BLUE_PX:
                    picture_s = min(picture_s, at_s - began_s)
            looked = len(frames)
        devtools.remove_listener("Page.screencastFrame", take)
        chromium.close()
    return f"panel {panel_s:.1f} s, track {picture_s:.1f} s"


def _seek(minutes: float) -> str:
    watcher = Watcher()
    time.sleep(SETTLE_S)
    chance, took = np.random.default_rng(1), []
    for _ in range(SEEKS):
        there_s = round(float(chance.uniform(5.0, 60.0 * minutes - 65.0)), 1)
        t_ns = long.T0_NS + round(there_s * 1e9)
        texts = tuple(clock(t_ns - before_ns) for before_ns in (0, 100_000_000))
        took.append(watcher.seconds_to(there_s, texts))
        time.sleep(float(chance.uniform(0.5, 0.8)))
    watcher.close()
    return f"median {np.median(took):.2f} s, worst {max(took):.2f} s of {SEEKS}"


def _fusion(folder: Path, viewers: int, seconds: float) -> str:
    """Latency as ``bench live`` has it, with the page in its own process and so many viewers, one stalled."""
    me = [sys.executable, "-m", "gcs"]
    station = [*me, "run", "--station", "{station}", "--no-view", "--seconds", str(seconds + 20.0)]
    file = folder / "live.toml"
    file.write_text(live.STATION)
    seen: list[subprocess.Popen] = []
    if viewers:
        command = [*me, "view", "--station", str(file), "--config", f"view.port={long.PORT}"]
        seen.append(subprocess.Popen(command, stderr=subprocess.DEVNULL))
        command = [sys.executable, "-m", "bench", "page", "--watch", str(viewers)]
        seen.append(subprocess.Popen(command, stdout=subprocess.PIPE, text=True))
    try:
        told = live.soak(seconds, station)
    finally:
        for process in seen:
            process.kill()
    sent = seen[1].communicate()[0].splitlines()[-1] if viewers else "nobody"
    return f"{told.splitlines()[-1]}; sent to {sent}"


def watch(viewers: int) -> None:
    """So many viewers in a process of their own; the first of several does not read."""
    os.sched_setscheduler(0, os.SCHED_IDLE, os.sched_param(0))  # they would be on other machines
    watching: list[Watcher] = []
    while True:
        time.sleep(1.0)
        if len(watching) < viewers:
            with suppress(OSError):
                watching.append(Watcher(stalled=not watching and viewers > 1))
        print("each, MB:", *(f"{watcher.received / 1e6:.1f}" for watcher in watching), flush=True)
