import numpy as np
import pytest
from pymavlink.dialects.v20 import ardupilotmega as dialect

from bridges.tlog import scan
from tests.bridges import oracle
from tests.bridges.oracle import each_log

STAMP = (1_700_000_000_000_000).to_bytes(8, "big")


class Sender:
    """pymavlink's own encoder."""

    def __init__(self, version: int = 2, system: int = 1, key: bytes = b""):
        self.mav = dialect.MAVLink(None, srcSystem=system, srcComponent=1)
        self.version = version
        if key:
            self.mav.signing.secret_key, self.mav.signing.sign_outgoing = key, True

    def __call__(self, message, stamp: bytes = STAMP) -> bytes:
        packed = message.pack(self.mav, force_mavlink1=self.version == 1)
        self.mav.seq = (self.mav.seq + 1) % 256
        return stamp + packed


def attitude(i: int):
    return dialect.MAVLink_attitude_message(1000 + 40 * i, 0.1 * i, -0.2, 3.0, 0.0, 0.0, 0.0)


def scanned(blob: bytes) -> tuple[np.ndarray, np.ndarray]:
    data = np.frombuffer(blob, np.uint8)
    return data, scan.scan(data)


@pytest.mark.slow
@each_log
def test_has_every_message_pymavlink_decodes_field_by_field(log):
    seen, glued = oracle.pymavlink_messages(log)
    data = np.fromfile(log, np.uint8)
    found = scan.scan(data)
    good = found[found["kind"] == scan.GOOD]
    assert not glued
    assert good["offset"].tolist() == [one.offset for one in seen]
    assert good["receipt_us"].tolist() == [one.receipt_us for one in seen]
    assert oracle.differences(seen, data, found, every=9) == []


@pytest.mark.slow
@each_log
def test_damaged_logs_lose_nothing_pymavlink_finds(log, tmp_path):
    data, path = log.read_bytes(), tmp_path / "damaged.tlog"
    for seed in range(4):
        path.write_bytes(oracle.damaged(data, seed))
        seen, _ = oracle.pymavlink_messages(path)
        bytes_, found = scanned(path.read_bytes())
        assert seen
        assert oracle.missing(seen, found) == []
        assert oracle.differences(seen, bytes_, found) == []


@pytest.mark.parametrize("version", [1, 2])
@pytest.mark.parametrize("key", [b"", bytes(32)])
def test_versions_and_signatures(version, key):
    send = Sender(version, key=key if version == 2 else b"")
    data, found = scanned(b"".join(send(attitude(i)) for i in range(300)))
    assert found["kind"].tolist() == [scan.GOOD] * 300
    assert set(found["version"]) == {version}
    assert found["seq"].tolist() == [i % 256 for i in range(300)]
    columns = scan.payloads(data, found, dialect.MAVLINK_MSG_ID_ATTITUDE, np.dtype([]))
    assert columns["time_boot_ms"].tolist() == [1000 + 40 * i for i in range(300)]
    assert not found["duplicate"].any()


def test_truncated_zeros_and_text_come_back():
    send = Sender()
    text = dialect.MAVLink_statustext_message(3, b"low battery")
    data, found = scanned(send(text) + send(attitude(0)))
    assert found["length"][0] < dialect.MAVLink_statustext_message.unpacker.size
    row = scan.payloads(data, found[:1], dialect.MAVLINK_MSG_ID_STATUSTEXT, np.dtype([]))[0]
    assert (row["severity"], row["text"], row["chunk_seq"]) == (3, b"low battery", 0)


@pytest.mark.parametrize("junk", [b"", b"\0" * 500, b"\xfd\xfe" * 200, bytes(range(256)) * 3])
@pytest.mark.parametrize("keep_stamp", [True, False])
def test_finds_the_frame_right_behind_damage(junk, keep_stamp):
    send = Sender()
    records = [send(attitude(i)) for i in range(9)]
    records[4] = junk + (records[4] if keep_stamp else records[4][8:])
    _, found = scanned(b"".join(records))
    assert (found["kind"] == scan.GOOD).sum() == 9
    assert found["receipt_us"][found["kind"] == scan.GOOD][5] == 1_700_000_000_000_000


def test_cut_frame_does_not_hide_the_next():
    send = Sender()
    records = [send(attitude(i)) for i in range(40)]
    for keep in range(9, len(records[0])):
        _, found = scanned(b"".join([records[0], records[1][:keep], *records[2:]]))
        assert (found["kind"] == scan.GOOD).sum() == 39


def test_unknown_and_bad_frames_are_stepped_over_and_named():
    send = Sender()
    records = [send(attitude(i)) for i in range(5)]
    unknown = bytearray(records[1])
    unknown[8 + 7 : 8 + 10] = (9_999_999).to_bytes(3, "little")
    bad = bytearray(records[3])
    bad[8 + 15] ^= 1
    _, found = scanned(b"".join([records[0], unknown, records[2], bad, records[4]]))
    assert found["kind"].tolist() == [scan.GOOD, scan.UNKNOWN, scan.GOOD, scan.BAD_CRC, scan.GOOD]
    assert found["msgid"].tolist() == [30, 9_999_999, 30, 30, 30]


def test_a_frame_carried_inside_another_is_not_one():
    inner = Sender(system=7)(attitude(0))[8:]
    payload = list(inner) + [1] * (128 - len(inner))
    send = Sender()
    tunnel = send(dialect.MAVLink_tunnel_message(0, 0, 0, len(inner), payload))
    assert inner in tunnel
    _, found = scanned(send(attitude(0)) + tunnel + send(attitude(1)))
    assert found["sysid"].tolist() == [1, 1, 1]


def test_second_link_is_marked_and_repeats_are_not():
    send = Sender()
    heartbeat = dialect.MAVLink_heartbeat_message(2, 3, 81, 0, 4, 3)
    records = [send(heartbeat if i % 2 else attitude(i)) for i in range(600)]
    _, found = scanned(b"".join(records))
    assert not found["duplicate"].any()
    late = [None] * 7 + records
    both = [part for pair in zip([*records, *[None] * 7], late, strict=True) for part in pair if part]
    _, found = scanned(b"".join(both))
    assert found["duplicate"].sum() == 600
    assert [i for i in found["seq"][~found["duplicate"]]] == [i % 256 for i in range(600)]


def test_every_field_of_the_dialect_has_a_column():
    from bridges.tlog.tlog import COMMON

    for msgid, message in dialect.mavlink_map.items():
        layout = scan.dialect().layouts[msgid]
        assert layout.itemsize == message.unpacker.size
        assert sorted(layout.names) == sorted(message.fieldnames)
        assert not set(layout.names) & set(COMMON.names)
