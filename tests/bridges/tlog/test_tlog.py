"""Files as they come: whole, damaged, mixed, and none."""

import itertools

import numpy as np
import pytest
from pymavlink.dialects.v20 import ardupilotmega as dialect

from bridges.mavlink.flightclock import MS, S
from bridges.tlog import flight as tlog_flight
from bridges.tlog import tlog
from tests.bridges import flights
from tests.bridges.flights import START_US, flight, packed, positions, write


def test_untrue_stamps_are_dropped_and_counted(path):
    records = packed(flight(60, system_time=False))
    whole = tlog_flight.ins(tlog.read(write(path, records)))
    for i, bit in [(50, 7), (700, 30), (1100, 45), (1101, 51), (2000, 62), (2500, 63)]:
        stamp = int.from_bytes(records[i][:8], "big") ^ (1 << bit + 1 if bit == 7 else 1 << bit)
        records[i] = stamp.to_bytes(8, "big") + records[i][8:]
    log = tlog.read(write(path, records))
    assert log.stamps_dropped == 5  # a change of 256 µs is none
    rows = tlog_flight.ins(log)
    assert rows["t_ns"].tolist() == whole["t_ns"].tolist()
    assert np.abs(rows["arrival_ns"] - whole["arrival_ns"]).max() < 0.2 * S


def test_picks_the_vehicle_and_its_autopilot(path):
    drone = packed(flight(20, boot_ms=5_000), system=3)
    other = packed(flight(20, boot_ms=90_000), system=4)
    camera = packed(
        (x for x in flight(20, boot_ms=77_000) if x.message.get_type() != "HEARTBEAT"),
        system=3,
        component=100,
    )
    station = packed(
        [flights.Received(START_US, dialect.MAVLink_heartbeat_message(6, 8, 0, 0, 4, 3))], system=255
    )
    mixed = [x for group in itertools.zip_longest(drone, camera, other) for x in group if x]
    log = tlog.read(write(path, station, mixed))
    assert [(v.system_id, v.component_id, v.kind) for v in tlog.vehicles(log)] == [
        (3, 1, "autopilot"),
        (4, 1, "autopilot"),
        (255, 1, "ground station"),
    ]
    assert positions(tlog_flight.ins(log, 3))["t_ns"][0] == START_US * 1000 + 6_000 * MS
    with pytest.raises(tlog.LogError, match=r"2 autopilots.*3 \(autopilot.*4 \(autopilot.*255 \(ground"):
        tlog_flight.ins(log)
    with pytest.raises(tlog.LogError, match=r"no vehicle with system id 9.*system_id"):
        tlog_flight.ins(log, 9)


def test_columns_carry_stamp_sender_and_link(path):
    sent = [one._replace(receipt_us=one.receipt_us & ~3 | i % 3) for i, one in enumerate(flight(20))]
    columns = tlog.read(write(path, packed(sent, system=9, component=2))).messages("ATTITUDE")
    theirs = [(one.receipt_us, i % 256, i % 3) for i, one in enumerate(sent) if one.message.id == 30]
    assert columns[["receipt_us", "frame_seq", "link"]].tolist() == theirs
    assert {*columns["sysid"], *columns["compid"]} == {9, 2}
    assert columns["yaw"] == pytest.approx(1.57)


def test_damage_is_counted(path):
    records = packed(flight(20))
    records[100] = b"\0" * 1000 + records[100]
    flipped = bytearray(records[200])
    flipped[20] ^= 4
    records[200] = bytes(flipped)
    records[-1] = records[-1][:20]
    got = tlog.damage(tlog.read(write(path, records)))
    assert got["bytes"] == sum(map(len, records))
    assert (got["bytes_skipped"], got["bytes_after_last_frame"]) == (1020, 20)
    assert sum(got["frames_bad_crc"].values()) == 1
    assert got["frames"] == len(records) - 2


@pytest.mark.parametrize(
    ("content", "says"),
    [
        (None, "no such file"),
        (b"", "empty"),
        (b"\x89PNG\r\n\x1a\n\0\0\0\rIHDR" + bytes(range(256)) * 40, "no MAVLink frame"),
    ],
)
def test_files_that_are_no_log(path, content, says):
    if content is not None:
        path.write_bytes(content)
    with pytest.raises(tlog.LogError, match=says) as error:
        tlog.read(path)
    assert str(path) in str(error.value)
    assert "\n" not in str(error.value)
