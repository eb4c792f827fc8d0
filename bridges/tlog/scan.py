"""MAVLink frames in a file of bytes: where they are, and their fields as columns.

A tlog is a row of records: 8 bytes big-endian receipt time in µs, then one MAVLink 1 or 2 frame.
Frame layout, checksum (X.25 with CRC_EXTRA) and zero truncation: https://mavlink.io/en/guide/serialization.html

A frame is good when its checksum is. The scan steps from frame to frame; after damage it tries every byte,
so it finds each good frame wherever the record before it ends. The rules that keep it from being led astray:

    a frame that cannot be checked (unknown message) or fails its checksum is stepped over only where the next
    record starts right behind it and no good frame lies inside it;
    a good frame met while searching, with no record behind it, gives way to one inside it that has.
"""

from collections.abc import Mapping
from functools import cache
from typing import Any, NamedTuple

import numpy as np
from numba import njit

STAMP = 8
NONE, GOOD, UNKNOWN, BAD_CRC = range(4)
_V1, _V2, _SIGNED = 0xFE, 0xFD, 0x01
_REPEAT = 128  # a sender's sequence number returns after 256 of its frames; a second link's copy comes sooner

FRAME = np.dtype(
    [
        ("offset", "i8"),  # of the first byte of the frame, behind the stamp
        ("receipt_us", "i8"),  # the stamp as it stands, -1 where damage left no room for one
        ("msgid", "i4"),
        ("length", "i2"),  # of the payload as sent, trailing zeros cut off
        ("kind", "u1"),  # GOOD | UNKNOWN | BAD_CRC
        ("version", "u1"),  # 1 | 2
        ("sysid", "u1"),
        ("compid", "u1"),
        ("seq", "u1"),
        ("duplicate", "?"),  # the same frame came before, by another link
    ],
    align=True,
)


class Dialect(NamedTuple):
    """What pymavlink ships about the messages: the union ArduPilot uses, ``common`` included."""

    crc_extra: np.ndarray  # (largest id + 1,) int16, -1 for ids that are not in it
    boot_ms_at: np.ndarray  # (largest id + 1,) int16, where in the payload time_boot_ms is, -1 for nowhere
    ids: dict[str, int]
    names: dict[int, str]
    layouts: dict[int, np.dtype]  # payload in wire order, packed, little-endian


@cache
def dialect() -> Dialect:
    """The tables of ``pymavlink.dialects.v20.ardupilotmega``."""
    from pymavlink.dialects.v20.ardupilotmega import mavlink_map

    layouts = {msgid: _layout(message) for msgid, message in mavlink_map.items()}
    crc_extra = np.full(max(mavlink_map) + 1, -1, np.int16)
    boot_ms_at = np.full_like(crc_extra, -1)
    for msgid, message in mavlink_map.items():
        crc_extra[msgid] = message.crc_extra
        if "time_boot_ms" in message.fieldnames:
            boot_ms_at[msgid] = _field(layouts[msgid], "time_boot_ms")[1]
    names = {msgid: message.msgname for msgid, message in mavlink_map.items()}
    return Dialect(crc_extra, boot_ms_at, {name: msgid for msgid, name in names.items()}, names, layouts)


_TYPES = {
    f"{sign}int{8 * size}_t": f"<{sign[:1] or 'i'}{size}" for sign in ("u", "") for size in (1, 2, 4, 8)
}
_TYPES |= {"float": "<f4", "double": "<f8"}


def _field(layout: np.dtype, name: str) -> tuple:
    """(dtype, offset) of one field."""
    fields: Mapping[str, tuple] = layout.fields or {}
    return fields[name]


def _layout(message: Any) -> np.dtype:
    """Payload dtype of one pymavlink message class."""
    types = dict(zip(message.fieldnames, message.fieldtypes, strict=True))
    fields: list[tuple] = []
    for name, length in zip(message.ordered_fieldnames, message.array_lengths, strict=True):
        if types[name] == "char":
            fields.append((name, f"S{max(length, 1)}"))
        else:
            fields.append((name, _TYPES[types[name]], (length,)) if length else (name, _TYPES[types[name]]))
    return np.dtype(fields)


def scan(data: np.ndarray) -> np.ndarray:
    """(n,) FRAME of ``data`` ((bytes,) uint8), in file order: good ones and those stepped over whole."""
    room = count = data.size // 32
    while count >= room:
        room = count + 1
        frames = np.empty(room, FRAME)
        count = _scan(data, dialect().crc_extra, _CRC_TABLE, frames)
    frames = frames[:count]
    _mark_duplicates(data, frames)
    return frames


def payloads(data: np.ndarray, frames: np.ndarray, msgid: int, extra: np.dtype) -> np.ndarray:
    """(n,) structured: the fields of ``frames``, all of message ``msgid``, then ``extra`` fields as zeros."""
    layout = dialect().layouts[msgid]
    both = [*((name, _field(layout, name)[0]) for name in layout.fields or ()), *extra.descr]
    out = np.zeros(frames.size, both)
    _gather(data, frames["offset"], frames["version"], frames["length"], layout.itemsize, out.view(np.uint8))
    return out


@njit(cache=True)
def sizes(data, frames):
    """(n,) int64: length of each frame in bytes, checksum and signature included, stamp not."""
    out = np.empty(frames.size, np.int64)
    for i in range(frames.size):
        out[i] = _size(data, frames[i].offset)
    return out


@njit(cache=True)
def boot_times(data, frames, boot_ms_at, sysid, compid):
    """(n,) int64: ``time_boot_ms`` of each usable frame of one sender, -1 where its message has none."""
    out = np.full(frames.size, -1, np.int64)
    for i in range(frames.size):
        frame = frames[i]
        if frame.kind != GOOD or frame.duplicate or frame.sysid != sysid or frame.compid != compid:
            continue
        at = boot_ms_at[frame.msgid]
        if at >= 0:
            start = frame.offset + (10 if frame.version == 2 else 6)
            out[i] = 0
            for k in range(4):
                if at + k < frame.length:
                    out[i] |= np.int64(data[start + at + k]) << (8 * k)
    return out


def _crc_table() -> np.ndarray:
    """(4, 256) int64: CRC-16/MCRF4XX (X.25, reflected 0x8408) of a byte and k zeros (slicing by four)."""
    table = np.zeros((4, 256), np.int64)
    table[0] = np.arange(256)
    for _ in range(8):
        table[0] = np.where(table[0] & 1, (table[0] >> 1) ^ 0x8408, table[0] >> 1)
    for k in range(1, 4):
        table[k] = (table[k - 1] >> 8) ^ table[0][table[k - 1] & 0xFF]
    return table


_CRC_TABLE = _crc_table()


@njit(cache=True)
def _size(data, at):
    if data[at] == _V1:
        return 8 + data[at + 1]
    return (25 if data[at + 2] & _SIGNED else 12) + data[at + 1]


@njit(cache=True)
def _judge(data, at, crc_extra, table):
    """(kind, end) of the frame that would start at ``at``; (NONE, at) where none can."""
    left = data.size - at
    if left < 8 or (data[at] != _V1 and data[at] != _V2) or (data[at] == _V2 and left < 12):
        return NONE, at
    end = at + _size(data, at)
    if end > data.size or (data[at] == _V2 and data[at + 2] & ~_SIGNED):
        return NONE, at
    if data[at] == _V1:
        msgid, checked = np.int64(data[at + 5]), at + 6 + data[at + 1]
    else:
        msgid = np.int64(data[at + 7]) | np.int64(data[at + 8]) << 8 | np.int64(data[at + 9]) << 16
        checked = at + 10 + data[at + 1]
    if msgid >= crc_extra.size or crc_extra[msgid] < 0:
        return UNKNOWN, end
    crc, i = 0xFFFF, at + 1
    while i + 4 <= checked:
        low, high = (crc & 0xFF) ^ data[i], (crc >> 8) ^ data[i + 1]
        crc = table[3, low] ^ table[2, high] ^ table[1, data[i + 2]] ^ table[0, data[i + 3]]
        i += 4
    while i < checked:
        crc = (crc >> 8) ^ table[0, (crc & 0xFF) ^ data[i]]
        i += 1
    crc = (crc >> 8) ^ table[0, (crc & 0xFF) ^ crc_extra[msgid]]
    return (GOOD if crc == data[checked] | data[checked + 1] << 8 else BAD_CRC), end


@njit(cache=True)
def _followed(data, end):
    """Does a record start at ``end``, or the file end there?"""
    return end + STAMP >= data.size or data[end + STAMP] == _V1 or data[end + STAMP] == _V2


@njit(cache=True)
def _rival(data, start, stop, must_be_followed, crc_extra, table):
    """Does a good frame start in [start, stop)?"""
    for at in range(start, stop):
        kind, end = _judge(data, at, crc_extra, table)
        if kind == GOOD and (_followed(data, end) or not must_be_followed):
            return True
    return False


@njit(cache=True)
def _scan(data, crc_extra, table, frames):
    """Fill ``frames`` as far as it goes; returns how many there are."""
    count, previous_end = 0, 0
    at, in_step = STAMP, True
    while at < data.size:
        kind, end = _judge(data, at, crc_extra, table)
        if kind == GOOD:
            take = in_step or _followed(data, end) or not _rival(data, at + 1, end, True, crc_extra, table)
        else:
            take = kind != NONE and in_step and _followed(data, end)
            take = take and not _rival(data, previous_end, end, False, crc_extra, table)
        if take:
            if count < frames.size:
                _describe(data, at, kind, at - STAMP >= previous_end, frames, count)
            count += 1
            previous_end = end
            at, in_step = end + STAMP, True
        elif in_step:
            at, in_step = previous_end, False  # a lost stamp lets the next frame start before its place
        else:
            at += 1
    return count


@njit(cache=True)
def _describe(data, at, kind, has_stamp, frames, i):
    stamp = np.int64(-1)
    if has_stamp and data[at - STAMP] < 128:
        stamp = np.int64(0)
        for k in range(at - STAMP, at):
            stamp = stamp << 8 | np.int64(data[k])
    version = 2 if data[at] == _V2 else 1
    head = at + (4 if version == 2 else 2)
    msgid = np.int32(data[head + 3])
    if version == 2:
        msgid |= np.int32(data[head + 4]) << 8 | np.int32(data[head + 5]) << 16
    frame = frames[i]
    frame.offset, frame.receipt_us = at, stamp
    frame.msgid, frame.length, frame.kind = msgid, data[at + 1], kind
    frame.version = version
    frame.seq, frame.sysid, frame.compid = data[head], data[head + 1], data[head + 2]
    frame.duplicate = False


@njit(cache=True)
def _mark_duplicates(data, frames):
    """Set ``duplicate`` where a sender's frame with the same sequence number and bytes came just before."""
    slots = np.full(1 << 16, -1, np.int32)  # sender → column of the tables below
    sent = np.zeros(1 << 16, np.int64)  # frames of each sender so far
    last = np.full((16, 256), -1, np.int64)  # newest frame with this sequence number
    rank = np.zeros(frames.size, np.int64)
    senders = 0
    for i in range(frames.size):
        frame = frames[i]
        sender = np.int32(frame.sysid) << 8 | np.int32(frame.compid)
        if slots[sender] < 0:
            slots[sender] = senders
            senders += 1
            if senders > last.shape[0]:
                last = np.concatenate((last, np.full_like(last, -1)))
        sent[sender] += 1
        rank[i] = sent[sender]
        j = last[slots[sender], frame.seq]
        if j >= 0 and rank[i] - rank[j] < _REPEAT:
            frame.duplicate = _same(data, frames[j].offset, frame.offset)
        last[slots[sender], frame.seq] = i


@njit(cache=True)
def _same(data, a, b):
    return np.array_equal(data[a : a + _size(data, a)], data[b : b + _size(data, b)])


@njit(cache=True)
def _gather(data, offset, version, length, size, out):
    width = out.size // max(offset.size, 1)
    for i in range(offset.size):
        start = offset[i] + (10 if version[i] == 2 else 6)
        for k in range(min(length[i], size)):
            out[i * width + k] = data[start + k]
