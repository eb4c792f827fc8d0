"""Messages on their way to the bus: a reader there that stalls keeps this queue waiting, not the fusion."""

import threading
from collections import deque

from gcs.contract.messages import ANY
from gcs.contract.supervision import log
from gcs.outputs.publish import Target

MOST = 20_000  # messages: some 20 s of a flight; a reader that stalls is cut off after one
POLL_S = 0.1


class Outbox:
    """A target that hands on, in order and in a thread of its own: see `run`."""

    def __init__(self, send: Target):
        self.dropped = 0  # the oldest, because nobody took them
        self._send = send
        self._waiting: deque[tuple[str, ANY, str]] = deque()
        self._filled = threading.Condition()

    def __call__(self, subject: str, message: ANY, source: str = "") -> None:
        """Take a message; any thread may call, and none waits."""
        with self._filled:
            if full := len(self._waiting) == MOST:
                self._waiting.popleft()
                self.dropped += 1
            self._waiting.append((subject, message, source))
            self._filled.notify()
        if full:
            log.warning("publishing is stalled: the oldest messages are lost to readers on the bus")

    def run(self, stop: threading.Event) -> None:
        """Send until ``stop``, and then what is left."""
        while not stop.is_set() or self._waiting:
            with self._filled:
                self._filled.wait_for(lambda: self._waiting, POLL_S)
                due, self._waiting = self._waiting, deque()
            while due:
                try:
                    self._send(*due.popleft())
                except BaseException:  # raised again; the messages after this one still go out
                    with self._filled:
                        due.extend(self._waiting)
                        self._waiting = due
                    raise
                stop.is_set()  # a heartbeat: each message may have to wait
