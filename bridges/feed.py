"""Theodolite and radar feeds: a CSV file after the flight, JSON lines over UDP during it.

==================  ==========================================================================================
``t``               valid time, UTC: Unix seconds, any number of decimals, or ISO 8601 (UTC without a zone)
``range_m``         slant range
``azimuth_deg``     clockwise from true north, or from the zero that the station file states
``elevation_deg``   up from the instrument's horizontal plane
``range_rate_mps``  radar only; positive when going away
``sigma_…``         with any of these four names: 1-sigma noise of this one value, in its unit
==================  ==========================================================================================

CSV: the first line names the columns, in any order. One UDP datagram holds one or more lines, each a JSON
object with these names, ``{"t": 1767225600.123456789, "range_m": 812.4, "azimuth_deg": 12.25}``.
An empty field, ``nan``, ``null`` or a name left out means that the channel has no value; that a sigma is not
given means that the station file's is right. What a value can be: ``gcs/contract/limits.py``. A value whose
own sigma cannot be is refused, since nobody knows then what it is worth.

Rows may be out of order or repeated; that is judged later. A value that cannot be is refused alone, a line
without a time as a whole: each becomes one ``Bad`` that names the line, the column and the reason.
"""

import json
import socket
import sys
import threading
import time
from collections.abc import Iterator
from pathlib import Path
from typing import TYPE_CHECKING, Any

import msgspec
import numpy as np

from bridges.instant import time_ns
from gcs.contract import limits
from gcs.contract.messages import POLAR, Bad, InputError, PolarMeasurement

if TYPE_CHECKING:  # a bridge is given its bus; zenoh is loaded by whoever opens it
    from gcs.contract.wire.bus import Bus

SIGMAS = {f"sigma_{name}": within for name, within in limits.SIGMA.items()}
LIMITS = limits.POLAR | SIGMAS
COLUMNS = ("t", *LIMITS)
CLIP = limits.TEXT
DATAGRAM_BYTES = 65_535  # no UDP datagram is larger
BUFFER_BYTES = 4_000_000  # of the socket, for what comes while the bridge is busy
SO_RXQ_OVFL = 40  # Linux counts datagrams that found the buffer full; asm-generic/socket.h
OVERRUN = "lost before it was read: more datagrams than this machine can take"


class FeedError(InputError):
    """The feed cannot be used; one line with file, line and remedy."""


def read(path: Path, source: str, columns: tuple[str, ...] = COLUMNS) -> tuple[np.ndarray, list[Bad]]:
    """All of a CSV feed: (n,) ``POLAR`` in file order, and what could not be read.

    Raises ``FeedError``: no such file, empty, wrong header.
    """
    path = Path(path)
    try:
        text = path.read_bytes().decode("utf-8-sig", errors="replace")
    except (OSError, ValueError) as error:
        why = getattr(error, "strerror", None) or error
        raise FeedError(f"{path}: {why}; name a CSV file with the header {_valid(columns)}") from None
    lines = text.replace("\r\n", "\n").split("\n")
    header = _header(path, lines[0], columns)
    filled = [(number, line) for number, line in enumerate(lines[1:], 2) if line and not line.isspace()]
    if not filled:
        raise FeedError(f"{path}:1: a header and no measurement below it")

    commas = len(header) - 1
    whole = [(number, line) for number, line in filled if line.count(",") == commas]
    torn = [(number, line) for number, line in filled if line.count(",") != commas]
    cells = ",".join(line for _, line in whole).split(",") if whole else []
    table = {name: cells[column :: len(header)] for column, name in enumerate(header)}
    rows, bad = _parse(table, source, lambda i: f"{path.name}:{whole[i][0]}", lambda i: whole[i][1])
    for number, line in torn:
        reason = f"{line.count(',') + 1} fields where the header names {len(header)}"
        bad.append(Bad(source=source, where=f"{path.name}:{number}", reason=reason, raw=line[:CLIP]))
    return rows, bad


def decode(
    raw: bytes, arrival_ns: int, source: str, where: str, columns: tuple[str, ...] = COLUMNS
) -> list[PolarMeasurement | Bad]:
    """The measurements in one datagram, and what could not be read."""
    lines, objects, bad = [], [], []
    for line in filter(None, map(str.strip, raw.decode("utf-8", errors="replace").split("\n"))):
        fields, reason = _object(line, columns)
        if reason:
            bad.append(Bad(source=source, where=where, reason=reason, raw=line[:CLIP]))
        else:
            lines.append(line)
            objects.append(fields)
    told = {"t"}.union(*objects)
    table = {name: [fields.get(name, "") for fields in objects] for name in columns if name in told}
    rows, refused = _parse(table, source, lambda i: where, lines.__getitem__)
    rows["arrival_ns"] = arrival_ns
    return [*measurements(rows), *bad, *refused]


def measurements(rows: np.ndarray) -> Iterator[PolarMeasurement]:
    """(n,) ``POLAR`` as messages."""
    names = PolarMeasurement.__struct_fields__
    for row in rows.tolist():
        yield PolarMeasurement(**{name: v for name, v in zip(names, row, strict=True) if v == v})


def run(
    bus: "Bus",
    name: str,
    origin: tuple[str, int] | Path,
    stop: threading.Event,
    *,
    columns: tuple[str, ...] = COLUMNS,
    **pace: Any,
) -> None:
    """Put one instrument on ``raw/NAME`` until ``stop`` is set or its file ends.

    ``origin`` is the ``(host, port)`` to listen on for JSON lines, or the path of a CSV file, which is played
    at ``pace``: see ``play``. Raises ``FeedError``.
    """
    if isinstance(origin, tuple):
        with _listen(*origin) as server:
            bus.declare_alive(name)
            for where, raw, lost in _datagrams(server, stop):
                if lost:
                    bus.publish("raw", Bad(source=name, where=where, reason=OVERRUN, count=lost), name)
                for message in decode(raw, time.time_ns(), name, where, columns):
                    bus.publish("raw", message, name)
    else:
        due = timeline(name, *read(origin, name, columns))
        bus.declare_alive(name)
        play(bus, due, stop, **pace)


def timeline(source: str, rows: np.ndarray, bad: list[Bad]) -> list[tuple[int, str, PolarMeasurement | Bad]]:
    """``(due_ns, source, message)`` in file order: a late row is due when its place in the file is."""
    due = np.maximum.accumulate(rows["t_ns"]).tolist()
    first = due[0] if due else 0
    items: list[tuple[int, str, PolarMeasurement | Bad]]
    items = [(t, source, m) for t, m in zip(due, measurements(rows), strict=True)]
    items += [(b.t_ns or first, source, b) for b in bad]
    return sorted(items, key=lambda item: item[0])


def play(
    bus: "Bus",
    due: list[tuple[int, str, PolarMeasurement | Bad]],
    stop: threading.Event,
    *,
    speed: float = 1.0,
    begin_ns: int | None = None,
    now: bool = False,
) -> None:
    """Publish a timeline at ``speed`` times its own pace.

    ``begin_ns`` is the flight time at which this call starts (the first item by default): give the same to
    several bridges to keep them together. Times stay the flight's own; ``now`` moves them to the present,
    so that the flight begins as the call does. Raises ``FeedError`` for a speed that cannot be.
    """
    if not (0 < speed <= limits.FASTEST or speed == float("inf")):
        raise FeedError(f"--speed {speed:g}: expected a number above 0 up to {limits.FASTEST:g}")
    if not due:
        return
    begin_ns = due[0][0] if begin_ns is None else begin_ns
    started, shift_ns = time.monotonic(), time.time_ns() - begin_ns if now else 0
    for due_ns, source, message in due:
        wait_s = (due_ns - begin_ns) * 1e-9 / speed - (time.monotonic() - started)
        if stop.wait(wait_s) if wait_s > 0 else stop.is_set():
            return
        bus.publish("raw", _moved(message, shift_ns) if shift_ns else message, source)


def _parse(table: dict, source: str, where, raw) -> tuple[np.ndarray, list[Bad]]:
    """Columns of text to (n,) ``POLAR`` and ``Bad``; ``where(i)`` and ``raw(i)`` describe row i."""
    stamps = [time_ns(text) for text in table["t"]]
    rows = np.zeros(len(stamps), POLAR)
    rows["t_ns"] = rows["arrival_ns"] = [t or 0 for t in stamps]
    bad = []

    def refuse(i: int, reason: str) -> None:
        bad.append(Bad(source=source, where=where(i), reason=reason, raw=raw(i)[:CLIP], t_ns=stamps[i]))

    for name, within in LIMITS.items():
        texts, of = table.get(name), name.removeprefix("sigma_")
        rows[name] = np.nan if texts is None else _numbers(texts)
        good = np.isnan(rows[name]) | ((rows[name] >= within[0]) & (rows[name] <= within[1]))
        for i in np.flatnonzero(~good).tolist():
            if texts is not None and stamps[i] is not None:
                lost = f", so {of} is refused" if of != name else ""
                said = f"{name}: {texts[i].strip()[:40]!r} is no number from {limits.between(within)}{lost}"
                refuse(i, said)
            rows[name][i] = rows[of][i] = np.nan
    timeless = [i for i, t in enumerate(stamps) if t is None]
    for i in timeless:
        refuse(i, f"t: {table['t'][i].strip()[:40]!r} is neither Unix seconds nor ISO 8601 from 2000 to 2099")
    return np.delete(rows, timeless), bad


def _numbers(texts) -> np.ndarray:
    """(n,) NaN where there is no value, infinite where there is no number."""
    try:
        return np.array(list(map(float, texts)))
    except ValueError:
        return np.array([_number(text) for text in texts])


def _number(text: str) -> float:
    try:
        return float(text)
    except ValueError:
        return np.inf if text.strip() else np.nan


def _object(line: str, columns: tuple[str, ...]) -> tuple[dict[str, str], str]:
    """The fields of one JSON line as text, so that no digit of the time is lost; or why there are none."""
    try:
        fields = json.loads(line, parse_float=str, parse_int=str, parse_constant=str)
    except (ValueError, RecursionError):
        return {}, "no JSON object"
    if not isinstance(fields, dict):
        return {}, "no JSON object"
    unknown = [name for name in fields if name not in columns]
    if unknown:
        return {}, f"unknown name {unknown[0][:40]!r}; valid names are {_valid(columns)}"
    return {name: "" if value is None else str(value) for name, value in fields.items()}, ""


def _header(path: Path, line: str, columns: tuple[str, ...]) -> list[str]:
    names = [name.strip() for name in line.split(",")]
    if not line.strip():
        raise FeedError(f"{path}:1: empty; the first line must be a header of {_valid(columns)}")
    for name in names:
        if name not in columns:
            raise FeedError(f"{path}:1: unknown column {name[:40]!r}; valid columns are {_valid(columns)}")
        if names.count(name) > 1:
            raise FeedError(f"{path}:1: column {name!r} is there twice; keep one")
    values = [name for name in columns if name in limits.POLAR]
    if "t" not in names or not set(values) & set(names):
        raise FeedError(f"{path}:1: needs column t and at least one of {_valid(values)}")
    return names


def _valid(columns) -> str:
    return ", ".join(columns)


def _moved(message, shift_ns: int):
    times = {name: getattr(message, name, None) for name in ("t_ns", "arrival_ns")}
    return msgspec.structs.replace(message, **{n: t + shift_ns for n, t in times.items() if t is not None})


def _listen(host: str, port: int) -> socket.socket:
    server = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
    try:
        server.bind((host, port))
    except (OSError, OverflowError, TypeError, ValueError) as error:  # names that cannot be resolved too
        server.close()
        why = getattr(error, "strerror", None) or "give a host, and a port from 0 to 65535"
        raise FeedError(f"udp {host}:{port}: {why}; choose another address or port") from None
    server.setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, BUFFER_BYTES)  # the kernel gives what it allows
    if sys.platform == "linux":
        server.setsockopt(socket.SOL_SOCKET, SO_RXQ_OVFL, 1)
    server.settimeout(0.1)  # how long a stop may take
    return server


def _datagrams(server: socket.socket, stop: threading.Event) -> Iterator[tuple[str, bytes, int]]:
    """Where each datagram came in, the datagram, and how many before it found the socket's buffer full."""
    host, port = server.getsockname()
    count = lost = 0
    while not stop.is_set():
        try:
            raw, ancillary, _, _ = server.recvmsg(DATAGRAM_BYTES, socket.CMSG_SPACE(4))
        except TimeoutError:
            continue
        count += 1
        so_far = [int.from_bytes(data, sys.byteorder) for _, kind, data in ancillary if kind == SO_RXQ_OVFL]
        missing = (so_far[0] - lost) % 2**32 if so_far else 0
        lost += missing
        yield f"udp {host}:{port} #{count}", raw, missing
