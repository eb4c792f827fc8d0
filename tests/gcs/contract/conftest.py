"""A free address, and a station that listens there."""

import pytest

from gcs.contract.wire import bus as bus_module
from gcs.contract.wire.bus import Bus
from tests.ports import free_port


@pytest.fixture
def endpoint() -> str:
    return f"tcp/127.0.0.1:{free_port()}"


@pytest.fixture
def station(endpoint, monkeypatch):
    monkeypatch.setattr(bus_module, "RETURN_S", 0.0)  # there was no router before
    with Bus.open("demo", "uav1", endpoint=endpoint) as station:
        yield station
