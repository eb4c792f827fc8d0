"""The frames of the live MAVLink link as a plain ``.tlog``, which QGroundControl and Mission Planner open.

Record after record: 8 bytes big-endian, the arrival in µs of Unix time, its two lowest bits the number of the
link, here 0; then the frame as it came.
"""

import struct
from pathlib import Path

from gcs.outputs.disk import RunFile, Tell

LINK_BITS = 3


class LinkLog:
    """A new file; its disk may fail."""

    def __init__(self, path: Path, tell: Tell):
        self.file = RunFile(path, tell)

    def take(self, arrival_ns: int, frame: bytes) -> None:
        self.file.write(struct.pack(">Q", arrival_ns // 1000 & ~LINK_BITS) + frame)

    def close(self) -> None:
        self.file.close()
