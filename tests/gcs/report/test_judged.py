"""Tables of verdicts, systematic errors and consistency."""

import numpy as np
import pytest

from gcs.report import judged
from gcs.report.basis.numbers import Whiteness


def test_values_by_verdict_with_the_longest_run(run):
    sheet = judged.counts(run)
    assert sheet.head[2:7] == ["all", "used", "deweighted", "isolated", "patch"]
    ranges, lines = sheet.rows
    assert ranges == [
        "theo-a", "range", "100", "94", "2", "1", "3", "·", "4.0", "3", "0.200", "00:00:04.000",
    ]  # fmt: skip
    assert lines[:8] == ["theo-a", "line", "1", "·", "·", "·", "·", "1"]
    assert sheet.note.endswith("No value is duplicate or late.")


def test_reasons_without_their_sigmas(run):
    assert ["theo-a", "patch", "run", "3"] in judged.reasons(run).rows
    assert ["theo-a", "deweighted", "innovation", "2"] in judged.reasons(run).rows


def test_systematic_errors_with_their_significance(run):
    by_name = {row[1]: row for row in judged.errors(run).rows}
    assert by_name["range"][2:] == ["0.500", "0.10", "5", "m", "5.0", "significant"]
    assert by_name["clock"][-1] == "this flight does not show it"


def test_angles_come_in_degrees():
    error = {
        "value": np.radians(0.02),
        "sigma": np.radians(0.001),
        "prior_sigma": np.radians(0.05),
        "unit": "rad",
    }
    assert judged.in_degrees(error) == pytest.approx((0.02, 0.001, 0.05, "°"))


def test_noise_and_memory_of_a_channel(run):
    (row,) = judged.consistency(run).rows
    assert row[:7] == ["theo-a", "range", "96", "2.25", "0.720 to 1.280", "above", "1.5"]
    assert (
        row[7] == "-0.948"
    )  # (2 − 93) / 96: +1 and −1 in turns, the same sign twice where values are left out
    assert row[9] == "no slow error"


@pytest.mark.parametrize(
    ("mean", "says"),
    [(1.0, "inside"), (1.3, "above, slightly"), (2.0, "above"), (0.8, "below, slightly"), (0.3, "below")],
)
def test_what_nis_says(mean, says):
    assert judged.says_of(mean, [0.9, 1.1]) == says


def test_what_a_correlation_says():
    assert [judged.memory_of(Whiteness(r, 0.1, 400)) for r in (0.05, 0.3, -0.3)] == [
        "white",
        "slow error",
        "no slow error",
    ]
