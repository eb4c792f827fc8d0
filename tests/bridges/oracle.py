"""The reference for the log reader: pymavlink, message by message; and the ways a log gets damaged."""

import math
import random
from pathlib import Path
from typing import NamedTuple

import numpy as np
import pytest

from bridges.tlog import scan

DATA = Path(__file__).parents[2] / "../shared/data"
SAMPLE = Path(__file__).parents[2] / "logs/sample"
LOGS = sorted([*DATA.glob("*.tlog"), *SAMPLE.glob("*.tlog")])

each_log = pytest.mark.parametrize(
    "log",
    LOGS or [pytest.param(None, marks=pytest.mark.skip(reason=f"no flight logs in {DATA} nor {SAMPLE}"))],
    ids=lambda path: path.stem if path else "none",
)


class Seen(NamedTuple):
    """One message pymavlink decoded with a valid checksum."""

    offset: int  # of its first byte in the file
    receipt_us: int
    message: object


def pymavlink_messages(path: Path) -> tuple[list[Seen], int]:
    """(what pymavlink finds in the log, frames it made of bytes that do not lie together in the file).

    After damage pymavlink takes the next 8 bytes for a stamp wherever it stands, even out of the middle of a
    frame; a frame glued together around that hole is none of the file's.
    """
    from pymavlink import mavutil

    data = path.read_bytes()
    log = mavutil.mavlogfile(str(path))
    seen, glued = [], 0
    while (message := log.recv_msg()) is not None:
        if message.get_type() == "BAD_DATA" or message.get_type().startswith("UNKNOWN"):
            continue
        buffer = bytes(message.get_msgbuf())
        offset = log.f.tell() - log.mav.buf_len() - len(buffer)
        if data[offset : offset + len(buffer)] == buffer:
            seen.append(Seen(offset, round(message._timestamp * 1e6), message))
        else:
            glued += 1
    log.close()
    return seen, glued


def missing(seen: list[Seen], found: np.ndarray) -> list[Seen]:
    """What pymavlink found and the scan has not as a good frame."""
    good = set(found["offset"][found["kind"] == scan.GOOD].tolist())
    return [one for one in seen if one.offset not in good]


def differences(seen: list[Seen], data: np.ndarray, found: np.ndarray, every: int = 1) -> list[str]:
    """Headers and fields that differ, over every ``every``-th message of each kind that both have."""
    found = found[found["kind"] == scan.GOOD]
    by_offset = {one.offset: one.message for one in seen}
    out = []
    for msgid in np.unique(found["msgid"]):
        own = found[found["msgid"] == msgid][::every]
        columns = scan.payloads(data, own, msgid, np.dtype([]))
        lists = {name: columns[name].tolist() for name in columns.dtype.names}
        for i, frame in enumerate(own):
            message = by_offset.get(int(frame["offset"]))
            if message is None:
                continue
            header = (
                message.get_msgId(),
                message.get_srcSystem(),
                message.get_srcComponent(),
                message.get_seq(),
            )
            if header != tuple(frame[name] for name in ("msgid", "sysid", "compid", "seq")):
                out.append(f"{message.get_type()} at {frame['offset']}: header {header}")
            if sorted(lists) != sorted(message.get_fieldnames()):
                out.append(f"{message.get_type()}: fields {sorted(lists)}")
            for name, values in lists.items():
                # text as sent: pymavlink also keeps it cut at the first zero and made ASCII
                theirs = getattr(message, f"_{name}_raw", getattr(message, name))
                if not _equal(theirs, values[i]):
                    out.append(f"{message.get_type()}.{name} at {frame['offset']}: {values[i]!r}")
    return out


def _equal(theirs, ours) -> bool:
    if isinstance(theirs, list):
        return len(theirs) == len(ours) and all(map(_equal, theirs, ours))
    return theirs == ours or (math.isnan(theirs) and math.isnan(ours))


def damaged(data: bytes, seed: int) -> bytes:
    """A piece of a log with bytes flipped, cut out, inserted, zeroed, repeated, and its tail torn off.

    It begins with a whole record: pymavlink finds nothing at all behind a damaged first stamp.
    """
    rng = random.Random(seed)
    size = min(len(data) // 2, 60_000)
    start = rng.randrange(len(data) - size)
    while data[start : start + 2] != data[:2] or data[start + 8] not in (0xFD, 0xFE):
        start -= 1
    out = bytearray(data[start : start + size])
    for _ in range(rng.randint(1, 40)):
        at, length = rng.randrange(30, len(out)), int(2 ** rng.uniform(0, 10))
        kind = rng.choice(["flip", "flip", "cut", "insert", "zero", "repeat"])
        if kind == "flip":
            out[at] ^= 1 << rng.randrange(8)
        elif kind == "cut":
            del out[at : at + length]
        elif kind == "insert":
            out[at:at] = rng.randbytes(length)
        elif kind == "zero":
            out[at : at + length] = bytes(len(out[at : at + length]))
        else:
            out[at:at] = out[at : at + length]
    return bytes(out[: len(out) - rng.randrange(64)])
