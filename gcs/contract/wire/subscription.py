"""Samples from the bus until their reader takes them, as messages. Knows what a sample is like, not Zenoh."""

import threading
import time
from collections.abc import Callable, Iterator
from contextlib import suppress
from typing import Any, Protocol

import msgspec

from gcs.contract.limits import TEXT
from gcs.contract.messages import ANY, Bad, decode
from gcs.contract.wire.holders import OTHER, Holders
from gcs.contract.wire.inbox import Excess, Inbox

PUBLISHERS = 4_096  # whose last number is remembered; each restart of a bridge is a new one
TURN = 60  # live messages of one turn: at worst some 0.1 s of work, then a stop or a flood is noticed
LAST_S = 2.0  # a station that is stopped takes in what waits, for so long at most
NOT_OURS = (msgspec.DecodeError, UnicodeDecodeError, RecursionError)  # all that decoding strange bytes raises


class Sample(Protocol):
    """What is read of one of Zenoh's."""

    @property
    def key_expr(self) -> Any: ...

    @property
    def payload(self) -> Any: ...

    @property
    def encoding(self) -> Any: ...

    @property
    def source_info(self) -> Any: ...


class Miss(Protocol):
    """Samples that were lost on the way."""

    nb: int


class Subscription:
    """Messages wait here until they are drained: see `Inbox` for what happens when there are too many."""

    def __init__(self, inbox: Inbox):
        self.undecodable = 0  # payloads that are none of ours
        self.missed = 0  # messages lost on the way and no longer kept by their publisher
        self.holders = Holders()
        self._inbox = inbox
        self._early: list[Sample] | None = []  # live samples that wait for the history
        self._newest: dict[tuple, int] = {}  # last sample number taken from each publisher
        self._lock = threading.Lock()

    @property
    def lost(self) -> dict[str, int]:
        """Messages that came and were not handed on, by cause: see `Inbox`."""
        return dict(self._inbox.lost)

    @property
    def age_s(self) -> float:
        """How long the oldest queued message has waited, for health only (monotonic clock)."""
        return self._inbox.age_s

    @property
    def idle_s(self) -> float:
        """How long nothing has come, for health only (monotonic clock)."""
        return self._inbox.idle_s

    def drain(self, timeout_s: float = 0.1) -> list[tuple[str, ANY]]:
        """All queued ``(source, message)`` in arrival order; waits at most ``timeout_s`` for the first.

        A payload on ``raw/*`` that is none of ours comes out as ``Bad``, so that it gets its verdict, and so
        does what was refused; on other keys both are only counted.
        """
        return self._read_all(self._inbox.take(timeout_s))

    def turns(
        self, stop: threading.Event, patience_s: Callable[[], float]
    ) -> Iterator[tuple[int, list[tuple[str, ANY]]]]:
        """When it arrived, and what `drain` gives, a turn at a time, until ``stop``; then what is left.

        Not when it is read: a reader that was away must not call late what came in time. Without a message
        a turn comes after ``patience_s``, asked anew each time. What could not be taken in within LAST_S
        after ``stop`` comes last of all, as lost.
        """
        while not stop.is_set():
            items = self._inbox.take(patience_s(), TURN)
            yield self._inbox.arrived_ns, self._read_all(items)
        end_s = time.monotonic() + LAST_S
        while (items := self._inbox.take(0.0, TURN)) and time.monotonic() < end_s:
            yield self._inbox.arrived_ns, self._read_all(items)
        yield self._inbox.arrived_ns, self._read_all(items + self._inbox.leave())

    def waiting(self, after_ns: int) -> list[tuple[int, str, ANY]]:
        """(arrival, source, message) of what came after ``after_ns`` and waits; it is not taken.

        Without what `drain` will give as ``Bad``.
        """
        found = []
        for arrival_ns, key, item in self._inbox.waiting(after_ns):
            if not isinstance(item, Excess):
                with suppress(*NOT_OURS):
                    found.append((arrival_ns, _name(key)[1], _decoded(item)))
        return found

    def push(self, sample: Sample) -> None:
        # Zenoh's thread: a slow callback would stall every key of the session, so nothing else happens here.
        with self._lock:
            if self._early is None:
                self._take(sample)
            else:
                self._early.append(sample)

    def begin(self, history: list[Sample]) -> None:
        with self._lock:
            for sample in history + (self._early or []):
                self._take(sample, kept=True)
            self._early = None

    def _take(self, sample: Sample, *, kept: bool = False) -> None:
        publisher = None
        if info := sample.source_info:  # a plain publisher's samples have none
            publisher = str(info.source_id.zid), info.source_id.eid
            if info.source_sn <= self._newest.get(publisher, -1):
                return  # came with the history
            self._newest[publisher] = info.source_sn
            if len(self._newest) > PUBLISHERS:
                del self._newest[next(iter(self._newest))]
        key = str(sample.key_expr)
        ours = self.holders.admit(key, publisher)
        self._inbox.put(key, sample if ours else Excess(1, OTHER), len(sample.payload), kept=kept)

    def count_miss(self, miss: Miss) -> None:
        self.missed += miss.nb

    def _read_all(self, items: list[tuple[str, Any]]) -> list[tuple[str, ANY]]:
        return [pair for key, item in items if (pair := self._read(key, item))]

    def _read(self, key: str, item: Sample | Excess) -> tuple[str, ANY] | None:
        subject, source = _name(key)
        if isinstance(item, Excess):
            what = Bad(source=source, where=key, reason=item.reason, count=item.messages)
            return (source, what) if subject == "raw" else None
        try:
            return source, _decoded(item)
        except NOT_OURS as error:
            self.undecodable += 1
            if subject != "raw":
                return None
            clipped = item.payload.to_bytes()[:TEXT].decode(errors="replace")
            return source, Bad(source=source, where=key, reason=str(error)[:TEXT], raw=clipped)


def _name(key: str) -> tuple[str, str]:
    """Subject and source of a key."""
    _, _, subject, source = (key + "///").split("/")[:4]
    return subject, source


def _decoded(sample: Sample) -> ANY:
    return decode(sample.payload.to_bytes(), str(sample.encoding))
