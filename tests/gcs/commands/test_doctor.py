"""The checks before a flight: what listens where."""

import subprocess
import sys

import pytest

from gcs.commands import doctor
from gcs.contract import config
from tests.ports import free_port


def listeners(*overrides: str) -> dict[str, tuple[str, bool]]:
    found = doctor.listeners(config.load(None, overrides))
    return {what: (where, narrow) for what, where, narrow in found if "running" not in what}


def test_by_default_everything_is_on_loopback():
    assert listeners() == {
        "view": ("127.0.0.1:8080", True),
        "bus": ("127.0.0.1:7447", True),
        "MAVLink": ("127.0.0.1:14550", True),
    }


@pytest.mark.parametrize(
    ("override", "what", "where"),
    [
        ("bus.endpoint=tcp/0.0.0.0:7447", "bus", "0.0.0.0:7447"),
        ("bus.endpoint=tls/192.0.2.10:7447#so_sndbuf=65000", "bus", "192.0.2.10:7447"),
        ("bus.endpoint=tcp/[::]:7447", "bus", "[::]:7447"),
        ("bus.endpoint=tcp/range.example:7447", "bus", "range.example:7447"),
        ("mavlink.link=udpin:0.0.0.0:14550", "MAVLink", "0.0.0.0:14550"),
        ("mavlink.link=tcpin::5760", "MAVLink", ":5760"),
    ],
)
def test_what_more_than_this_machine_reaches_is_told(override, what, where):
    assert listeners(override)[what] == (where, False)


@pytest.mark.parametrize("where", ["127.0.0.1:1", "[::1]:1", "localhost:1"])
def test_loopback_has_several_names(where):
    assert listeners(f"bus.endpoint=tcp/{where}")["bus"] == (where, True)


def test_what_only_connects_is_no_listener():
    found = listeners(
        "bus.mode=client", "bus.endpoint=tcp/192.0.2.10:7447", "mavlink.link=tcp:192.0.2.1:5760"
    )
    assert set(found) == {"view"}
    assert "MAVLink" not in listeners("mavlink.link=")


@pytest.mark.network
@pytest.mark.parametrize(
    ("family", "kind", "host", "narrow"),
    [
        ("AF_INET", "SOCK_DGRAM", "127.0.0.1", True),
        ("AF_INET", "SOCK_DGRAM", "0.0.0.0", False),
        ("AF_INET6", "SOCK_STREAM", "::1", True),
    ],
)
def test_a_running_bridge_is_found_with_its_address(family, kind, host, narrow):
    code = (
        f"import socket; s = socket.socket(socket.{family}, socket.{kind}); s.bind(({host!r}, 0));"
        f"{'s.listen();' if kind == 'SOCK_STREAM' else ''} print(s.getsockname()[1], flush=True); input()"
    )
    command = [sys.executable, "-c", code, "gcs", "bridge", "theodolite", "theo-north"]
    with subprocess.Popen(command, stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True) as running:
        port = int(running.stdout.readline())
        found = doctor.listeners(config.load(None))
        running.communicate("\n")
    shown = f"[{host}]" if ":" in host else host
    assert ("gcs bridge theodolite (running)", f"{shown}:{port}", narrow) in found


@pytest.mark.network
def test_a_wide_listener_is_a_warning_and_no_failure(capsys):
    port = free_port()
    origin = "range.origin={ lat_deg = 1.0, lon_deg = 1.0, alt_m = 0.0 }"
    free = f"view.port={port}", f"bus.endpoint=tcp/127.0.0.1:{port + 1}"
    assert doctor.run(None, ("mavlink.link=udpin:0.0.0.0:14550", origin, *free))
    lines = capsys.readouterr().err.splitlines()
    [line] = [line for line in lines if "MAVLink on" in line]
    assert line.startswith("WARN")
    assert "docs/security" in line
    assert any(line.startswith("ok") and "view on 127.0.0.1" in line for line in lines)
