"""A recording of a live run: what came in, in the turns in which the station took it; and its replay.

===========================  ==========================================================================
attachment ``station.toml``  the station, every default written out
metadata ``gcs``             software, version, method, correction
topic ``/raw/SOURCE``        what came in, before any decision: JSON as on the bus, MessagePack where a
                             number is infinite; the channel's metadata name the ``source``. Not its usual
                             kind of measurement, such as a damaged line: ``/raw/SOURCE/TYPE``
topic ``/turn``              ends each turn: its number from 0, and how many messages it has. The log time
                             of all of them is the station's clock at that turn
topic ``/waiting/SOURCE``    what has come while a turn took long, when it came (log time); the turn that
                             takes it repeats it. Read only where the file ends before that
``/state/…  /tf  /events``   the cleaned state and events for Foxglove; a replay does not read them
===========================  ==========================================================================

A chunk ends with a turn, about three times a second, and is written at once. A recording that was cut off
anywhere is read up to its last whole chunk; one that is damaged in the middle, without the damaged chunks.
"""

import struct
from collections.abc import Iterator
from pathlib import Path
from typing import NamedTuple

import msgspec
import numpy as np
import zstandard
from mcap.exceptions import McapError
from mcap.records import Attachment, Channel, Chunk, Footer, McapRecord, Message, Metadata
from mcap.stream_reader import StreamReader, breakup_chunk

from gcs.contract import messages
from gcs.contract.messages import ANY, InputError
from gcs.station.session import Session
from gcs.station.sources import live

RECORDING = "run.mcap"
STATION, ABOUT = "station.toml", "gcs"
TURN, RAW, WAITING = "/turn", "/raw", "/waiting"
MEDIA = {"json": messages.JSON, "msgpack": messages.MSGPACK}
LARGEST = 2**28  # bytes of one record; a length beyond it is damage
DAMAGE = (McapError, zstandard.ZstdError, struct.error, ValueError, MemoryError)  # a length that is wrong


class TurnMark(msgspec.Struct, frozen=True):
    """Ends a turn in the file."""

    number: int
    messages: int


class Turn(NamedTuple):
    """What arrived, (source, message) in order, and the station's clock at that moment."""

    number: int
    now_ns: int
    arrived: list[tuple[str, ANY]]


class Recording:
    """A recorded run as a flight to replay."""

    def __init__(self, path: Path):
        """Read what it says of itself. Raises ``InputError`` where nothing can be replayed."""
        self.path = path
        self.station_text, self.settings = "", dict[str, str]()
        spans = []
        for record in self._records():
            if isinstance(record, Attachment) and record.name == STATION:
                self.station_text = record.data.decode()
            elif isinstance(record, Metadata) and record.name == ABOUT:
                self.settings = dict(record.metadata)
            elif isinstance(record, Chunk):
                spans.append((record.message_start_time, record.message_end_time))
        if not self.station_text or not self.settings:
            raise InputError(f"{path}: no recording of a run, or cut off before its station file")
        if not spans:
            raise InputError(f"{path}: holds no whole chunk: the run ended within its first half second")
        self.times_ns = np.maximum.accumulate(np.array(spans, np.int64).ravel())  # a clock may step back
        self.start_ns, self.end_ns = int(self.times_ns[0]), int(self.times_ns[-1])
        self.ended = False  # has the end of the file been read, with its index?

    def replay(self, session: Session) -> "RunReplay":
        return RunReplay(self, session)

    def turns(self) -> Iterator[Turn]:
        """Every whole turn, in order. A turn of which a message is missing is left out.

        What no turn has taken before the end has a turn each, as at a station that has nothing else to do.
        """
        channels: dict[int, Channel] = {}
        arrived: list[tuple[str, ANY]] = []
        waiting: list[tuple[int, str, ANY]] = []
        number = now_ns = -1
        for record in self._whole():
            if isinstance(record, Channel):
                channels[record.id] = record
            elif isinstance(record, Message) and (channel := channels.get(record.channel_id)):
                if source := channel.metadata.get("source"):
                    arrived.append((source, self._decode(record, channel)))
                elif source := channel.metadata.get("waits_of"):
                    waiting.append((record.log_time, source, self._decode(record, channel)))
                elif channel.topic == TURN:
                    mark = msgspec.json.decode(record.data, type=TurnMark)
                    number, now_ns = mark.number, record.log_time
                    if mark.messages == len(arrived):
                        yield Turn(number, now_ns, arrived)
                    arrived, waiting = [], [one for one in waiting if one[0] > now_ns]
        for more, (arrival_ns, source, message) in enumerate(waiting, 1):
            yield Turn(number + more, arrival_ns, [(source, message)])

    def _decode(self, record: Message, channel: Channel) -> ANY:
        try:
            return messages.decode(record.data, MEDIA[channel.message_encoding])
        except (msgspec.DecodeError, LookupError) as error:
            by = self.settings.get("version", "unknown")
            raise InputError(
                f"{self.path}: {channel.topic}: {error}; recorded by gcs {by}, use that"
            ) from None

    def _whole(self) -> Iterator[McapRecord]:
        """The records in whole chunks."""
        for record in self._records():
            self.ended |= isinstance(record, Footer)
            if not isinstance(record, Chunk):
                continue
            try:
                parts = breakup_chunk(record, validate_crc=True)
            except DAMAGE:
                continue  # shows as missing turns
            yield from parts

    def _records(self) -> Iterator[McapRecord]:
        """The file's own records, up to where it was cut off."""
        try:
            with self.path.open("rb") as file:
                yield from StreamReader(file, emit_chunks=True, record_size_limit=LARGEST).records
        except OSError as error:
            raise InputError(f"{self.path}: {error.strerror}; name a recording, run.mcap") from None
        except DAMAGE:
            return


class RunReplay:
    """The turns of a recording, taken again by a session."""

    def __init__(self, recording: Recording, session: Session):
        self._recording, self._session = recording, session
        self._arrivals = live.Arrivals(session.ledger.sensors, session.intake.station.filter.lateness_s)
        self._turns = recording.turns()
        self._next = next(self._turns, None)
        self._taken, self._last = 0, -1  # turns so far, number of the last one

    def take(self, upto_ns: int) -> None:
        """Every turn up to ``upto_ns`` of the station's clock."""
        while self._next and self._next.now_ns <= upto_ns:
            live.turn(self._session, self._arrivals, self._next.arrived, self._next.now_ns)
            self._taken, self._last = self._taken + 1, self._next.number
            self._next = next(self._turns, None)

    def finish(self, *, complete: bool) -> dict:
        missing = self._last + 1 - self._taken
        told = {"turns": self._taken, "missing_turns": missing, "ended": self._recording.ended}
        return live.finish(self._session, self._arrivals, {"complete": complete, "recording": told})
