"""Seeded damage to text and to bytes: what a broken, careless or hostile sender could put on a wire."""

import random

SPLIT = (",", "\n", "=", ":", '"', " ", ".", "{", "[")
TOKENS = (
    *("", "nan", "inf", "-inf", "NaN", "null", "true", "None", "-0", "1e308", "1e309", "-1e400", "1e-400"),
    *("0x10", "1_000", "٣", "½", "１２", "1.2.3", "--5", "+-5", "9" * 20, "9" * 400, "0." + "3" * 400),
    *("1767225600", "-1", "4102444800", "946684799.999999999", "2026-01-01T00:00:00Z", "2026-13-45T99:00:00"),
    *("20260101T000000", "2026-01-01T00:00:00+99:99", "1969-12-31T23:59:59Z", "9999-12-31T23:59:59.9-23:59"),
    *('"', "'", "\\", "\x00", "﻿", "\r", "\n", "\t", "\u2028", "\U0001f6f8", "\ud800", "%s%n", "=1+1"),
    *(
        "{",
        "}",
        "[",
        "]",
        "[" * 50,
        '{"t":' * 50,
        "range_m",
        "t",
        "type",
        "sigma_range_m",
        "../../etc/passwd",
    ),
)


def mangled(data: bytes, rng: random.Random, times: int) -> bytes:
    """``times`` changes: bits, blocks, lines, and fields put in place of others."""
    for _ in range(times):
        data = rng.choice((_bits, _block, _field, _field, _field, _lines))(data, rng)
    return data


def _bits(data: bytes, rng: random.Random) -> bytes:
    out = bytearray(data or b"\0")
    for _ in range(rng.choice((1, 1, 1, 8))):
        out[rng.randrange(len(out))] = rng.randrange(256)
    return bytes(out)


def _block(data: bytes, rng: random.Random) -> bytes:
    """Cut out, put in, repeated or torn off."""
    begin = rng.randrange(len(data) + 1)
    end = min(len(data), begin + int(2 ** rng.uniform(0.0, 8.0)))
    middle = rng.choice((b"", rng.randbytes(end - begin), 2 * data[begin:end], bytes(end - begin)))
    return data[:begin] + middle if rng.random() < 0.2 else data[:begin] + middle + data[end:]


def _field(data: bytes, rng: random.Random) -> bytes:
    """What stands between two separators becomes something else."""
    separator = rng.choice(SPLIT).encode()
    parts = data.split(separator)
    parts[rng.randrange(len(parts))] = rng.choice(TOKENS).encode(errors="surrogatepass")
    return separator.join(parts)


def _lines(data: bytes, rng: random.Random) -> bytes:
    """Lines in another order, twice, or ended otherwise."""
    lines = data.split(b"\n")
    rng.choice((rng.shuffle, lambda all_: all_.extend(all_[:3]), lambda all_: all_.pop()))(lines)
    return rng.choice((b"\n", b"\n", b"\r\n", b"\r", b"\n\n")).join(lines)
