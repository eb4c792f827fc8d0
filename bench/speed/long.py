"""A long flight through the live session, faster than real time: what memory, handles and threads it leaves.

INS 35 Hz and four instruments 20 Hz, with record, messages and page as in a live run, each turn 20 ms of
data; and a viewer of the page comes and goes. The table says after each part of the flight what is resident
and how much work a turn is, and at its end which code holds what has grown.
"""

import heapq
import os
import random
import subprocess
import sys
import tempfile
import threading
import time
import tracemalloc
from collections.abc import Iterator
from contextlib import ExitStack, contextmanager
from pathlib import Path

import msgspec
import numpy as np

from bench.speed import live
from bench.speed.flood import resident_mb
from gcs.commands.compose import targets
from gcs.contract import config, messages
from gcs.contract.config import Station
from gcs.contract.frames import Frame, scene
from gcs.contract.messages import PolarMeasurement
from gcs.outputs.disk import to_operator
from gcs.outputs.publish import Publisher
from gcs.outputs.record import Record
from gcs.station.health import Files, Monitor
from gcs.station.scratch import Scratch
from gcs.station.session import Session
from web.view import View

RATES_HZ = {"ins": 35.0, "theo-north": 20.0, "theo-east": 20.0, "theo-south": 20.0, "radar-1": 20.0}
TURN_S = 0.02
PARTS = 24  # lines of the table
PORT = 17_480  # of the page
STAYS_S = 20.0  # a viewer, before he goes for as long
EAST = """
[[sensor]]
name = "theo-east"
kind = "theodolite"
position = { lat_deg = -35.3600, lon_deg = 149.1720, alt_m = 600.0 }
"""
SOUTH = """
[[sensor]]
name = "theo-south"
kind = "theodolite"
position = { lat_deg = -35.3710, lon_deg = 149.1700, alt_m = 600.0 }
"""
T0_NS = 1_767_225_600 * 10**9
HZ = 20.0  # of each of the five sources of ``tell``
WRONG = 0.02  # of its instruments' measurements are outliers
CIRCLE_S = 40.0 * np.pi  # of ``live.measure``: then the flight is where it was


def run(seconds: float, *, trace: bool) -> dict:
    """Fly and print; gives growth in MB per hour of flight after the first part, handles and threads."""
    with tempfile.TemporaryDirectory() as folder, ExitStack() as stack:
        file = Path(folder, "station.toml")
        file.write_text(live.STATION + EAST + SOUTH)
        station, frame = config.load(file), Frame(*live.ORIGIN)
        view = View(scene(station, frame), port=PORT)
        stack.callback(view.close)
        sink = Publisher(frame, Monitor(list(RATES_HZ), Files()), [_encoded, *targets(view=view)])
        keep = stack.enter_context(Scratch(Path(folder), to_operator)).keep
        session = Session(station, frame, [Record(Path(folder, "run"), station, frame), sink], keep=keep)
        session.supervise()
        session.estimator.warm_up()
        before = _handles()
        if trace:
            tracemalloc.start()
        seen, first = [], None
        with _viewer_comes_and_goes():
            for part in range(PARTS):
                took_ms = 1e3 * _fly(session, seconds / PARTS, part)
                seen.append(resident_mb(os.getpid()))
                print(
                    f"{(part + 1) * seconds / PARTS / 60:7.1f} min  {seen[-1]:7.1f} MB  work of a turn: "
                    f"mean {np.mean(took_ms):.2f} ms, p99 {np.percentile(took_ms, 99):.1f}",
                    flush=True,
                )
                if trace and part == 0:
                    first = tracemalloc.take_snapshot()
        if first:
            _explain(first, seconds * (PARTS - 1) / PARTS)
        growth = (seen[-1] - seen[0]) / (seconds * (PARTS - 1) / PARTS) * 3600.0
        left = tuple(after - b for after, b in zip(_handles(), before, strict=True))
        print(f"growth {growth:.1f} MB per hour of flight; {left[0]} more handles, {left[1]} more threads")
        _end(session)
    return {"mb_per_hour": growth, "handles": left[0], "threads": left[1]}


@contextmanager
def _viewer_comes_and_goes() -> Iterator[None]:
    """A viewer in a process of his own, who stays for ``STAYS_S`` and comes again as much later."""
    over = threading.Event()

    def visit() -> None:
        command = [sys.executable, "-m", "bench", "page", "--watch", "1"]
        while not over.is_set():
            viewer = subprocess.Popen(command, stdout=subprocess.DEVNULL)
            over.wait(STAYS_S)
            viewer.kill()
            viewer.wait()
            over.wait(STAYS_S)

    visiting = threading.Thread(target=visit)
    visiting.start()
    try:
        yield
    finally:
        over.set()
        visiting.join()


def _end(session: Session) -> None:
    """Finish it, and print what the best estimate takes: of memory that is not a file's."""
    before_mb, most_mb, over = own_mb(), [0.0], threading.Event()

    def watch() -> None:
        while not over.wait(0.02):
            most_mb[0] = max(most_mb[0], own_mb())

    watching = threading.Thread(target=watch)
    watching.start()
    began = time.process_time()
    session.finish({})
    over.set()
    watching.join()
    print(
        f"the end: {time.process_time() - began:.1f} s of work, {most_mb[0] - before_mb:.0f} MB more at most"
    )


def own_mb() -> float:
    """Memory of this process that no file stands for, MB."""
    pages = [int(word) for word in Path("/proc/self/statm").read_text().split()]
    return (pages[1] - pages[2]) * os.sysconf("SC_PAGE_SIZE") / 1e6


def _fly(session: Session, seconds: float, part: int) -> np.ndarray:
    """Work of each turn, seconds of this thread."""
    noise = random.Random(part)
    took_s = np.empty(int(seconds / TURN_S))
    begin_ns = T0_NS + round(part * seconds * 1e9)
    due = planned(begin_ns, seconds)
    follows = next(due, None)
    for turn in range(1, len(took_s) + 1):
        end_ns = begin_ns + int(turn * TURN_S * 1e9)
        heard: dict[str, list] = {}
        while follows and follows[0] < end_ns:
            t_ns, name = follows
            heard.setdefault(name, []).append(live.measure(name, t_ns, noise))
            follows = next(due, None)
        began_s = time.thread_time()
        for name, found in heard.items():
            _enter(session, name, found, end_ns)
        session.advance(session.align.due_ns(end_ns))
        took_s[turn - 1] = time.thread_time() - began_s
    return took_s


def planned(begin_ns: int, seconds: float) -> Iterator[tuple[int, str]]:
    """When who measures, in order, made as it is asked for: a list of it is more than the flight keeps."""
    return heapq.merge(*(_beats(name, begin_ns, seconds) for name in RATES_HZ))


def _beats(name: str, begin_ns: int, seconds: float) -> Iterator[tuple[int, str]]:
    rate = RATES_HZ[name]
    return ((begin_ns + round(k / rate * 1e9), name) for k in range(int(seconds * rate)))


def _enter(session: Session, name: str, found: list, arrival_ns: int) -> None:
    """Measurements of one source into the session."""
    columns = messages.to_columns(found, type(found[0]))
    own = name == "ins"
    session.enter(session.intake.ins(columns) if own else session.intake.polar(name, columns), arrival_ns)


def tell(tape: Path) -> None:
    """Write what a station tells of one circle, after one that is not kept."""
    file = tape.with_suffix(".toml")
    file.write_text(live.STATION + EAST + SOUTH)
    station, frame = config.load(file), Frame(*live.ORIGIN)
    told: list[tuple[messages.ANY, str]] = []
    publisher = Publisher(frame, Monitor(station.sources, Files()), [lambda s, m, _: told.append((m, s))])
    session = Session(station, frame, [publisher])
    session.estimator.warm_up()
    noise, first = random.Random(1), 0
    for k in range(round(2 * CIRCLE_S * HZ)):
        if k == round(CIRCLE_S * HZ):
            first = len(told)
        _measure(session, station, T0_NS + round(k / HZ * 1e9), noise)
    kept = [(message, "smoothed" if subject == "smoothed" else "") for message, subject in told[first:]]
    tape.write_bytes(msgspec.msgpack.encode((scene(station, frame), kept)))
    print(f"five sensors at {HZ:g} Hz: {len(kept) / CIRCLE_S:.0f} messages a second", flush=True)


def _measure(session: Session, station: Station, t_ns: int, noise: random.Random) -> None:
    """One measurement of each source into the session."""
    for name in station.sources:
        said = live.measure(name, t_ns, noise)
        if isinstance(said, PolarMeasurement) and noise.random() < WRONG:
            said = msgspec.structs.replace(said, range_m=(said.range_m or 0.0) + noise.uniform(30.0, 300.0))
        _enter(session, name, [said], t_ns)
    session.advance(session.align.due_ns(t_ns))


def _encoded(subject: str, message: messages.ANY, source: str) -> None:
    messages.encode(message)


def _handles() -> tuple[int, int]:
    """Open files and threads; of the page's library only what is not its pool, 32 workers at most."""
    threads = [thread for thread in threading.enumerate() if "PoolExecutor" not in thread.name]
    return len(list(Path("/proc/self/fd").iterdir())), len(threads)


def _explain(first: tracemalloc.Snapshot, seconds: float) -> None:
    """Which lines hold what has grown since ``first``, MB per hour."""
    grown = tracemalloc.take_snapshot().compare_to(first, "lineno")
    for line in grown[:12]:
        where = line.traceback[0]
        name = "/".join(Path(where.filename).parts[-3:])
        print(f"{line.size_diff / 1e6 / seconds * 3600:8.1f} MB/h  {name}:{where.lineno}")
