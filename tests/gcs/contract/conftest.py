"""A free address, and a station that listens there."""

import socket

import pytest

from gcs.contract.wire import bus as bus_module
from gcs.contract.wire.bus import Bus


@pytest.fixture
def endpoint() -> str:
    with socket.socket() as probe:
        probe.bind(("127.0.0.1", 0))
        return f"tcp/127.0.0.1:{probe.getsockname()[1]}"


@pytest.fixture
def station(endpoint, monkeypatch):
    monkeypatch.setattr(bus_module, "RETURN_S", 0.0)  # there was no router before
    with Bus.open("demo", "uav1", endpoint=endpoint) as station:
        yield station
