"""docs/security: the router of a range, with the script's certificates. Every put is tried by every role.

A router in this process takes the same configuration as zenohd.
"""

import json
import re
import socket
import subprocess
import time
from collections.abc import Iterator
from pathlib import Path

import msgspec
import pytest
import zenoh
from websockets.datastructures import Headers
from websockets.http11 import Request

from gcs.commands.compose import open_bus
from gcs.contract import config
from gcs.contract.config import TlsSection
from gcs.contract.messages import Event, InputError, encode
from gcs.contract.wire.bus import Bus, BusError
from tests.gcs.contract.ends import collect, shot, state, until
from web.origins import refusal

pytestmark = pytest.mark.network

SECURITY = Path(__file__).resolve().parents[2] / "docs" / "security"
INSTRUMENTS = ("theo-north", "theo-east", "radar-1")
ROLES = ("station", "ins", *INSTRUMENTS, "viewer")
CONCLUSIONS = ("state", "smoothed", "verdict/theo-north", "health", "event", "wind", "scene")
KEYS = (*CONCLUSIONS, "raw/ins", "raw/air", *(f"raw/{name}" for name in INSTRUMENTS), "raw/stranger", "other")
MAY_WRITE = {
    "station": set(CONCLUSIONS),
    "ins": {"raw/ins", "raw/air"},
    "viewer": set(),
    **{name: {f"raw/{name}"} for name in INSTRUMENTS},
}
QUIET_S = 0.5  # after what is allowed has come, what is not has had its time


@pytest.fixture(scope="module")
def keys(tmp_path_factory) -> Path:
    folder = tmp_path_factory.mktemp("keys")
    command = [SECURITY / "certificates.sh", folder, "127.0.0.1", "router", *ROLES]
    subprocess.run(command, check=True, capture_output=True)
    subprocess.run([SECURITY / "certificates.sh", folder / "foreign", "127.0.0.1", "station"], check=True)
    return folder


@pytest.fixture(scope="module")
def endpoint(keys) -> Iterator[str]:
    """The router of the example, on a free port."""
    with socket.socket() as probe:
        probe.bind(("127.0.0.1", 0))
        endpoint = f"tls/127.0.0.1:{probe.getsockname()[1]}"
    settings = zenoh.Config.from_file(str(SECURITY / "router.json5"))
    settings.insert_json5("listen/endpoints", json.dumps([endpoint]))
    for name in ("root_ca_certificate", "listen_certificate", "listen_private_key"):
        path = json.loads(settings.get_json(f"transport/link/tls/{name}"))
        settings.insert_json5(f"transport/link/tls/{name}", json.dumps(str(keys / Path(path).name)))
    with zenoh.open(settings):
        yield endpoint


def tls_of(folder: Path, role: str) -> TlsSection:
    files = {"root_ca": "ca.pem", "certificate": f"{role}.pem", "private_key": f"{role}.key"}
    return TlsSection(**{name: str(folder / file) for name, file in files.items()})


def client(endpoint: str, folder: Path, role: str) -> Bus:
    """A bus that waits where a busy machine takes long over the handshake."""
    tls = tls_of(folder, role)
    return Bus.open("demo", "uav1", mode="client", endpoint=endpoint, tls=tls, waiting=lambda line: True)


def bare(endpoint: str, folder: Path, role: str) -> zenoh.Session:
    """A session of plain Zenoh that shows a role's certificate: what somebody hostile would use."""
    tls, made = tls_of(folder, role), zenoh.Config()
    settings = {
        "mode": "client",
        "connect/endpoints": [endpoint],
        "scouting/multicast/enabled": False,
        "transport/link/tls/root_ca_certificate": tls.root_ca,
        "transport/link/tls/enable_mtls": True,
        "transport/link/tls/connect_certificate": tls.certificate,
        "transport/link/tls/connect_private_key": tls.private_key,
    }
    for key, value in settings.items():
        made.insert_json5(key, json.dumps(value))
    return zenoh.open(made)


@pytest.mark.parametrize("role", ROLES)
def test_a_role_writes_what_is_its_own_and_nothing_else(endpoint, keys, role):
    with bare(endpoint, keys, role) as writer, bare(endpoint, keys, "viewer") as reader:
        got: list[str] = []
        subscriber = reader.declare_subscriber("demo/uav1/**", lambda s: got.append(str(s.key_expr)))
        other = reader.declare_subscriber("elsewhere/**", lambda s: got.append(str(s.key_expr)))
        time.sleep(QUIET_S)
        wanted = {f"demo/uav1/{key}" for key in MAY_WRITE[role]}
        for key in (*(f"demo/uav1/{key}" for key in KEYS), "elsewhere/uav1/state"):
            writer.put(key, b"x")
            writer.delete(key)
        assert until(lambda: wanted <= set(got), seconds=5.0)
        time.sleep(QUIET_S)
        assert sorted(got) == sorted(wanted)
        subscriber.undeclare()
        other.undeclare()


@pytest.mark.parametrize("role", ROLES)
def test_a_role_is_alive_under_its_own_name_alone(endpoint, keys, role):
    with bare(endpoint, keys, role) as writer, client(endpoint, keys, "station") as station:
        tokens = [writer.liveliness().declare_token(f"demo/uav1/alive/{name}") for name in ROLES]
        own = {role} if role not in ("station", "viewer") else set()
        assert until(lambda: own <= station.alive(), seconds=5.0)
        time.sleep(QUIET_S)
        assert station.alive() == own
        del tokens


def test_the_bus_works_through_it_with_history_and_liveliness(endpoint, keys):
    with client(endpoint, keys, "station") as station, client(endpoint, keys, "theo-north") as bridge:
        raw = station.subscribe("raw/*")
        bridge.declare_alive("theo-north")
        for number in range(50):
            bridge.publish("raw", shot(number), "theo-north")
        assert [message.t_ns for _, message in collect(raw, 50)] == list(range(50))
        assert until(lambda: station.alive() == {"theo-north"})
        for seq in range(50):
            station.publish("state", state(seq))
        with client(endpoint, keys, "viewer") as late:
            assert [message.seq for _, message in collect(late.subscribe("state"), 50)] == list(range(50))
            late.publish("event", Event(t_ns=1, level="error", text="I am the station"))
            bridge.publish("state", state(1_000))
            events = station.subscribe("event", "state")
            assert [m for _, m in collect(events, 51, seconds=QUIET_S)] == [state(seq) for seq in range(50)]


def test_who_shows_no_certificate_or_a_foreign_one_does_not_get_in(endpoint, keys):
    plain = zenoh.Config()
    for key, value in (("mode", "client"), ("connect/endpoints", [endpoint])):
        plain.insert_json5(key, json.dumps(value))
    plain.insert_json5("transport/link/tls/root_ca_certificate", json.dumps(str(keys / "ca.pem")))
    plain.insert_json5("scouting/multicast/enabled", "false")
    plain.insert_json5("connect/timeout_ms", "1000")
    with pytest.raises(zenoh.ZError):
        zenoh.open(plain)
    own, foreign = tls_of(keys, "station"), tls_of(keys / "foreign", "station")
    forged = TlsSection(root_ca=own.root_ca, certificate=foreign.certificate, private_key=foreign.private_key)
    misled = TlsSection(root_ca=foreign.root_ca, certificate=own.certificate, private_key=own.private_key)
    for tls in (forged, misled):  # the router does not know the one, the other does not know the router
        with pytest.raises(BusError, match="no Zenoh router"):
            Bus.open("demo", "uav1", mode="client", endpoint=endpoint, tls=tls)


@pytest.mark.parametrize(("role", "heard"), [("viewer", 0), ("theo-east", 0), ("station", 1)])
def test_history_is_taken_from_who_may_write_it(endpoint, keys, role, heard):
    key = "demo/uav1/smoothed/@adv/pub/made/up"
    payload, encoding = encode(state(7))

    def answer(query: zenoh.Query) -> None:
        query.reply(key, payload, encoding=encoding)

    with bare(endpoint, keys, role) as keeper, client(endpoint, keys, "viewer") as reader:
        queryable = keeper.declare_queryable("demo/uav1/smoothed/@adv/pub/**", answer)
        time.sleep(QUIET_S)
        assert len(collect(reader.subscribe("smoothed"), 1, seconds=QUIET_S)) == heard
        queryable.undeclare()


def test_a_file_that_is_not_there_is_one_line(keys):
    tls = f'bus.tls={{ root_ca = "{keys}/ca.pem", certificate = "nowhere.pem", private_key = "x.key" }}'
    with pytest.raises(InputError, match=r"^\[bus\] tls.certificate: no such file nowhere.pem; [^\n]*$"):
        open_bus(config.load(None, [tls]))


def test_the_station_itself_may_be_the_router_with_certificates(keys):
    with socket.socket() as probe:
        probe.bind(("127.0.0.1", 0))
        endpoint = f"tls/127.0.0.1:{probe.getsockname()[1]}"
    files = ", ".join(f'{k} = "{v}"' for k, v in msgspec.structs.asdict(tls_of(keys, "station")).items())
    told = config.load(None, [f"bus.tls={{ {files} }}", f"bus.endpoint={endpoint}", "range.name=demo"])
    with open_bus(told) as station, client(endpoint, keys, "radar-1") as bridge:
        raw = station.subscribe("raw/*")
        bridge.publish("raw", shot(1), "radar-1")
        assert [name for name, _ in collect(raw, 1)] == ["radar-1"]


def test_the_example_names_every_role():
    settings = zenoh.Config.from_file(str(SECURITY / "router.json5"))
    access = json.loads(settings.get_json("access_control"))
    assert access["default_permission"] == "deny"
    assert {name for subject in access["subjects"] for name in subject["cert_common_names"]} == set(ROLES)
    writes = [rule for rule in access["rules"] if "put" in rule["messages"] and "ingress" in rule["flows"]]
    written = {key.replace("*", "theo-north") for rule in writes for key in rule["key_exprs"]}
    assert {f"demo/uav1/{key}" for key in set().union(*MAY_WRITE.values())} <= written


def test_what_the_proxy_sends_on_is_what_the_view_lets_in():
    """nginx itself is no part of the tests: the headers of its example, as they reach the view."""
    text = (SECURITY / "nginx.conf").read_text(encoding="utf-8")
    (host,) = re.findall(r"proxy_set_header Host (\S+);", text)
    (upstream,) = re.findall(r"proxy_pass http://(\S+);", text)
    (origin,) = re.findall(r'origins = \["(\S+)"\]', text)
    view = config.load(None, [f"view.origins=['{origin}']"]).view
    assert host == upstream == f"127.0.0.1:{view.port}"
    assert "Origin" not in re.findall(r"proxy_set_header (\S+)", text)  # else every page would be its own
    assert re.search(r"^\s*auth_basic ", text, re.MULTILINE)
    for asks, refused in ((origin, False), ("https://evil.example", True)):
        headers = Headers({"Host": host, "Origin": asks})
        assert (refusal(Request("/", headers), view.port, view.origins) is not None) == refused


@pytest.mark.parametrize(
    "origin", ["range.example", "https://range.example/", "ftp://x", "https://", "*", "null"]
)
def test_what_is_no_origin_is_refused(origin):
    with pytest.raises(InputError, match="is no origin; give https://HOST"):
        config.load(None, [f"view.origins=['{origin}']"])
