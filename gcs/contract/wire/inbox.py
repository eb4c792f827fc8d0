"""Where messages wait for their reader: bounded, a queue and an allowance for each source.

A source that sends more than its rate loses what is beyond it; one that sends `WILD` times what it may
within a second is no instrument any more: what waits of it goes, and nothing of it is taken until it keeps to
its rate again. Where all together are more than the reader can take, the one with the most waiting loses its
oldest and, while that lasts, some of its rate. So no source can push out another. A reader that was away and
catches up loses nothing. What was lost is counted by source and handed on as `Excess`, once a second.
"""

import heapq
import threading
from collections import Counter, deque
from collections.abc import Callable, Iterator
from typing import Any, NamedTuple

from gcs.contract.limits import LARGEST_BYTES
from gcs.contract.steady import now_ns
from gcs.contract.supervision import log

S = 1_000_000_000
REPORT_S = 1.0  # between two counts of what one source lost
QUIET_S = 2.0  # without loss for so long, it keeps to its limits again
SOURCES = 256  # told apart; who comes after them shares one queue, so that invented names cost no memory
OTHERS = "(others)"
BEHIND_S = 1.0  # a reader whose oldest item has waited for so long is behind
PATIENCE_S = 3.0  # it may be a hiccup; behind for so long, it cannot keep up
GAIN = 0.5  # … unless what waits gets younger by so much of the time: then it catches up
WILD_S = 0.1  # both, where a source is beyond its limits
WILD = 2  # times its burst within a second
EASE_S = 10.0  # abreast for so long, it gets more again
LEAST_SHARE = 1 / 64  # of a source's rate
SLOW = "faster than it can be taken in"
FULL, OVER_LIMIT, LEFT = CAUSES = "queue_full", "over_limit", "not_taken_in"  # as the summary counts them


class Excess(NamedTuple):
    """So many messages of one source are not among those that are handed on."""

    messages: int
    reason: str


class Limits(NamedTuple):
    """What one source may send: so many a second, and so many seconds' worth of that at once."""

    rate_hz: float = float("inf")
    burst_s: float = 1.0


class _Queue:
    """What waits of one source, and what it may still send."""

    def __init__(self, limits: Limits):
        self.waiting: deque[tuple[int, int, str, Any, _Queue]] = deque()  # number, arrival, source, item
        self.limits, self.share = limits, 1.0  # of its rate, that a reader who is behind lets it have
        self.allowance, self.since_s = limits.rate_hz * limits.burst_s, _now_s()
        self.lost: dict[str, int] = {}  # reason → messages, not told yet
        self.lost_s = self.told_s = self.eased_s = -1e9
        self.over = self.wild = False
        self.heard, self.heard_s = 0, self.since_s  # messages in the second that began then

    @property
    def rate_hz(self) -> float:
        return 0.0 if self.wild else self.limits.rate_hz * self.share

    def hear(self, now_s: float) -> bool:
        """Count one message; True when it makes the source a wild one."""
        was, most = self.wild, WILD * self.limits.rate_hz * self.limits.burst_s
        if now_s - self.heard_s >= 1.0:
            self.wild = was and self.heard > self.limits.rate_hz
            self.heard, self.heard_s = 0, now_s
        self.heard += 1
        self.wild = self.wild or self.heard > most
        return self.wild and not was

    def allows(self, now_s: float) -> bool:
        """Token bucket: the allowance grows with time, and each message takes one of it."""
        if self.limits.rate_hz == float("inf"):
            return True
        grown = self.allowance + (now_s - self.since_s) * self.rate_hz
        self.allowance, self.since_s = min(self.rate_hz * self.limits.burst_s, grown), now_s
        if self.allowance < 1.0:
            return False
        self.allowance -= 1.0
        return True

    def lose(self, reason: str, now_s: float) -> None:
        self.lost[reason] = self.lost.get(reason, 0) + 1
        self.lost_s = now_s


class Inbox:
    """See the module's text. ``capacity`` items wait at most; ``limits_of`` gives those of a key's source."""

    def __init__(self, capacity: int, limits_of: Callable[[str], Limits] = lambda _key: Limits()):
        self.lost = Counter(dict.fromkeys(CAUSES, 0))  # messages by cause
        self._capacity, self._limits_of = capacity, limits_of
        self._queues: dict[str, _Queue] = {}
        self._count = self._number = self._kept = 0  # waiting; put so far; last one that was kept for us
        self.arrived_ns = now_ns()  # of the newest item that was taken, or when there was none to take
        self._newest_s = self._abreast_s = self._taken_s = _now_s()
        self._behind_s = 0.0  # how old the oldest item was at _abreast_s
        self._filled = threading.Condition()

    @property
    def age_s(self) -> float:
        """How long the oldest message has waited."""
        with self._filled:
            return self._age_s(_now_s())

    @property
    def idle_s(self) -> float:
        """How long nothing has come."""
        return _now_s() - self._newest_s

    def put(self, source: str, item: Any, size: int, *, kept: bool = False) -> None:
        """Take one item of ``size`` bytes; one that was ``kept`` for us does not count against the rate."""
        with self._filled:
            arrival_ns = now_ns()
            now_s = self._newest_s = arrival_ns / S
            queue = self._queues.get(source) or self._queue(source)
            if not kept and queue.hear(now_s):
                queue.allowance = 0.0
                why = f"more than {queue.limits.rate_hz:g} a second"
                self._drop(queue, len(queue.waiting), now_s, OVER_LIMIT, why)
            if size > LARGEST_BYTES:
                self.lost[OVER_LIMIT] += 1
                queue.lose(f"more than {LARGEST_BYTES} bytes", now_s)
            elif not kept and not queue.allows(now_s):
                self.lost[OVER_LIMIT] += 1
                queue.lose(f"more than {queue.limits.rate_hz * queue.share:g} a second", now_s)
            else:
                if self._count == self._capacity:
                    longest = max(self._queues.values(), key=lambda queue: len(queue.waiting))
                    self._drop(longest, 1, now_s)
                self._number += 1
                self._count += 1
                self._kept = self._number if kept else self._kept
                queue.waiting.append((self._number, arrival_ns, source, item, queue))
            self._filled.notify()

    def take(self, timeout_s: float, most: float = float("inf")) -> list[tuple[str, Any]]:
        """``(source, item)`` in the order they came, before them what was lost; waits for the first.

        Of what came live ``most`` at once; the rest is for the next call.
        """
        with self._filled:
            self._filled.wait_for(lambda: self._count, timeout_s)
            now_s = _now_s()
            self._relieve(now_s)
            losses = list(self._losses(now_s))
            found: list[tuple] = []
            for waiting in heapq.merge(*(queue.waiting for queue in self._queues.values())):
                if len(found) >= most and waiting[0] > self._kept:
                    break
                found.append(waiting)
            for *_, queue in found:
                queue.waiting.popleft()
            self._count -= len(found)
            self.arrived_ns = found[-1][1] if found else now_ns()
        return losses + [(source, item) for _, _, source, item, _ in found]

    def waiting(self, after_ns: int) -> list[tuple[int, str, Any]]:
        """(arrival, source, item) of what came after ``after_ns`` and waits; it is not taken."""
        with self._filled:
            found = list(heapq.merge(*(queue.waiting for queue in self._queues.values())))
        return [one[1:4] for one in found if one[1] > after_ns]

    def leave(self) -> list[tuple[str, Any]]:
        """At the end: all that was lost and is not told yet, and what still waits as lost too."""
        with self._filled:
            for queue in self._queues.values():
                self._drop(queue, len(queue.waiting), _now_s(), LEFT, "the station was stopped before")
                queue.told_s = -1e9
            return list(self._losses(_now_s()))

    def _queue(self, source: str) -> _Queue:
        name = source if len(self._queues) < SOURCES else OTHERS
        return self._queues.setdefault(name, _Queue(self._limits_of(source)))

    def _age_s(self, now_s: float) -> float:
        heads = [queue.waiting[0][1] for queue in self._queues.values() if queue.waiting]
        return now_s - min(heads) / S if heads else 0.0

    def _drop(self, queue: _Queue, count: int, now_s: float, cause: str = FULL, why: str = SLOW) -> None:
        for _ in range(count):
            queue.waiting.popleft()
            queue.lose(why, now_s)
        self._count -= count
        self.lost[cause] += count

    def _relieve(self, now_s: float) -> None:
        """A reader that stays behind gets less of the noisiest source; once it keeps up, more again.

        While a source is beyond its own limits it is that one, and nobody waits to see whether it passes.
        """
        wild = [queue for queue in self._queues.values() if now_s - queue.lost_s < QUIET_S]
        behind_s, patience_s = (WILD_S, WILD_S) if wild else (BEHIND_S, PATIENCE_S)
        age_s, away_s, self._taken_s = self._age_s(now_s), now_s - self._taken_s, now_s
        abreast = age_s < behind_s
        if abreast or away_s > PATIENCE_S:  # where nobody read, that says nothing of how fast it reads
            self._abreast_s, self._behind_s = now_s, age_s
        if abreast:
            for queue in self._queues.values():
                if queue.share < 1.0 and now_s - queue.eased_s > EASE_S:
                    queue.share, queue.eased_s = min(1.0, 2.0 * queue.share), now_s
        elif now_s - self._abreast_s > patience_s:
            gained_s, self._behind_s = self._behind_s - age_s, age_s
            if not wild and gained_s > GAIN * (now_s - self._abreast_s):
                self._abreast_s = now_s
                return
            noisiest = max(wild or self._queues.values(), key=_waiting)
            if noisiest.limits.rate_hz < float("inf"):
                others = (_waiting(queue) for queue in self._queues.values() if queue is not noisiest)
                noisiest.share = max(0.5 * noisiest.share, LEAST_SHARE)
                noisiest.eased_s = self._abreast_s = now_s
                self._drop(noisiest, max(0, _waiting(noisiest) - max(others, default=0)), now_s)

    def _losses(self, now_s: float) -> Iterator[tuple[str, Excess]]:
        for name, queue in self._queues.items():
            if queue.lost and now_s - queue.told_s >= REPORT_S:
                for reason, count in queue.lost.items():
                    yield name, Excess(count, reason)
                if not queue.over:
                    text = "%s: %s; the rest is refused and counted"
                    log.warning(text, _short(name), next(iter(queue.lost)))
                queue.over, queue.told_s, queue.lost = True, now_s, {}
            elif queue.over and not queue.lost and now_s - queue.lost_s > QUIET_S:
                queue.over = False
                log.info("%s keeps to its limits again", _short(name))


def _now_s() -> float:
    return now_ns() / S


def _waiting(queue: _Queue) -> int:
    return len(queue.waiting)


def _short(key: str) -> str:
    """The source in a key, for an operator."""
    return key.rpartition("/")[2]
