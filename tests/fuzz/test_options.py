"""Odd values of every option: one line on stderr, exit code 2, whatever was typed."""

import socket
import sys
import threading

import pytest

from bridges import feed
from bridges.mavlink import mavlink
from gcs.commands.cli import main
from gcs.contract.messages import InputError
from tests.bridges.fake import SortingBus
from tests.fuzz import feeds, texts

OPTIONS = ("--speed", "--method", "--correction", "--feed", "--config", "--station", "--out", "--nobody")
STATION = str(feeds.SAMPLE / "station.toml")
HOSTS = [*texts.TOKENS, "a" * 70 + ".b", "[::1]", "999.1.1.1", "host with space", ".", ".."]


@pytest.fixture
def refused(monkeypatch, capfd, tmp_path):
    """Runs a command line that cannot work."""
    monkeypatch.chdir(tmp_path)

    def refused(*arguments: str) -> None:
        monkeypatch.setattr(sys, "argv", ["gcs", *arguments])
        with pytest.raises(SystemExit) as left:
            main()
        lines = capfd.readouterr().err.splitlines()
        assert (left.value.code, len(lines)) == (2, 1), (arguments, lines)

    return refused


@pytest.mark.parametrize("option", OPTIONS)
def test_an_odd_value_is_one_line(refused, option):
    """The log is not there: what is not refused for the value is refused for that."""
    for value in texts.TOKENS:
        refused("replay", "nowhere.tlog", option, value)


@pytest.mark.parametrize(
    "command",
    [
        ("screen",),
        ("replay", "--station", STATION),
        ("bridge", "theodolite", "--station", STATION),
        ("bridge", "simulated", "--station", STATION),
    ],
    ids=lambda command: " ".join(command[:2]),
)
def test_an_odd_name_is_one_line(refused, command):
    for value in texts.TOKENS:
        if value and not value.startswith("-"):  # else an option, or none given
            refused(*command, value)


@pytest.mark.network
@pytest.mark.parametrize("port", [-1, 70_000, 10**30])
def test_an_address_that_is_none_is_refused(port):
    for host in HOSTS:
        with pytest.raises(InputError):
            feed.run(SortingBus(), "theo-north", (host, port), threading.Event())


@pytest.mark.network
def test_a_link_that_is_none_is_refused_or_tried_again():
    """Nothing but the documented error: a link that may come is waited for, here not at all."""
    stop = threading.Event()
    stop.set()
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as probe:
        probe.bind(("127.0.0.1", 0))
        port = probe.getsockname()[1]
    odd = [f"udpin:{host}:{port}" for host in HOSTS]
    odd += [
        f"{kind}:127.0.0.1:{text}" for kind in ("udpin", "udpout", "tcp", "tcpin") for text in texts.TOKENS
    ]
    for link in (*odd, *texts.TOKENS):
        try:
            mavlink.run(link, 1, SortingBus(), stop)
        except InputError as error:
            assert str(error)  # noqa: PT017
