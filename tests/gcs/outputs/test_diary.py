"""What was told is kept: events, wind, systematic errors."""

import csv
import json
from collections import Counter

import numpy as np
import pytest

from filters.models.rows import TRACK
from gcs.contract.messages import Event, Wind
from gcs.outputs import disk
from gcs.outputs.diary import Diary, error_lines
from gcs.outputs.recording import RunRecorder
from gcs.station.health import Files, Monitor
from gcs.station.ledger import Ledger
from gcs.station.session import Update
from tests.gcs.station import made

S = 1_000_000_000
NAMES = ("events", "wind", "errors")
ERROR = {
    "value": np.radians(0.02),
    "sigma": np.radians(0.001),
    "prior_sigma": np.radians(0.05),
    "unit": "rad",
    "observable": True,
}
REPORT = {"sensors": {"theo": {"errors": {"azimuth": ERROR}}}}


def update(t_ns: int, *told) -> Update:
    ledger, track = Ledger(["ins", "theo"], ("",)), np.zeros(1, TRACK)
    track["t_ns"] = t_ns
    nothing = ledger.retire()
    return Update(track, track[:0], nothing, nothing, ledger, told, lambda: REPORT)


def test_everything_told_is_a_row(tmp_path):
    diary = Diary(tmp_path, Monitor(["ins", "theo"], Files()), Counter())
    wind = Wind(
        t_ns=3 * S, speed_mps=5.0, from_deg=270.0, e_mps=5.0, n_mps=0.0, covariance=(4.0, 0.0, 1.0),
        known=True, airspeed_scale=1.0,
    )  # fmt: skip
    diary.take(update(2 * S, Event(t_ns=2 * S, level="warning", text='lost, "for now"'), wind))
    diary.take(update(2 * S + S // 2))  # half a second later: no new row of an error
    diary.take(update(4 * S))
    rows = {name: list(csv.DictReader((tmp_path / f"{name}.csv").open())) for name in NAMES}
    diary.close({}, np.zeros(0, TRACK))
    assert rows["events"] == [{"t_ns": str(2 * S), "level": "warning", "text": 'lost, "for now"'}]
    assert [rows["wind"][0][name] for name in ("speed_mps", "sigma_mps", "known", "own_speed_mps")] == [
        "5.000",
        "2.000",
        "1",
        "",
    ]
    assert [row["t_ns"] for row in rows["errors"]] == [str(2 * S), str(4 * S)]


def test_the_writing_is_left_to_who_has_the_time(tmp_path):
    """As in a live run: the fusion does not wait for the disk."""
    left = []
    diary = Diary(tmp_path, Monitor(["ins", "theo"], Files()), Counter(), put=lambda *work: left.append(work))
    diary.take(update(2 * S, Event(t_ns=2 * S, level="info", text="radar is back")))
    diary.take(update(2 * S + 1))  # nothing to write
    [(work, size, rows)] = left
    assert (size, rows) == (2, {"events.csv": 1, "errors.csv": 1})
    assert "radar is back" not in (tmp_path / "events.csv").read_text()
    work()
    assert "radar is back" in (tmp_path / "events.csv").read_text()


def test_rows_that_a_full_disk_does_not_take_are_in_the_summary(tmp_path, monkeypatch):
    monkeypatch.setattr(disk, "LAST_TRY_S", 0.0)
    (tmp_path / "events.csv").symlink_to("/dev/full")
    told = []
    station, frame = made.station()
    recorder = RunRecorder(tmp_path, station, frame, lambda _, text: told.append(text), made.ABOUT)
    monitor = Monitor(["ins", "theo"], Files())
    diary = Diary(tmp_path, monitor, recorder.missing, recorder.note, recorder.put)
    diary.take(update(2 * S, Event(t_ns=2 * S, level="info", text="radar is back")))
    for sink in (diary, recorder):
        sink.close({}, np.zeros(0, TRACK))
    recorder.end()
    assert "No space left" in told[0]
    missing = {"events.csv": 2}  # one is the header
    assert json.loads((tmp_path / "summary.json").read_text())["not_written"] == missing
    assert told[1:] == [f"{tmp_path}: the disk did not take all; missing rows: events.csv 2"]


def test_angles_are_in_degrees():
    (line,) = error_lines(7, REPORT)
    assert line.startswith("7,theo,azimuth,")
    assert [float(x) for x in line.strip().split(",")[3:]] == pytest.approx([0.02, 0.001, 0.05], rel=1e-5)
