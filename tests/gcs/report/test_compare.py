"""Two courses on one clock."""

import numpy as np
import pytest

from gcs.contract.messages import InputError
from gcs.report import compare
from gcs.report.basis import page
from tests.gcs.report import folder

TRUTH = np.dtype([("t_ns", "i8"), ("lat_deg", "f8"), ("lon_deg", "f8"), ("alt_m", "f8")])


def truth(east_m: float = 0.0, late_s: float = 0.0, begin_s: float = 0.0):
    """The same flight every 20 ms, from ``begin_s`` on, elsewhere, or where it was ``late_s`` before."""
    t_s = begin_s + np.arange(600) * 0.02
    place = np.column_stack([np.full(600, east_m), folder.SPEED_MPS * (t_s - late_s), np.full(600, 100.0)])
    rows = np.zeros(600, TRUTH)
    rows["t_ns"] = folder.T0_NS + np.round(t_s * 1e9).astype(np.int64)
    rows["lat_deg"], rows["lon_deg"], rows["alt_m"] = folder.FRAME.to_geodetic(place)
    return rows


def against(run, rows, *, live=False) -> compare.Difference:
    second = compare.of_truth(run.folder / "truth.csv", rows, run.frame)
    return compare.difference(compare.of_run(run, run.frame, live=live), second)


def numbers(sheet) -> dict[str, list[str]]:
    return {row[0]: row[1:] for row in sheet.rows}


def test_the_same_is_nowhere_apart(run):
    found = against(run, truth())
    assert len(found.t_ns) == folder.STATES
    assert np.abs(found.enu_m).max() < 1e-3


def test_beside_it_to_the_right(run):
    """The run flies north 1.5 m east of the truth: to the right of it."""
    table = numbers(compare.distances(against(run, truth(), live=True)))
    assert [float(x) for x in table["across, to the right"][:5]] == pytest.approx([1.5] * 5, rel=1e-3)
    assert abs(float(table["along"][1])) < 1e-3
    assert float(table["horizontal"][0]) == pytest.approx(1.5, rel=1e-3)


def test_a_late_clock_is_found_and_taken_off(run):
    """A truth 100 ms behind: 2 m along, and nothing is left without it."""
    found = against(run, truth(late_s=0.1))
    assert compare.time_shift_s(found) == pytest.approx(0.1, abs=1e-4)
    table = numbers(compare.distances(found))
    assert float(table["along"][0]) == pytest.approx(2.0, rel=1e-3)
    assert float(table["in space, +100.0 ms taken off"][1]) < 1e-2


def test_consistency_counts_what_sigma_and_level_do_not_cover(run):
    """Live σ of E is 0.6 m, so 1.5 m east are 2.5 sigma: NEES 6.25, nothing beyond 3 sigma or 5 m."""
    table = numbers(compare.consistency(against(run, truth(), live=True)))
    assert float(table["NEES, mean"][0]) == pytest.approx(6.25, rel=2e-3)
    assert table["E beyond 3 sigma"][0] == "0.00 %"
    assert table["horizontal beyond protection level"][0] == "0.000 % of 81"
    far = numbers(compare.consistency(against(run, truth(east_m=8.0), live=True)))
    assert far["E beyond 3 sigma"][0] == "100.00 %"
    assert far["horizontal beyond protection level"][0] == "100.000 % of 81"
    assert far["height beyond protection level"][0] == "0.000 % of 81"


def test_two_runs_add_their_variances(run, tmp_path):
    second = compare.of_run(run, run.frame, live=False)
    found = compare.difference(compare.of_run(run, run.frame, live=False), second)
    assert found.sigma_m[3].tolist() == pytest.approx(list(np.sqrt(2) * np.array(folder.SIGMA_M)))


def test_only_the_common_time_counts(run):
    found = against(run, truth(begin_s=5.0))
    assert found.t_ns[0] == folder.T0_NS + 50 * folder.STEP_NS
    with pytest.raises(InputError, match="no time in common"):
        against(run, truth(begin_s=500.0))


def test_the_page(run):
    html = page.render(compare.document(against(run, truth())))
    assert "Both from above" in html
    assert "Signed" not in html
