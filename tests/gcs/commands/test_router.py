"""Who needs a router that is not there waits for it, and can be stopped."""

import json
import signal
import subprocess
import sys
import threading

import pytest

from gcs.commands.serve import serve
from gcs.contract import config
from gcs.contract.wire.bus import Bus
from tests.gcs.contract.ends import until
from tests.ports import free_port

pytestmark = [pytest.mark.network, pytest.mark.slow]

STATION = """
[range]
name = "demo"
origin = { lat_deg = -35.36, lon_deg = 149.16, alt_m = 584.0 }
[mavlink]
link = ""
[bus]
mode = "client"
endpoint = "tcp/127.0.0.1:%d"
[[sensor]]
name = "theo"
kind = "theodolite"
position = { lat_deg = -35.36, lon_deg = 149.17, alt_m = 584.0 }
"""


@pytest.fixture
def file(tmp_path):
    port = free_port()
    file = tmp_path / "station.toml"
    file.write_text(STATION % port)
    return file


def test_a_client_waits_for_its_router(file, tmp_path, capfd):
    """As after a power cut, where all start at once. It used to give up after 0.25 s of a busy machine."""
    station = config.load(file)
    stop, over, told = threading.Event(), threading.Event(), []

    def waits() -> bool:
        told.append(capfd.readouterr().err)
        return "waiting for it" in "".join(told)

    def router():
        if not until(waits, 30.0):
            stop.set()
        with Bus.open("demo", "uav1", endpoint=station.bus.endpoint):
            over.wait(60.0)

    starting = threading.Thread(target=router)
    starting.start()
    serve(station, tmp_path / "run", stop, view=False, seconds=0.5)
    over.set()
    starting.join()
    assert "waiting for it" in "".join(told)
    assert json.loads((tmp_path / "run" / "summary.json").read_text())["complete"]


@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM])
def test_who_waits_for_a_router_can_be_stopped(file, number):
    """It used to wait on; only SIGKILL ended it."""
    command = [sys.executable, "-m", "gcs", "bridge", "theodolite", "theo", "--udp", "127.0.0.1:23998"]
    with subprocess.Popen([*command, "--station", str(file)], stderr=subprocess.PIPE, text=True) as bridge:
        assert "no Zenoh router" in bridge.stderr.readline()
        bridge.send_signal(number)
        assert bridge.wait(60) == 2
