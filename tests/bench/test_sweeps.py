"""The reader of recorded angle stations: logs, geometry, and two frames brought together."""

import struct

import numpy as np
import pytest

from bench.trials.real import sweeps
from bench.trials.world import AZIMUTH, ELEVATION

CONFIG = """
calibs:
  0: {tilt: 0.5}
geos:
  0:
    origin: [0.0, 0.0, 0.0]
    rotation: [[1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0]]
  1:
    origin: [4.0, 1.0, 0.5]
    rotation: [[0.0, -1.0, 0.0], [1.0, 0.0, 0.0], [0.0, 0.0, 1.0]]
"""
TURN = np.array([[0.0, -1.0, 0.0], [1.0, 0.0, 0.0], [0.0, 0.0, 1.0]])  # of station 1


def written(version, events):
    """A log of (name, {field: type}, rows with their stamps in front)."""
    out = struct.pack("<BHH", 0xBC, version, len(events))
    for number, (name, fields, _) in enumerate(events):
        out += struct.pack("<H", number) + name.encode() + b"\0" + struct.pack("<H", len(fields))
        out += b"".join(f"{field}({kind})".encode() + b"\0" for field, kind in fields.items())
    for number, (_, fields, said) in enumerate(events):
        for when, *values in said:
            out += struct.pack("<HI" if version == 1 else "<HQ", number, when)
            out += struct.pack("<" + "".join(fields.values()), *values)
    return out + b"crc!"


@pytest.mark.parametrize(("version", "unit"), [(1, 1.0), (2, 1000.0)])
def test_a_log_gives_its_columns(version, unit):
    angles = ("angle", {"station": "B", "value": "f"}, [(5000, 1, 0.25), (7000, 0, -0.5)])
    found = sweeps.decode(written(version, [angles, ("never", {"x": "f"}, [])]))
    assert list(found) == ["angle"]
    assert found["angle"]["timestamp"].tolist() == [5000 / unit, 7000 / unit]
    assert found["angle"]["station"].tolist() == [1, 0]
    assert found["angle"]["value"].tolist() == [0.25, -0.5]


def test_another_file_is_no_log():
    with pytest.raises(ValueError, match="not a log of this vehicle"):
        sweeps.decode(b"\x00\x01\x00\x00\x00\x00")


def test_the_rows_point_from_the_stations_to_the_target():
    """Angles of two planes, each seen by four receivers, become azimuth and elevation of each station."""
    target, said = np.array([1.5, 0.5, 0.8]), []
    stations = (np.zeros(3), np.eye(3)), (np.array([4.0, 1.0, 0.5]), TURN)
    for when in np.arange(0.0, 1.0, 1 / 30):
        for k, (origin, turn) in enumerate(stations):
            forward, left, up = turn.T @ (target - origin)
            for sweep, side in ((0, left), (1, up)):
                stamp = 1e3 * (when + 0.016 * k + 0.008 * sweep)
                said += [(stamp + 0.01 * r, k, sweep, np.arctan2(side, forward)) for r in range(4)]
    said.pop()  # a sweep that one receiver missed
    columns = dict(
        zip(("timestamp", "basestation", "sweep", "correctedAngle"), np.array(said).T, strict=True)
    )
    rows = sweeps._rows(columns)
    assert (np.diff(rows["t_ns"]) >= 0).all()
    sensors = sweeps._sensors(CONFIG, 1e-3)
    for k, sensor in enumerate(sensors):
        east, north, up = sensor.rotation @ (target - sensor.offset_m)
        for channel, value in (
            (AZIMUTH, np.arctan2(east, north)),
            (ELEVATION, np.arctan2(up, np.hypot(east, north))),
        ):
            mine = rows["value"][(rows["sensor"] == k) & (rows["channel"] == channel)]
            assert len(mine) == (29 if channel == ELEVATION else 30)  # the last has no azimuth after it
            assert np.allclose(mine, value, atol=1e-9)


def test_two_frames_and_clocks_are_brought_together():
    t_s = np.arange(0.0, 20.0, 1 / 300)
    p = np.column_stack([np.sin(t_s), np.cos(1.3 * t_s), 1.0 + 0.3 * np.sin(0.7 * t_s)])
    capture = np.column_stack([1e3 * t_s + 777.0, p @ TURN + [5.0, -2.0, 0.1]])
    capture[3000:3100, 1:] = np.nan
    own_s = np.arange(0.5, 19.5, 1 / 30)
    own = {"timestamp": 1e3 * own_s + 4000.0, "delta": np.zeros(len(own_s))}
    own |= {axis: np.interp(own_s, t_s, p[:, k]) for k, axis in enumerate("xyz")}
    ends = {"timestamp": np.array([4000.0 - 37.0, 4000.0 + 1e3 * t_s[-1] + 22.0])}
    found_s, found, left_m = sweeps._aligned(
        {"lhCrossingBeam": own, "activeMarkerModeChanged": ends}, capture
    )
    assert left_m < 2e-3
    k = np.searchsorted(found_s, 4.0 + 10.0)
    assert np.linalg.norm(found[k] - [np.interp(found_s[k] - 4.0, t_s, axis) for axis in p.T]) < 5e-3
