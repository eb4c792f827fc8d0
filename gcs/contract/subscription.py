"""Where samples from the bus wait for their reader: bounded, a queue and an allowance for each source.

A source that sends more than its rate loses what is beyond it; where all together are more than the reader
can take, the one with the most waiting loses its oldest. So no source can push out another. What was lost is
counted by source and handed to the reader as `Excess`, once a second while it lasts.

Knows what a sample is like, not Zenoh.
"""

import threading
import time
from collections import deque
from collections.abc import Iterator
from typing import Any, NamedTuple, Protocol

import msgspec

from gcs.contract.limits import LARGEST_BYTES, TEXT
from gcs.contract.messages import ANY, Bad, decode
from gcs.contract.supervision import log

PUBLISHERS = 4_096  # whose last number is remembered; each restart of a bridge is a new one
NOT_OURS = (msgspec.DecodeError, UnicodeDecodeError, RecursionError)  # all that decoding strange bytes raises
REPORT_S = 1.0  # between two counts of what one source lost
QUIET_S = 2.0  # without loss for so long, it keeps to its limits again
SOURCES = 256  # told apart; who comes after them shares one queue, so that invented names cost no memory
OTHERS = "(others)"


class Excess(NamedTuple):
    """So many messages of one source are not among those that are handed on."""

    messages: int
    reason: str


class _Queue:
    """What waits of one source, and what it may still send."""

    def __init__(self, burst: int):
        self.waiting: deque[tuple[int, float, str, Any]] = deque()  # number, arrival, source, item
        self.allowance, self.since_s = float(burst), time.monotonic()
        self.lost: dict[str, int] = {}  # reason → messages, not told yet
        self.lost_s = self.told_s = -1e9
        self.over = False


class Inbox:
    """See the module's text. ``capacity`` items wait at most; ``rate_hz``, ``burst`` hold for each source."""

    def __init__(self, capacity: int, rate_hz: float = float("inf"), burst: int = 0):
        self.dropped = 0  # because the reader was too slow
        self.refused = 0  # beyond the rate or the size
        self._capacity, self._rate_hz, self._burst = capacity, rate_hz, burst
        self._queues: dict[str, _Queue] = {}
        self._count = self._number = 0  # waiting; put so far
        self._newest_s = time.monotonic()
        self._filled = threading.Condition()

    @property
    def age_s(self) -> float:
        """How long the oldest message has waited."""
        with self._filled:
            oldest = min(
                (queue.waiting[0][1] for queue in self._queues.values() if queue.waiting), default=None
            )
        return 0.0 if oldest is None else time.monotonic() - oldest

    @property
    def idle_s(self) -> float:
        """How long nothing has come."""
        return time.monotonic() - self._newest_s

    def put(self, source: str, item: Any, size: int, *, kept: bool = False) -> None:
        """Take one item of ``size`` bytes; one that was ``kept`` for us does not count against the rate."""
        now_s = time.monotonic()
        with self._filled:
            self._newest_s = now_s
            queue = self._queues.get(source) or self._queue(source)
            if size > LARGEST_BYTES:
                self.refused += 1
                _lose(queue, f"more than {LARGEST_BYTES} bytes", now_s)
            elif not kept and not self._allowed(queue, now_s):
                self.refused += 1
                _lose(queue, f"more than {self._rate_hz:g} a second", now_s)
            else:
                if self._count == self._capacity:
                    self._make_room(now_s)
                self._number += 1
                self._count += 1
                queue.waiting.append((self._number, now_s, source, item))
            self._filled.notify()

    def take(self, timeout_s: float) -> list[tuple[str, Any]]:
        """All ``(source, item)`` in the order they came, before them what was lost; waits for the first."""
        with self._filled:
            self._filled.wait_for(lambda: self._count, timeout_s)
            told = list(self._losses(time.monotonic()))
            found = [waiting for queue in self._queues.values() for waiting in queue.waiting]
            for queue in self._queues.values():
                queue.waiting.clear()
            self._count = 0
        found.sort(key=lambda waiting: waiting[0])
        return told + [(source, item) for _, _, source, item in found]

    def _queue(self, source: str) -> _Queue:
        name = source if len(self._queues) < SOURCES else OTHERS
        return self._queues.setdefault(name, _Queue(self._burst))

    def _allowed(self, queue: _Queue, now_s: float) -> bool:
        """Token bucket: the allowance grows with time, and each message takes one of it."""
        if self._rate_hz == float("inf"):
            return True
        queue.allowance = min(self._burst, queue.allowance + (now_s - queue.since_s) * self._rate_hz)
        queue.since_s = now_s
        if queue.allowance < 1.0:
            return False
        queue.allowance -= 1.0
        return True

    def _make_room(self, now_s: float) -> None:
        longest = max(self._queues.values(), key=lambda queue: len(queue.waiting))
        longest.waiting.popleft()
        self._count -= 1
        self.dropped += 1
        _lose(longest, "faster than it can be taken in", now_s)

    def _losses(self, now_s: float) -> Iterator[tuple[str, Excess]]:
        for name, queue in self._queues.items():
            if queue.lost and now_s - queue.told_s >= REPORT_S:
                for reason, count in queue.lost.items():
                    yield name, Excess(count, reason)
                if not queue.over:
                    log.warning("%s sends %s: the rest is refused", _short(name), next(iter(queue.lost)))
                queue.over, queue.told_s, queue.lost = True, now_s, {}
            elif queue.over and not queue.lost and now_s - queue.lost_s > QUIET_S:
                queue.over = False
                log.info("%s keeps to its limits again", _short(name))


def _short(key: str) -> str:
    """The source in a key, for an operator."""
    return key.rpartition("/")[2]


def _lose(queue: _Queue, reason: str, now_s: float) -> None:
    queue.lost[reason] = queue.lost.get(reason, 0) + 1
    queue.lost_s = now_s


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
        self._inbox = inbox
        self._early: list[Sample] | None = []  # live samples that wait for the history
        self._newest: dict[tuple, int] = {}  # last sample number taken from each publisher
        self._lock = threading.Lock()

    @property
    def dropped(self) -> int:
        """Messages lost because they came faster than they were drained."""
        return self._inbox.dropped

    @property
    def refused(self) -> int:
        """Messages beyond their source's rate, or too large."""
        return self._inbox.refused

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
        return [pair for source, item in self._inbox.take(timeout_s) if (pair := self._read(source, item))]

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
        if info := sample.source_info:  # a plain publisher's samples have none
            publisher = info.source_id.zid, info.source_id.eid
            if info.source_sn <= self._newest.get(publisher, -1):
                return  # came with the history
            self._newest[publisher] = info.source_sn
            if len(self._newest) > PUBLISHERS:
                del self._newest[next(iter(self._newest))]
        self._inbox.put(str(sample.key_expr), sample, len(sample.payload), kept=kept)

    def count_miss(self, miss: Miss) -> None:
        self.missed += miss.nb

    def _read(self, key: str, item: Sample | Excess) -> tuple[str, ANY] | None:
        _, _, subject, source = (key + "///").split("/")[:4]
        if isinstance(item, Excess):
            what = Bad(source=source, where=key, reason=item.reason, count=item.messages)
            return (source, what) if subject == "raw" else None
        payload = item.payload.to_bytes()
        try:
            return source, decode(payload, str(item.encoding))
        except NOT_OURS as error:
            self.undecodable += 1
            if subject != "raw":
                return None
            clipped = payload[:TEXT].decode(errors="replace")
            return source, Bad(source=source, where=key, reason=str(error)[:TEXT], raw=clipped)
