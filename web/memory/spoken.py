"""What comes once a second, kept to be looked up by time."""

import zlib
from bisect import bisect_right
from collections import deque
from typing import Generic, TypeVar

import msgspec

MOST = 15_000  # four hours of one a second; then the oldest are forgotten
Message = TypeVar("Message", bound=msgspec.Struct)


class Spoken(Generic[Message]):
    """Messages of one ``kind`` with a ``t_ns``; kept as what differs from the first one."""

    def __init__(self, kind: type[Message]):
        self._decode = msgspec.msgpack.Decoder(kind).decode
        self._first = b""
        self._times: deque[int] = deque(maxlen=MOST)
        self._kept: deque[bytes] = deque(maxlen=MOST)

    def add(self, t_ns: int, message: Message) -> None:
        """What has a later time is forgotten: before the first data it was not the flight's clock."""
        while self._times and self._times[-1] >= t_ns:
            self._times.pop()
            self._kept.pop()
        self._times.append(t_ns)
        said = msgspec.msgpack.encode(message)
        self._first = self._first or said
        packer = zlib.compressobj(zdict=self._first)
        self._kept.append(packer.compress(said) + packer.flush())

    def at(self, t_ns: int) -> Message | None:
        """The newest one up to that time."""
        number = bisect_right(self._times, t_ns)
        if not number:
            return None
        return self._decode(zlib.decompressobj(zdict=self._first).decompress(self._kept[number - 1]))

    def clear(self) -> None:
        self._first = b""
        self._times.clear()
        self._kept.clear()
