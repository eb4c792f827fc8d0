"""A run folder read again: whole, of a run that was killed, changed by hand."""

import shutil

import numpy as np
import pytest

from gcs.contract.messages import InputError
from gcs.report.basis import run as runs
from tests.gcs.report import folder


def test_everything_is_there(run):
    assert len(run.track) == len(run.smoothed) == folder.STATES
    assert run.heard == ["theo-a"]
    assert len(run.values) == 101
    assert len(run.of("theo-a")) == 100  # the line without a time is only counted
    assert run.reasons["theo-a", "patch", "run"] == 3
    assert run.remarks == []
    assert run.events == [(folder.T0_NS, "warning", "theo-a, <i>silent</i>")]
    assert run.errors[1].sigma == 2.5
    assert run.wind is None


def test_residuals_are_in_sigmas_and_go_the_short_way_round(run):
    off = runs.sigmas_off(run.of("theo-a"))
    assert sorted(set(off.tolist())) == [-1.0, 1.0, 9.0, 20.0]
    north = np.zeros(2, runs.VALUES)
    north["channel"] = runs.CHANNELS.index("azimuth")
    north["value"], north["predicted"], north["sigma"] = (359.9, 0.1), (0.1, 359.9), (0.1, 0.0)
    assert runs.sigmas_off(north)[0] == pytest.approx(-2.0)
    assert np.isnan(runs.sigmas_off(north)[1])


def test_a_killed_run_is_read_and_says_so(written):
    (written / "summary.json").unlink()
    for name in ("track.csv", "verdicts.csv"):
        text = (written / name).read_text()
        (written / name).write_text(text[:-9])
    run = runs.load(written)
    assert len(run.track) == folder.STATES - 1
    assert run.summary == {}
    assert any("did not end" in remark for remark in run.remarks)
    assert any("track.csv: 1 line" in remark for remark in run.remarks)


@pytest.mark.parametrize("torn", range(2, 40, 5))
def test_a_torn_line_of_the_separation_costs_no_more_than_that_line(written, torn):
    whole = runs.load(written).apart
    text = (written / "separation.csv").read_text()
    (written / "separation.csv").write_text(text[:-torn])
    assert len(runs.load(written).apart) >= len(whole) - 1
    (written / "separation.csv").write_text(text.replace("theo-a", "theo-z"))
    run = runs.load(written)
    assert run.apart.tolist() == whole[whole["sensor"] == 0].tolist()
    assert any("separation.csv: 36 lines" in remark for remark in run.remarks)


def test_the_origin_is_found_again_where_the_station_has_none(written):
    text = (written / "station.toml").read_text()
    begin = text.index("[range.origin]")
    (written / "station.toml").write_text(text[:begin] + text[text.index("[vehicle]") :])
    found = runs.load(written).frame
    assert tuple(found[:2]) == pytest.approx(folder.FRAME[:2], abs=2e-8)
    assert found.alt_m == pytest.approx(folder.FRAME.alt_m, abs=2e-3)


def test_what_is_no_run_is_one_line(written, tmp_path):
    with pytest.raises(InputError, match="no such folder"):
        runs.load(tmp_path / "nowhere")
    (written / "track.csv").write_text(folder.TRACK + "\n")
    with pytest.raises(InputError, match="not one state"):
        runs.load(written)
    shutil.copy(written / "smoothed.csv", written / "track.csv")
    (written / "verdicts.csv").write_text(folder.verdicts().replace("isolated", "odd"))
    with pytest.raises(InputError, match=r"verdicts\.csv: 'odd'"):
        runs.load(written)
