"""A run whose disk fails goes on to its end, and its summary says what is missing."""

import json
from pathlib import Path

import numpy as np
import pytest

from filters.models.rows import SEPARATION, TRACK
from gcs.contract import config
from gcs.contract.frames import Frame
from gcs.outputs import disk, record
from gcs.outputs.record import TRACK_HEADER, Record
from gcs.station.ledger import Ledger
from gcs.station.session import Update


@pytest.fixture
def update():
    """Five epochs, nothing judged."""
    ledger = Ledger(["ins"], ())
    track = np.zeros(5, TRACK)
    track["t_ns"], track["P"] = np.arange(5), np.eye(9)
    nothing = ledger.at(np.empty(0, int))
    return Update(track, track[:3], nothing, nothing, ledger)


@pytest.fixture
def begin(monkeypatch):
    """Opens a record; what its operator is told goes into a list."""
    monkeypatch.setattr(disk, "RETRY_S", 0.0)
    monkeypatch.setattr(disk, "LAST_TRY_S", 0.0)

    def begin(folder: Path) -> tuple[Record, list[str]]:
        told: list[str] = []
        return Record(folder, config.Station(), Frame(0.0, 0.0, 0.0), lambda _, text: told.append(text)), told

    return begin


def test_a_whole_run_says_that_nothing_is_missing(begin, tmp_path, update):
    sink, told = begin(tmp_path)
    sink.take(update)
    sink.close({"complete": True}, update.track)
    assert json.loads((tmp_path / "summary.json").read_text()) == {"complete": True, "not_written": {}}
    assert len((tmp_path / "smoothed.csv").read_text().splitlines()) == 6
    assert told == []


def test_the_separation_of_each_sensor_is_a_row(begin, tmp_path, update):
    told = np.array([(7, 0, 0.25, 0.5, 1.0, 2.0), (8, 0, 12.34567, 0.0, 1.0, 2.0)], SEPARATION)
    sink, _ = begin(tmp_path)
    sink.take(update)
    for k in range(2):
        sink.take(update._replace(separation=told[k : k + 1]))
    assert (tmp_path / "separation.csv").read_text().splitlines() == [
        "t_ns,sensor,horizontal_m,vertical_m,sigma_h_m,sigma_v_m",
        "7,ins,0.2500,0.5000,1.0000,2.0000",
        "8,ins,12.3457,0.0000,1.0000,2.0000",
    ]


def test_while_a_long_best_estimate_is_written_it_says_that_it_goes_on(tmp_path, update, monkeypatch):
    monkeypatch.setattr(record, "PIECE", 2)
    parts = []
    sink = Record(tmp_path, config.Station(), Frame(0.0, 0.0, 0.0), goes_on=lambda: parts.append(1))
    sink.close({}, update.track)
    assert len(parts) == 3
    assert len((tmp_path / "smoothed.csv").read_text().splitlines()) == 6


def test_a_full_disk_is_told_counted_and_survived(begin, tmp_path, update):
    (tmp_path / "track.csv").symlink_to("/dev/full")
    sink, told = begin(tmp_path)
    for _ in range(3):
        sink.take(update)
    sink.close({}, update.track)
    lost = 1 + 3 * 5  # header and rows
    assert json.loads((tmp_path / "summary.json").read_text())["not_written"] == {"track.csv": lost}
    assert "No space left" in told[0]
    assert f"track.csv {lost}" in told[-1]


def test_without_room_for_the_best_estimate_the_windows_view_stays(begin, tmp_path, update):
    sink, told = begin(tmp_path)
    sink.take(update)
    (tmp_path / "smoothed.csv.new").symlink_to("/dev/full")
    (tmp_path / "summary.json.new").symlink_to("/dev/full")
    sink.close({}, update.track)
    assert (tmp_path / "smoothed.csv").read_text().startswith(TRACK_HEADER)
    assert len((tmp_path / "smoothed.csv").read_text().splitlines()) == 4
    assert not (tmp_path / "summary.json").exists()
    assert any("summary.json: No space left" in text for text in told)
    assert "smoothed.csv 5" in told[-1]


def test_a_folder_taken_away_is_there_again(begin, tmp_path, update):
    folder = tmp_path / "run"
    folder.mkdir()
    sink, told = begin(folder)
    sink.take(update)
    for path in folder.iterdir():
        path.unlink()
    folder.rmdir()
    sink.take(update)
    sink.close({}, update.track)
    assert len((folder / "track.csv").read_text().splitlines()) == 11
    assert {path.name for path in folder.iterdir()} >= {
        "smoothed.csv",
        "verdicts.csv",
        "summary.json",
        "station.toml",
    }
    assert any("taken away" in text for text in told)
