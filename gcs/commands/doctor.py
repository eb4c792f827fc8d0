"""Checks before a flight: one line each, what is wrong and what to do."""

import importlib.metadata
import ipaddress
import json
import os
import re
import shutil
import socket
import struct
import sys
import time
from collections.abc import Iterator
from pathlib import Path

from rich.text import Text

from gcs.commands.options import Config, StationFile
from gcs.contract import config as configuration
from gcs.contract.messages import InputError
from gcs.outputs.console import screen

PACKAGES = ("numpy", "numba", "pymavlink", "filterpy", "eclipse-zenoh", "viser", "msgspec")
WIDE = ": every machine that reaches it can use it; use 127.0.0.1, or see docs/security"
MARKS = {
    True: Text("ok  ", style="green"),
    None: Text("WARN", style="bold yellow"),
    False: Text("FAIL", style="bold red"),
}
ROOM_GB = 1.0  # an hour of flight with four sensors at 20 Hz writes a tenth of this


def command(*, station: StationFile = None, config: Config = ()) -> None:
    """Check Python, packages, station file, ports, listeners, router and clock; list every setting."""
    sys.exit(0 if run(station, config) else 1)


def run(station_file: Path | None, overrides: tuple[str, ...]) -> bool:
    """Print every check; true when all passed."""
    passed = True
    for ok, what, finding in _checks(station_file, overrides):
        passed &= ok is not False
        screen.print(MARKS[ok], Text(f"{what:<14}{finding}"), soft_wrap=True)
    _print_settings(station_file, overrides)
    return passed


def _print_settings(station_file: Path | None, overrides: tuple[str, ...]) -> None:
    """Every resolved setting, with where it comes from."""
    try:
        settings = configuration.resolved(station_file, overrides)
    except InputError:
        return  # said among the checks
    width = max(len(setting.name) for setting in settings)
    for name, value, source in settings:
        shown = "left out" if value is None else json.dumps(value)
        screen.print(Text(f"{name:<{width}}  {shown:<24}  {source}"), soft_wrap=True)


def _checks(station_file: Path | None, overrides: tuple[str, ...]) -> Iterator[tuple[bool | None, str, str]]:
    """(passed, what, finding); None: it works, and is worth a look."""
    version = ".".join(map(str, sys.version_info[:3]))
    yield sys.version_info >= (3, 11), "Python", f"{version} (3.11 or newer is needed)"
    for package in PACKAGES:
        try:
            yield True, package, importlib.metadata.version(package)
        except importlib.metadata.PackageNotFoundError:
            yield False, package, "not installed: run `make demo` once, or pip install -e ."
    try:
        station = configuration.load(station_file, overrides)
    except InputError as error:
        yield False, "station file", str(error)
        return
    sensors = ", ".join(sensor.name for sensor in station.sensor) or "no ground sensor"
    yield (
        True,
        "station file",
        f"{station_file or 'defaults'}: {station.range.name}/{station.vehicle.name}, {sensors}",
    )
    origin = station.range.origin
    yield (
        origin is not None,
        "origin",
        "is set" if origin else "[range] origin is missing: live operation needs it",
    )
    free = _port_free(station.view.port)
    where = f"127.0.0.1:{station.view.port}"
    yield free, "view port", f"{where} is free" if free else f"{where} is in use: set [view] port"
    yield from _bus(station)
    for what, where, narrow in listeners(station):
        yield True if narrow else None, "listens", f"{what} on {where}{'' if narrow else WIDE}"
    yield from _clock()
    free_gb = shutil.disk_usage(Path.cwd()).free / 1e9
    yield free_gb > ROOM_GB, "disk", f"{free_gb:.0f} GB free for logs/runs"


def _bus(station: configuration.Station) -> Iterator[tuple[bool, str, str]]:
    from gcs.commands.compose import open_bus

    try:
        open_bus(station).close()
    except InputError as error:
        yield False, "bus", str(error)
    else:
        role = "can listen on" if station.bus.mode == "router" else "router answers at"
        yield True, "bus", f"{role} {station.bus.endpoint}"


def listeners(station: configuration.Station) -> list[tuple[str, str, bool]]:
    """(what, where, on loopback only) of what the station will open, and of what a ``gcs`` has open now."""
    found = [("view", f"127.0.0.1:{station.view.port}")]
    if station.bus.mode == "router":
        found.append(("bus", re.split(r"[?#]", station.bus.endpoint.partition("/")[2])[0]))
    kind, _, rest = station.mavlink.link.partition(":")
    if kind in ("udp", "udpin", "tcpin"):
        found.append(("MAVLink", rest.partition(",")[0]))
    found += [(f"{command} (running)", where) for command, where in _open_now()]
    return [(what, where, _is_loopback(where.rpartition(":")[0])) for what, where in found]


def _is_loopback(host: str) -> bool:
    """No for what has to be looked up: a name may become any address."""
    if host == "localhost":
        return True
    try:
        return ipaddress.ip_address(host.strip("[]")).is_loopback
    except ValueError:
        return False


def _open_now() -> Iterator[tuple[str, str]]:
    """(command, address) of each socket that a running ``gcs`` listens on, where the system tells: Linux."""
    addresses = {}
    for table, listening in (("tcp", "0A"), ("tcp6", "0A"), ("udp", "07"), ("udp6", "07")):
        path = Path("/proc/net") / table
        lines = path.read_text().splitlines()[1:] if path.is_file() else []
        for _, local, _, state, *rest in map(str.split, lines):
            if state == listening:
                addresses[f"socket:[{rest[5]}]"] = _address_of(local)
    for process in Path("/proc").glob("[0-9]*"):
        try:
            words = [word.rpartition("/")[2] for word in (process / "cmdline").read_text().split("\0")]
            sockets = [os.readlink(link) for link in (process / "fd").iterdir()] if "gcs" in words else []
        except OSError:
            continue  # it has ended, or is somebody else's
        command = " ".join(word for word in words[words.index("gcs") :][:3] if word) if sockets else ""
        yield from ((command, addresses[one]) for one in sockets if one in addresses)


def _address_of(local: str) -> str:
    """``127.0.0.1:7447`` of the kernel's ``0100007F:1D17``: words of four bytes in the machine's order."""
    digits, _, port = local.partition(":")
    words = struct.unpack(f">{len(digits) // 8}I", bytes.fromhex(digits))
    packed = struct.pack(f"={len(words)}I", *words)
    host = str(ipaddress.ip_address(packed))
    return f"{f'[{host}]' if ':' in host else host}:{int(port, 16)}"


def _clock() -> Iterator[tuple[bool, str, str]]:
    """The station's clock only stamps arrivals, but a stopped or stepping one makes ages meaningless."""
    wall, steady = time.time(), time.monotonic()
    time.sleep(0.2)
    slip_ms = 1e3 * ((time.time() - wall) - (time.monotonic() - steady))
    year = time.gmtime().tm_year
    sane = abs(slip_ms) < 5.0 and year >= 2025
    yield (
        sane,
        "clock",
        f"{time.strftime('%Y-%m-%d %H:%M:%SZ', time.gmtime())}, slips {slip_ms:+.1f} ms in 0.2 s",
    )


def _port_free(port: int) -> bool:
    with socket.socket() as probe:
        try:
            probe.bind(("127.0.0.1", port))
        except OSError:
            return False
    return True
