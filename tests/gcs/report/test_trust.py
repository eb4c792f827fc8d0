"""The verdict against tolerances, and the percentiles."""

import numpy as np
import pytest

from gcs.report import trust
from gcs.report.basis import run as runs
from gcs.report.trust import Tolerance
from tests.gcs.report import folder


def rows(sheet) -> dict[str, list[str]]:
    return {row[0]: row[1:] for row in sheet.rows}


def test_the_criteria_are_those_of_the_published_sigma(run):
    """σ of E and N is 0.3 and 0.4 m; the common clock is in it already."""
    assert trust.common_clock_s(run) == 0.05
    found = trust.criteria(run, Tolerance(1.1, 1.0))
    assert found[0].reached_m.tolist() == pytest.approx([2 * np.hypot(0.3, 0.4)] * folder.STATES)
    assert found[1].reached_m.tolist() == pytest.approx([1.96 * 0.5] * folder.STATES)
    table = rows(trust.tolerances(found))
    assert table["best estimate, horizontal, 95 %"] == ["1.1", "100", "1.00", "00:00:00.000", "100", "met"]
    assert table["live protection level, horizontal"][-1] == "not met"
    assert trust.verdict(run, found)[:2] == ("Within tolerance", "good")


def test_a_clock_taken_as_right_ends_that(run):
    errors = run.summary["estimator"]["sensors"]["theo-a"]["errors"]
    del errors["clock"]
    assert trust.common_clock_s(run) == 0.0
    found = trust.criteria(run, Tolerance(1.0, None))
    assert found[0].reached_m[0] == pytest.approx(1.0)


def test_what_does_not_keep_the_tolerance_is_told_with_its_share(run):
    run.smoothed["sigma_u_m"][50:] = 5.0
    verdict = trust.verdict(run, trust.criteria(run, Tolerance(3.0, 2.0)))
    assert verdict[:2] == ("Not within tolerance", "bad")
    assert "height, 95 %: 50.00 % of the time within 2 m, worst 9.80 m at 00:00:05.000" in verdict.reasons[1]


def test_no_tolerance_and_no_end_are_open(run, written):
    assert trust.verdict(run, trust.criteria(run, Tolerance())).word == "No tolerance stated"
    (written / "summary.json").unlink()
    killed = runs.load(written)
    assert trust.verdict(killed, trust.criteria(killed, Tolerance(9.0))).level == "open"
    run.summary["complete"] = False
    assert trust.verdict(run, trust.criteria(run, Tolerance(9.0))).level == "open"


def test_percentiles(run):
    run.smoothed["sigma_u_m"][7] = 4.0
    table = rows(trust.percentiles(run))
    assert table["best estimate, σ horizontal"][:3] == ["0.500", "0.500", "0.500"]
    assert table["best estimate, σ height"] == ["0.500", "0.500", "0.500", "4.00", "00:00:00.700"]
    assert table["live, protection level height"][0] == "6.00"
    assert table["live − best estimate, horizontal"][3] == "1.50"


def test_shares_of_the_time(run):
    table = rows(trust.shares(run))
    assert table["ambiguous: another position fitted nearly as well"] == ["10.00"]
    assert table["no protection level"] == ["20.00"]


@pytest.mark.parametrize(
    ("share", "text"), [(1.0, "100"), (0.999999, "99.99"), (0.0, "0.00"), (1e-6, "< 0.01"), (0.5, "50.00")]
)
def test_nearly_all_is_not_all(share, text):
    assert trust.percent(share) == text
