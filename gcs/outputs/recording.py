"""What a live run leaves behind, written beside the fusion: the recording, the link's tlog and the tables.

The session's thread only hands over; one thread of its own encodes and writes. What it has no room for, for
the disk is too slow or hangs, is refused and counted, and the fusion goes on.
The layout of the recording: ``gcs/station/sources/recording.py``.
"""

import time
from collections import Counter, deque
from collections.abc import Callable, Sequence
from functools import partial
from math import isfinite
from pathlib import Path

import msgspec
import numpy as np
from mcap.writer import Writer

from gcs.contract import messages, steady
from gcs.contract.config import Station, dump
from gcs.contract.frames import Frame
from gcs.contract.messages import ANY, JSON, MSGPACK, AirData, Event, InsMeasurement, PolarMeasurement, State
from gcs.outputs import foxglove
from gcs.outputs.disk import WAITING_WORK, Beside, RunFile, Tell
from gcs.outputs.record import Record
from gcs.outputs.tlog import LinkLog
from gcs.station.session import Update
from gcs.station.sources.live import Arrived
from gcs.station.sources.recording import ABOUT, RAW, RECORDING, STATION, TURN, WAITING, TurnMark

LINK = "link.tlog"
FLUSH_S = 0.2  # a kill costs at most about so much
SYNC_S = 1.0  # … and a power cut: the disk itself is asked less often, for a write may have to wait meanwhile
CHUNK_BYTES = 2**26  # more than comes in within FLUSH_S: a chunk ends where we say, between two turns
PATIENCE_S = 20.0  # at the end, for a disk that takes nothing: one that is slow has all the time
SHOWN = ("state", "event")  # subjects that are recorded, for Foxglove
MEASUREMENTS = (InsMeasurement, PolarMeasurement, AirData)

Waiting = Callable[[int], Sequence[tuple[int, str, ANY]]]  # (arrival, source, message) of what came since


class Chunks:
    """The stream that the MCAP library writes to: what it writes at once is one block of the file."""

    def __init__(self, file: RunFile):
        self.units = 0  # turns since the last block
        self._file = file
        self._parts: list[bytes] = []
        self._size = 0

    def write(self, data: bytes) -> int:
        self._parts.append(data)
        self._size += len(data)
        return len(data)

    def tell(self) -> int:
        return self._size

    def flush(self) -> None:
        block, self._parts = b"".join(self._parts), []
        if block:
            self._file.write(block, self.units)
            self.units = 0
        else:
            self._file.flush()


class McapFile:
    """The recording itself. Belongs to the writing thread."""

    def __init__(self, file: RunFile, station: Station, about: dict[str, str]):
        self.file = file
        self._chunks = Chunks(file)
        self._names = station.range.name, station.vehicle.name
        self._channels: dict[tuple[str, str], int] = {}
        self._flushed_s = self._synced_s = time.monotonic()
        self._syncing = Beside(int)
        self._writer = Writer(self._chunks, chunk_size=CHUNK_BYTES)  # type: ignore[arg-type]
        self._writer.start(profile="", library=f"gcs {about['version']}")
        now_ns = time.time_ns()
        self._writer.add_attachment(now_ns, now_ns, STATION, "application/toml", dump(station).encode())
        self._writer.add_metadata(ABOUT, about)
        self._writer.flush()

    def turn(self, number: int, now_ns: int, arrived: Arrived) -> None:
        """One turn of the live station, as it was given to it."""
        for source, message in arrived:
            self._add(RAW, source, now_ns, message, number)
        mark = msgspec.json.encode(TurnMark(number, len(arrived)))
        self._writer.add_message(self._channel(TurnMark, TURN, {}), now_ns, mark, now_ns, number & 0xFFFFFFFF)
        self._chunks.units += 1
        self.tick()

    def waiting(self, found: Sequence[tuple[int, str, ANY]]) -> None:
        """What has come, and no turn has taken yet: it is here twice, once a turn has."""
        for arrival_ns, source, message in found:
            self._add(WAITING, source, arrival_ns, message, 0)

    def tick(self) -> None:
        """Between two turns: on to the disk with them, when it is time."""
        now_s = time.monotonic()
        if now_s - self._flushed_s >= FLUSH_S:
            self._flushed_s = now_s
            self._writer.flush()
        if now_s - self._synced_s >= SYNC_S:
            self._synced_s = now_s
            # beside, one at a time: a disk that takes seconds for it must not keep the next turns waiting
            self._syncing.put(self.file.sync, WAITING_WORK)

    def show(self, now_ns: int, message: State | Event) -> None:
        """A state or an event, for Foxglove."""
        if isinstance(message, Event):
            self._show(now_ns, foxglove.of_event(message, self._names[1]))
        else:
            for shown in foxglove.of_state(message, *self._names):
                self._show(now_ns, shown)

    def end_sync(self) -> None:
        """No more of it: the file is about to be closed."""
        self._syncing.end(PATIENCE_S)

    def end(self) -> None:
        """The index, so that a reader can jump. Where a block is lost its places are wrong: better none."""
        self._writer.flush()
        if not self.file.lost:
            self._writer.finish()
            self._chunks.flush()

    def _add(self, topic: str, source: str, now_ns: int, message: ANY, number: int) -> None:
        kind = type(message)
        media = JSON if all(map(_in_json, msgspec.structs.astuple(message))) else MSGPACK
        whole = f"{topic}/{source}" if kind in MEASUREMENTS else f"{topic}/{source}/{kind.__name__.lower()}"
        payload, _ = messages.encode(message, media)
        sent_ns = max(0, getattr(message, "arrival_ns", now_ns))
        channel = self._channel(kind, whole, {"source" if topic == RAW else "waits_of": source}, media)
        self._writer.add_message(channel, now_ns, payload, sent_ns, number & 0xFFFFFFFF)

    def _show(self, now_ns: int, shown: foxglove.Shown) -> None:
        channel = self._channel(type(shown), foxglove.TOPICS[type(shown)], {})
        self._writer.add_message(channel, now_ns, msgspec.json.encode(shown), now_ns)

    def _channel(self, kind: type, topic: str, about: dict[str, str], media: str = JSON) -> int:
        """The channel of a topic, made when it is new."""
        known = self._channels.get((topic, media))
        if known is not None:
            return known
        name = f"{'foxglove' if kind in foxglove.TOPICS else 'gcs'}.{kind.__name__}"
        text = msgspec.json.encode(foxglove.schema(kind) | {"title": name})
        schema = self._writer.register_schema(name, "jsonschema", text) if media == JSON else 0
        channel = self._writer.register_channel(topic, media.rpartition("/")[2], schema, about)
        self._channels[topic, media] = channel
        return channel


class RunRecorder:
    """All of a run that goes to its folder: a sink, a target of messages, the tap of turns and link.

    The writing thread is woken at the end of a turn: until then the session has the processor for the state.
    """

    name = "record"  # for the operator

    @property
    def missing(self) -> Counter[str]:
        """As the record's."""
        return self._record.missing

    def __init__(
        self,
        folder: Path,
        station: Station,
        frame: Frame,
        tell: Tell,
        about: dict[str, str],
        waiting: Waiting = lambda _after_ns: (),
    ):
        self._tell, self._waiting = tell, waiting
        self._notes: deque[tuple[str, str]] = deque()  # what the writing thread has to say
        self._folder = folder
        self._mcap = McapFile(RunFile(folder / RECORDING, self.note), station, about)
        self._beside = Beside(self._meanwhile)
        self._record = Record(folder, station, frame, self.note, self._beside.goes_on)
        self._link = LinkLog(folder / LINK, self.note)
        self._refused: Counter = Counter()  # by file
        self._behind = False
        self._turns = self._now_ns = 0
        self._waited_ns = 0  # arrival of the newest message recorded before any turn has taken it

    def turn(self, now_ns: int, arrived: Arrived) -> None:
        """The tap: called with each turn before anything is decided."""
        self._say()
        self._now_ns = now_ns
        self.put(partial(self._mcap.turn, self._turns, now_ns, arrived), 1 + len(arrived), {RECORDING: 1})
        self._turns += 1

    def target(self, subject: str, message: ANY, _source: str) -> None:
        """States and events, as they go to the bus."""
        if subject in SHOWN:
            assert isinstance(message, State | Event)
            self.put(partial(self._mcap.show, self._now_ns, message), 1, {RECORDING: 1})

    def link(self, arrival_ns: int, frame: bytes) -> None:
        """One frame of the MAVLink link, in the thread that reads it."""
        self.put(partial(self._link.take, arrival_ns, frame), 1, {LINK: 1})

    def take(self, update: Update) -> None:
        rows = {
            "track.csv": len(update.track),
            "smoothed.csv": len(update.smoothed),
            "verdicts.csv": len(update.retired),
            "separation.csv": len(update.separation),
        }
        self.put(partial(self._record.take, update), 1 + sum(rows.values()), rows, wake=True)
        self._beside.check()

    def close(self, summary: dict, best: np.ndarray) -> None:
        self._beside.put(partial(self._close, summary, best), refuse=False)
        self._beside.wait(PATIENCE_S)
        self._beside.check()

    def end(self) -> None:
        """After the session: write what waits, and the recording's index."""
        self._mcap.end_sync()
        self._beside.put(self._end, refuse=False)
        if not self._beside.end(PATIENCE_S):
            self._notes.append(
                ("error", f"{self._folder}: the disk hangs; what waited for it is not written")
            )
        self._say()

    def put(
        self, work: Callable[[], object], size: int, units: dict[str, int], *, wake: bool = False
    ) -> None:
        """Have it done beside, or count what is refused, by file."""
        taken = self._beside.put(work, size, wake=wake)
        if not taken:
            self._refused.update(units)
        if taken == self._behind:
            self._behind = not taken
            text = "the disk is too slow: the run folder is losing rows and turns"
            lost = ", ".join(f"{name} {count}" for name, count in sorted(self._refused.items()))
            note = ("info", f"the disk keeps up again; missing: {lost}") if taken else ("error", text)
            self._notes.append((note[0], f"{self._folder}: {note[1]}"))

    def note(self, level: str, text: str) -> None:
        """What the operator should know, from the thread that writes: told with the next turn."""
        self._notes.append((level, text))

    def _meanwhile(self) -> None:
        """Whatever a turn is doing for so long, a kill now must not cost what has come since."""
        if steady.now_ns() - self._now_ns >= FLUSH_S * 1e9:
            found = self._waiting(max(self._now_ns, self._waited_ns))
            if found:
                self._waited_ns = found[-1][0]
                self._mcap.waiting(found)
        self._mcap.tick()

    def _close(self, summary: dict, best: np.ndarray) -> None:
        lost = self._refused + Counter(
            {file.path.name: file.lost for file in (self._link.file, self._mcap.file)}
        )
        self._record.close(summary | {"not_written": dict(lost)}, best)

    def _end(self) -> None:
        self._mcap.end()
        self._link.close()
        self._mcap.file.close()
        for file in (self._link.file, self._mcap.file):
            if file.lost:
                self._notes.append(
                    ("error", f"{file.path}: ends early, {file.lost} frames or turns are missing")
                )

    def _say(self) -> None:
        while self._notes:
            self._tell(*self._notes.popleft())


def _in_json(value: object) -> bool:
    return not isinstance(value, float) or isfinite(value)
