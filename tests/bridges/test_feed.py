"""Feeds: every good digit arrives, every damaged one is named, nothing is lost; CSV and UDP alike."""

import random
import socket
import sys
import threading
from fractions import Fraction

import numpy as np
import pytest

from bridges import feed
from gcs.contract import limits
from gcs.contract.messages import POLAR, Bad, PolarMeasurement

HEADER = "t,range_m,azimuth_deg,elevation_deg\n"
T = 1_767_225_600_126_236_328


def read(tmp_path, body, header=HEADER, **more):
    path = tmp_path / "theo.csv"
    path.write_bytes((header + body).encode() if isinstance(body, str) else body)
    return feed.read(path, "theo", **more)


@pytest.mark.parametrize(
    ("text", "expected"),
    [
        ("1767225600.126236328", T),
        ("1767225600", 1_767_225_600 * 10**9),
        ("1767225600.5", 1_767_225_600_500_000_000),
        (" 1767225600.126236328\t", T),
        ("1767225600.1262363289", T),
        ("1.767225600126236328e+09", T),
        ("2026-01-01T00:00:00.126236328Z", T),
        ("2026-01-01 00:00:00.126236328", T),
        ("2026-01-01T02:30:00.126236328+02:30", T),
        ("20260101T000000Z", 1_767_225_600 * 10**9),
        ("2000-01-01T00:00:00Z", 946_684_800 * 10**9),
        ("2100-01-01T00:00:00Z", None),
        ("1999-12-31T23:59:59.9Z", None),
        ("2026-13-01T00:00:00Z", None),
        ("1767225600126", None),
        ("-1767225600", None),
        ("12:00:00", None),
        ("nan", None),
        ("inf", None),
        ("1e300", None),
        ("1e999999999", None),
        ("9" * 5000, None),
        ("", None),
        ("²", None),
    ],
)
def test_time(text, expected):
    assert feed.time_ns(text) == expected


def test_time_agrees_with_exact_fractions():
    draw = random.Random(1)
    for _ in range(2000):
        t_ns = draw.randrange(limits.FIRST_NS, limits.LAST_NS)
        text = f"{t_ns // 10**9}.{t_ns % 10**9:09d}"
        assert feed.time_ns(text) == int(Fraction(text) * 10**9) == t_ns


def test_good_file_in_any_column_order(tmp_path):
    body = f"12.5,{T // 10**9}.126236328,-3.25,812.4\n,{T // 10**9 + 1},nan,\n"
    rows, bad = read(tmp_path, body, "azimuth_deg, t ,elevation_deg,range_m\r\n")
    assert not bad
    assert rows.dtype == POLAR
    assert rows["t_ns"].tolist() == [T, 1_767_225_601 * 10**9]
    assert (rows["arrival_ns"] == rows["t_ns"]).all()
    one, two = feed.measurements(rows)
    assert one == PolarMeasurement(t_ns=T, arrival_ns=T, range_m=812.4, azimuth_deg=12.5, elevation_deg=-3.25)
    assert (two.range_m, two.azimuth_deg, two.elevation_deg) == (None, None, None)


def test_order_and_repetition_are_kept(tmp_path):
    rows, bad = read(tmp_path, "1767225602,1,1,1\n1767225601,2,2,2\n1767225602,1,1,1\n")
    assert rows["range_m"].tolist() == [1, 2, 1]
    assert not bad


@pytest.mark.parametrize(
    ("line", "reason", "kept"),
    [
        ("1767225600,abc,12,3", "range_m: 'abc'", (None, 12, 3)),
        ("1767225600,1e300,12,3", "range_m: '1e300'", (None, 12, 3)),
        ("1767225600,-5,12,3", "range_m: '-5'", (None, 12, 3)),
        ("1767225600,5,inf,3", "azimuth_deg: 'inf'", (5, None, 3)),
        ("1767225600,5,721,3", "azimuth_deg: '721'", (5, None, 3)),
        ("1767225600,5,12,90.1", "elevation_deg: '90.1'", (5, 12, None)),
        ("1767225600,5,12", "3 fields where the header names 4", None),
        ("1767225600,5,12,3,4", "5 fields where the header names 4", None),
        ("yesterday,5,12,3", "t: 'yesterday'", None),
        ("12.5,5,12,3", "t: '12.5'", None),
    ],
)
def test_damage_is_named_and_the_rest_kept(tmp_path, line, reason, kept):
    rows, bad = read(tmp_path, f"1767225599,1,1,1\n{line}\n1767225601,2,2,2\n")
    (refused,) = bad
    assert refused.where == "theo.csv:3"
    assert refused.source == "theo"
    assert refused.raw == line
    assert refused.reason.startswith(reason)
    assert refused.t_ns == (1_767_225_600 * 10**9 if kept else None)
    assert len(rows) == (3 if kept else 2)
    if kept:
        row = list(feed.measurements(rows))[1]
        assert (row.range_m, row.azimuth_deg, row.elevation_deg) == kept


def test_two_damaged_channels_are_two_refusals(tmp_path):
    rows, bad = read(tmp_path, "1767225600,x,y,3\n")
    assert [b.reason.split(":")[0] for b in bad] == ["range_m", "azimuth_deg"]
    assert rows["elevation_deg"].tolist() == [3]


def test_random_damage_never_raises_and_every_line_is_accounted_for(tmp_path):
    draw = random.Random(2)
    lines = [f"{1_767_225_600 + i}.25,{500 + i}.5,{i % 360}.125,{i % 80}.0625" for i in range(300)]
    clean = "\n".join(lines).encode()
    for _ in range(60):
        body = bytearray(clean)
        for _ in range(25):
            body[draw.randrange(len(body))] = draw.randrange(256)
        rows, bad = read(tmp_path, HEADER.encode() + bytes(body))
        text = body.decode(errors="replace").replace("\r\n", "\n").split("\n")
        count = sum(bool(line.strip()) for line in text)
        without_row = [b for b in bad if b.reason.startswith("t:") or "fields where" in b.reason]
        assert len(rows) + len(without_row) == count
        untouched = set(lines) & set(text)
        good = {(m.t_ns, m.range_m, m.azimuth_deg, m.elevation_deg) for m in feed.measurements(rows)}
        for line in untouched:
            t, *values = line.split(",")
            assert (int(Fraction(t) * 10**9), *map(float, values)) in good


@pytest.mark.parametrize(
    ("content", "says"),
    [
        (b"", "empty"),
        (b"t,range_m\n", "no measurement"),
        (b"time,range_m\n1,2\n", "unknown column 'time'; valid columns are t, range_m, azimuth_deg"),
        (b"t;range_m\n1;2\n", "unknown column 't;range_m'"),
        (b"range_m,azimuth_deg\n1,2\n", "needs column t"),
        (b"t,range_m,range_m\n1,2,3\n", "twice"),
        (b"\x89PNG\r\n\x1a\n\0\0\0", "unknown column"),
    ],
)
def test_useless_files_are_refused_in_one_line(tmp_path, content, says):
    path = tmp_path / "theo.csv"
    path.write_bytes(content)
    with pytest.raises(feed.FeedError, match=says) as refusal:
        feed.read(path, "theo")
    assert str(refusal.value).startswith(f"{path}:1: ")
    assert "\n" not in str(refusal.value)


def test_missing_file_is_refused_in_one_line(tmp_path):
    with pytest.raises(feed.FeedError, match=r"nowhere.csv: No such file .*t, range_m"):
        feed.read(tmp_path / "nowhere.csv", "theo")


def test_bulk_equals_numpy(tmp_path):
    rng = np.random.default_rng(3)
    values = np.round(rng.uniform([0, 0, -90], [1e4, 360, 90], (5000, 3)), 5)
    body = "".join(f"{1_767_225_600 + i},{r!r},{a!r},{e!r}\n" for i, (r, a, e) in enumerate(values.tolist()))
    rows, _ = read(tmp_path, body)
    expected = np.loadtxt(tmp_path / "theo.csv", delimiter=",", skiprows=1)
    for column, name in enumerate(("range_m", "azimuth_deg", "elevation_deg"), 1):
        np.testing.assert_array_equal(rows[name], expected[:, column])


def decode(raw):
    return feed.decode(raw, 7, "theo", "udp 127.0.0.1:1 #1")


def test_datagram_of_two_lines_and_full_precision():
    raw = (
        b'{"t": 1767225600.126236328, "range_m": 812.4, "azimuth_deg": 12.5}\n{"t": "2026-01-01T00:00:01Z"}\n'
    )
    one, two = decode(raw)
    assert one == PolarMeasurement(t_ns=T, arrival_ns=7, range_m=812.4, azimuth_deg=12.5)
    assert two == PolarMeasurement(t_ns=1_767_225_601 * 10**9, arrival_ns=7)


def test_null_and_nan_are_no_value_and_no_damage():
    assert decode(b'{"t": 1767225600.126236328, "range_m": null, "azimuth_deg": NaN}') == [
        PolarMeasurement(t_ns=T, arrival_ns=7)
    ]


@pytest.mark.parametrize(
    ("raw", "reason"),
    [
        (b"hello", "no JSON object"),
        (b"[1, 2]", "no JSON object"),
        (b"[" * 60_000, "no JSON object"),
        (b"\xff\x00\x80", "no JSON object"),
        (b'{"t": 1767225600, "rng": 3}', "unknown name 'rng'; valid names are t, range_m"),
        (b'{"range_m": 3}', "t: ''"),
        (b'{"t": true}', "t: 'True'"),
    ],
)
def test_bad_datagrams(raw, reason):
    (bad,) = decode(raw)
    assert isinstance(bad, Bad)
    assert bad.reason.startswith(reason)
    assert bad.where == "udp 127.0.0.1:1 #1"
    assert len(bad.raw) <= feed.CLIP


def test_one_bad_channel_of_a_datagram():
    good, bad = decode(b'{"t": 1767225600, "range_m": 1e300, "azimuth_deg": 12.5, "elevation_deg": [1]}')[:2]
    assert (good.range_m, good.azimuth_deg) == (None, 12.5)
    assert bad.reason.startswith("range_m: '1e300'")
    assert bad.t_ns == 1_767_225_600 * 10**9


def test_a_row_states_its_own_noise(tmp_path):
    rows, bad = read(
        tmp_path,
        f"{1767225600.126236328},812.4,12.5,0.25,\n",
        "t,range_m,azimuth_deg,sigma_range_m,sigma_azimuth_deg\n",
    )
    assert not bad
    assert (rows["sigma_range_m"][0], rows["range_m"][0]) == (0.25, 812.4)
    assert np.isnan(rows["sigma_azimuth_deg"][0])
    assert np.isnan(rows["sigma_elevation_deg"][0])
    (live,) = decode(b'{"t": 1767225600.126236328, "range_m": 812.4, "sigma_range_m": 0.25}')
    assert live == PolarMeasurement(t_ns=T, arrival_ns=7, range_m=812.4, sigma_range_m=0.25)


@pytest.mark.parametrize("sigma", ["0", "-1", "inf", "1e-300", "wide"])
def test_a_value_whose_noise_cannot_be_is_refused_alone(tmp_path, sigma):
    rows, (bad,) = read(
        tmp_path, f"{1767225600.126236328},812.4,12.5,{sigma}\n", "t,range_m,azimuth_deg,sigma_range_m\n"
    )
    assert np.isnan(rows["range_m"][0])
    assert rows["azimuth_deg"][0] == 12.5
    assert bad.reason == f"sigma_range_m: {sigma!r} is no number from 1e-06 to 1000, so range_m is refused"


@pytest.mark.parametrize("t", ["9223372036854775808", "1e400", "99999999999999999999999", "-1"])
def test_a_time_beyond_all_integers_is_a_reason(t):
    (bad,) = decode(b'{"t": %s, "range_m": 1.0}' % t.encode())
    assert "neither Unix seconds nor ISO 8601" in bad.reason


def test_a_line_of_twenty_megabytes_travels_clipped(tmp_path):
    huge = "9" * 20_000_000
    rows, (bad,) = read(tmp_path, f"{1767225600.126236328},{huge},12.5\n", "t,range_m,azimuth_deg\n")
    assert rows["azimuth_deg"][0] == 12.5
    assert len(bad.raw) <= limits.TEXT
    assert len(bad.reason) <= limits.TEXT


@pytest.mark.network
@pytest.mark.skipif(sys.platform != "linux", reason="only Linux counts what its sockets drop")
def test_every_datagram_of_a_flood_is_a_message_or_counted():
    """The reader sleeps while 5,000 come, and the socket's buffer holds a part of them."""
    server = feed._listen("127.0.0.1", 0)
    server.setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, 20_000)
    with server, socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as sender:
        for _ in range(5_000):
            sender.sendto(b"garbage", server.getsockname())
        threading.Timer(0.5, sender.sendto, (b"last", server.getsockname())).start()
        seen = lost = 0
        for _, raw, missing in feed._datagrams(server, threading.Event()):
            lost += missing
            if raw == b"last":
                break
            seen += 1
    assert seen + lost == 5_000
    assert lost > 0
