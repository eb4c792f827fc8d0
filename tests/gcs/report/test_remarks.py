"""What the signer must judge."""

import msgspec
import numpy as np

from gcs.report import remarks
from tests.gcs.report import folder


def test_what_stands_out_is_said(run):
    found = "\n".join(remarks.remarks(run))
    assert "known to 50 ms (1 sigma): up to 1 m along the course at 20 m/s" in found
    assert "10.00 % of the time another position" in found
    assert "20.00 % of the time there was no protection level" in found
    assert "theo-a: 1 lines were no measurements" in found
    assert "theo-a range: the noise is 1.50 times what is stated" in found
    assert "geoid" not in found  # there is no INS whose height could be wrong
    assert "changed" not in found


def test_a_changed_file_is_noticed(run):
    run.summary["verdicts"]["theo-a"]["range"]["used"] = 95
    assert any("verdicts.csv has 101 values, the summary counts 102" in line for line in remarks.remarks(run))


def test_what_was_lost_live(run):
    run.summary.update({"bus": {"queue_full": 0, "on_the_way": 1200}, "unknown_sources": {"theo-x": 7}})
    found = remarks.remarks(run)
    assert "Messages lost on the bus: on the way 1,200." in found
    assert "Not of this station, and left out: theo-x." in found


def test_a_silent_instrument_and_many_pauses(run):
    run.station.sensor.append(msgspec.structs.replace(run.station.sensor[0], name="theo-b"))
    run.track["t_ns"] += 10_000_000_000 * (np.arange(folder.STATES) // 5)
    found = remarks.remarks(run)
    assert "theo-b: no value came." in found
    assert sum(line.startswith("No state for") for line in found) == remarks.LISTED
    assert "… and 10 more of these." in found
