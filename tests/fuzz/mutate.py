"""Seeded damage to bytes that remembers where each surviving byte came from.

So a test knows which frames of a log nobody touched, without asking the code under test.
"""

import random
import struct
from typing import NamedTuple

import numpy as np
from pymavlink.dialects.v20 import ardupilotmega as dialect
from pymavlink.generator.mavcrc import x25crc

STAMP = 8
FOREIGN = -1  # the origin of a byte that is not, or no longer, the original's
NUMBERS = (0, 1, 127, 128, 255, 2**15, 2**16 - 1, 2**31 - 1, 2**31, 2**32 - 1, 2**63 - 1, 2**64 - 1)
FLOATS = (float("nan"), float("inf"), -float("inf"), 0.0, 1e38, -1e38, 1e-40)
US_PER_S = 1_000_000
APART_S = (1, 10, 3_600, 86_400, 366 * 86_400, 4_000 * 86_400)  # how far a stamp is moved


class Bytes(NamedTuple):
    """Some bytes, and where in the original each was."""

    data: np.ndarray  # (n,) uint8
    origin: np.ndarray  # (n,) int64, FOREIGN for what was changed or put in

    def part(self, begin: int, end: int | None = None) -> "Bytes":
        return Bytes(self.data[begin:end], self.origin[begin:end])


def whole(data: np.ndarray) -> Bytes:
    """(n,) uint8, not yet damaged."""
    return Bytes(data.copy(), np.arange(data.size))


def foreign(data: bytes) -> Bytes:
    return Bytes(np.frombuffer(data, np.uint8), np.full(len(data), FOREIGN, np.int64))


def joined(*parts: Bytes) -> Bytes:
    return Bytes(*(np.concatenate(column) for column in zip(*parts, strict=True)))


def replaced(at: int, data: bytes, of: Bytes) -> Bytes:
    """``data`` written over what stands at ``at``."""
    return joined(of.part(0, at), foreign(data), of.part(at + len(data)))


def untouched(of: Bytes, begins: np.ndarray, lengths: np.ndarray) -> dict[int, list[int]]:
    """Which pieces of the original are whole: begin in the original → every place where it is now."""
    breaks = np.flatnonzero((np.diff(of.origin) != 1) | (of.origin[1:] == FOREIGN)) + 1
    ends = np.append(breaks, of.data.size)
    length_of = dict(zip(begins.tolist(), lengths.tolist(), strict=True))
    found: dict[int, list[int]] = {}
    for at in np.flatnonzero(np.isin(of.origin, begins)).tolist():
        begin = int(of.origin[at])
        if at + length_of[begin] <= ends[np.searchsorted(ends, at, "right")]:
            found.setdefault(begin, []).append(at)
    return found


def damage(of: Bytes, begins: np.ndarray, rng: random.Random, times: int) -> Bytes:
    """``times`` kinds of damage at random; ``begins`` (k,) is where the original's frames start."""
    kinds = (flip, flip, cut, insert, zero, repeat, swap, stamp, stamp, shift, forge)
    for _ in range(times):
        if of.data.size < 64:
            break
        of = rng.choice(kinds)(of, begins, rng)
    return of.part(0, of.data.size - rng.randrange(40)) if rng.random() < 0.5 else of


def flip(of: Bytes, begins: np.ndarray, rng: random.Random) -> Bytes:
    at = rng.randrange(of.data.size)
    return replaced(at, bytes([int(of.data[at]) ^ 1 << rng.randrange(8)]), of)


def cut(of: Bytes, begins: np.ndarray, rng: random.Random) -> Bytes:
    begin, end = _span(of, rng)
    return joined(of.part(0, begin), of.part(end))


def insert(of: Bytes, begins: np.ndarray, rng: random.Random) -> Bytes:
    begin, end = _span(of, rng)
    return joined(of.part(0, begin), foreign(rng.randbytes(end - begin)), of.part(begin))


def zero(of: Bytes, begins: np.ndarray, rng: random.Random) -> Bytes:
    begin, end = _span(of, rng)
    return replaced(begin, bytes([rng.choice((0, 255))]) * (end - begin), of)


def repeat(of: Bytes, begins: np.ndarray, rng: random.Random) -> Bytes:
    """A block once more, right behind itself or anywhere."""
    begin, end = _span(of, rng)
    again = end if rng.random() < 0.5 else rng.randrange(of.data.size)
    return joined(of.part(0, again), of.part(begin, end), of.part(again))


def swap(of: Bytes, begins: np.ndarray, rng: random.Random) -> Bytes:
    """Two blocks change places."""
    a, b, c, d = sorted(rng.randrange(of.data.size) for _ in range(4))
    return joined(of.part(0, a), of.part(c, d), of.part(b, c), of.part(a, b), of.part(d))


def stamp(of: Bytes, begins: np.ndarray, rng: random.Random) -> Bytes:
    """One record's receipt time: random, nothing, all ones, or moved."""
    at = _frame(of, begins, rng) - STAMP
    if at < 0:
        return of
    now = int.from_bytes(of.data[at : at + STAMP].tobytes(), "big")
    moved = (now + rng.choice((-1, 1)) * rng.choice(APART_S) * US_PER_S) % 2**64
    return replaced(at, rng.choice((rng.getrandbits(64), 0, 2**64 - 1, moved)).to_bytes(STAMP, "big"), of)


def shift(of: Bytes, begins: np.ndarray, rng: random.Random) -> Bytes:
    """The receiver's clock jumps: every later stamp is moved alike."""
    places = np.flatnonzero(np.isin(of.origin, begins))
    places = places[places >= max(STAMP, rng.randrange(of.data.size))]
    data, origin = of.data.copy(), of.origin.copy()
    columns = places[:, None] + np.arange(-STAMP, 0)
    stamps = np.ascontiguousarray(data[columns]).view(">u8")
    step = np.uint64(rng.choice((-1, 1)) * rng.choice(APART_S) * US_PER_S % 2**64)
    data[columns] = (stamps + step).astype(">u8").view(np.uint8).reshape(-1, STAMP)
    origin[columns] = FOREIGN
    return Bytes(data, origin)


def forge(of: Bytes, begins: np.ndarray, rng: random.Random) -> Bytes:
    """A frame says something else, and its checksum is right: damage on the way into the recorder."""
    at = _frame(of, begins, rng)
    head = 10 if of.data[at] == 0xFD else 6
    length = int(of.data[at + 1]) if at + 1 < of.data.size else 0
    frame = bytearray(of.data[at : at + head + length + 2].tobytes())
    if len(frame) < head + length + 2 or not length:
        return of
    field = rng.randrange(length)
    value = rng.choice(
        (
            rng.randbytes(rng.choice((1, 2, 4, 8))),
            struct.pack("<Q", rng.choice(NUMBERS)),
            struct.pack("<f", rng.choice(FLOATS)),
        )
    )[: length - field]
    frame[head + field : head + field + len(value)] = value
    sealed = seal(bytes(frame[: head + length]))
    return replaced(at, sealed, of) if sealed else of


def seal(frame: bytes) -> bytes | None:
    """A frame without its checksum, with the right one; None for a message that the dialect has not."""
    msgid = int.from_bytes(frame[7:10], "little") if frame[0] == 0xFD else frame[5]
    message = dialect.mavlink_map.get(msgid)
    if message is None:
        return None
    return frame + x25crc(frame[1:] + bytes([message.crc_extra])).crc.to_bytes(2, "little")


def _span(of: Bytes, rng: random.Random) -> tuple[int, int]:
    """A block, mostly short, now and then a tenth of all."""
    longest = np.log2(max(of.data.size / 10, 2.0))
    begin = rng.randrange(of.data.size)
    return begin, min(of.data.size, begin + int(2 ** rng.uniform(0.0, longest)))


def _frame(of: Bytes, begins: np.ndarray, rng: random.Random) -> int:
    """Where one of the original's frames starts now; 0 where there is none left."""
    places = np.flatnonzero(np.isin(of.origin, begins))
    return int(places[rng.randrange(places.size)]) if places.size else 0
