"""Who writes a key: one publisher at a time, the first, until it is gone.

A second one on the same key is a bridge that was started twice, or a forgery; to take both would mix two
instruments, or a true and a false one. The holder gives way when its own token says that it has ended, which
is seen within milliseconds of a kill and within two seconds of a hang, or when it has been silent for
``QUIET_S`` while another speaks: a publisher without a token leaves no other sign. A bridge that was started
again is thus taken at once.
"""

import time
from collections import Counter
from collections.abc import Hashable

QUIET_S = 5.0  # longer than the scan of the slowest radars
AGAIN_S = 60.0  # two that last are told again after so long
OTHER = "from a second publisher of this key, while the first goes on"


class Holders:
    """Of all keys of a subscription. Times are of a monotonic clock."""

    def __init__(self) -> None:
        self.refused: Counter[str] = Counter()  # messages by key
        self.told: list[tuple[str, str]] = []  # (level, text), for whoever takes it
        self._held: dict[str, tuple[Hashable, float]] = {}  # key → who, and when it last spoke
        self._told_s: dict[str, float] = {}

    def admit(self, key: str, publisher: Hashable, now_s: float | None = None) -> bool:
        """Is this message from the holder of its key, or from the next one?"""
        now_s = time.monotonic() if now_s is None else now_s
        holder, spoke_s = self._held.get(key, (publisher, now_s))
        if holder != publisher and now_s - spoke_s <= QUIET_S:
            self.refused[key] += 1
            if now_s - self._told_s.get(key, -AGAIN_S) >= AGAIN_S:
                self._told_s[key] = now_s
                text = f"{_source(key)}: two publishers write it; the first is kept, end the other one"
                self.told.append(("error", text))
            return False
        if holder != publisher:
            self.told.append(
                ("warning", f"{_source(key)}: the first publisher is silent, the other is taken")
            )
        self._held[key] = publisher, now_s
        return True

    def left(self, key: str, publisher: Hashable) -> None:
        """A publisher's token is gone."""
        held = self._held.get(key)
        if held and held[0] == publisher:
            self._held.pop(key, None)
            self._told_s.pop(key, None)


def _source(key: str) -> str:
    return key.rsplit("/", 1)[1]
