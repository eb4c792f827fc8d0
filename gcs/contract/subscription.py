"""Samples from the bus until their reader takes them, as messages."""

import threading
import time
from collections import deque
from typing import Any

import msgspec

from gcs.contract.holders import OTHER, Holders
from gcs.contract.messages import ANY, Bad, decode

NOT_OURS = (msgspec.DecodeError, UnicodeDecodeError, RecursionError)  # all that decoding strange bytes raises


class Subscription:
    """A bounded queue of samples: the newest ``capacity`` wait here until drained, older ones are counted."""

    def __init__(self, capacity: int):
        self.dropped = 0  # messages lost because the queue was full
        self.undecodable = 0  # payloads that are none of ours
        self.missed = 0  # messages lost on the way and no longer kept by their publisher
        self._queue: deque[tuple[float, Any, bool]] = deque(maxlen=capacity)
        self._early: list[Any] | None = []  # live samples that wait for the history
        self._newest: dict[tuple, int] = {}  # last sample number taken from each publisher
        self.holders = Holders()
        self._filled = threading.Condition()

    @property
    def age_s(self) -> float:
        """How long the oldest queued message has waited, for health only (monotonic clock)."""
        with self._filled:
            return time.monotonic() - self._queue[0][0] if self._queue else 0.0

    def drain(self, timeout_s: float = 0.1) -> list[tuple[str, ANY]]:
        """All queued ``(source, message)`` in arrival order; waits at most ``timeout_s`` for the first.

        A payload on ``raw/*`` that is none of ours comes out as ``Bad``, so that it gets its verdict;
        on other keys it is only counted.
        """
        with self._filled:
            self._filled.wait_for(lambda: self._queue, timeout_s)
            samples = list(self._queue)
            self._queue.clear()
        return [pair for _, sample, ours in samples if (pair := self._decode(sample, ours=ours))]

    def _push(self, sample: Any) -> None:
        # Zenoh's thread: a slow callback would stall every key of the session, so nothing else happens here.
        with self._filled:
            if self._early is None:
                self._take(sample)
            else:
                self._early.append(sample)

    def _begin(self, history: list[Any]) -> None:
        with self._filled:
            for sample in history + (self._early or []):
                self._take(sample)
            self._early = None

    def _take(self, sample: Any) -> None:
        publisher = None
        if info := sample.source_info:  # a plain publisher's samples have none
            publisher = str(info.source_id.zid), info.source_id.eid
            if info.source_sn <= self._newest.get(publisher, -1):
                return  # came with the history
            self._newest[publisher] = info.source_sn
        self.dropped += len(self._queue) == self._queue.maxlen
        ours = self.holders.admit(str(sample.key_expr), publisher)
        self._queue.append((time.monotonic(), sample, ours))
        self._filled.notify()

    def _count_miss(self, miss: Any) -> None:
        self.missed += miss.nb

    def _decode(self, sample: Any, *, ours: bool) -> tuple[str, ANY] | None:
        key, payload = str(sample.key_expr), sample.payload.to_bytes()
        _, _, subject, source = (key + "/").split("/")[:4]
        if not ours:
            return (source, Bad(source=source, where=key, reason=OTHER)) if subject == "raw" else None
        try:
            return source, decode(payload, str(sample.encoding))
        except NOT_OURS as error:
            self.undecodable += 1
            if subject != "raw":
                return None
            clipped = payload[:200].decode(errors="replace")
            return source, Bad(source=source, where=key, reason=str(error), raw=clipped)
