"""What may be laid beside the flight on the page."""

import sys
from pathlib import Path

import numpy as np
import pytest

from gcs.commands.cli import main
from gcs.commands.compose import other_course
from gcs.contract.messages import InputError
from tests.gcs.report import folder

SAMPLE = Path(__file__).parents[3] / "logs" / "sample"


def test_a_truth_file_in_order_of_time(tmp_path):
    lines = (SAMPLE / "truth.csv").read_text().splitlines()
    (tmp_path / "truth.csv").write_text("\n".join([lines[0], *lines[:100:-1]]))
    found = other_course(tmp_path / "truth.csv")
    assert found.name == "truth.csv"
    assert np.all(np.diff(found.t_ns) > 0)
    assert found.lat_deg[0] == pytest.approx(-35.363, abs=0.01)


def test_a_run_s_best_estimate(tmp_path):
    written = folder.write(tmp_path)
    found = other_course(written)
    assert (found.name, len(found.t_ns)) == (written.name, folder.STATES)
    east_m = folder.FRAME.to_enu(found.lat_deg, found.lon_deg, found.alt_m)[:, 0]
    assert np.abs(east_m).max() < 0.1  # live is APART_M to the east


def test_nothing_to_draw_is_told_in_one_line(tmp_path):
    (tmp_path / "truth.csv").write_text("t_ns,lat_deg,lon_deg,alt_m\n")
    with pytest.raises(InputError, match="not one place"):
        other_course(tmp_path / "truth.csv")
    with pytest.raises(InputError, match="no such file"):
        other_course(tmp_path / "nothing.csv")


def test_a_replay_without_a_page_has_nowhere_to_draw_it(monkeypatch, capsys, tmp_path):
    arguments = ["gcs", "replay", "flight.tlog", "--overlay", "truth.csv", "--out", str(tmp_path)]
    monkeypatch.setattr(sys, "argv", arguments)
    with pytest.raises(SystemExit) as left:
        main()
    assert left.value.code == 2
    assert "add --view" in capsys.readouterr().err


def test_boot_time_without_a_log_is_told_without_an_option_that_is_not_there(tmp_path):
    (tmp_path / "truth.csv").write_text("TimeUS,lat_deg,lon_deg,alt_m\n1,2,3,4\n")
    with pytest.raises(InputError, match=r"boot time; give a truth file with t_ns") as told:
        other_course(tmp_path / "truth.csv")
    assert "--tlog" not in str(told.value)
