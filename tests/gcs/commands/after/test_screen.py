"""``gcs screen``: files out, one line when it cannot."""

import csv
import xml.etree.ElementTree as ElementTree

import numpy as np
import pytest

from gcs.commands.after.screen import noise_of, run
from gcs.contract.messages import InputError

HEADER = "t,range_m,azimuth_deg,elevation_deg"


@pytest.fixture
def feed(tmp_path):
    """A feed of 600 lines: out of order, one twice, one torn, azimuth through north, three outliers."""
    rng = np.random.default_rng(0)
    t_s = np.arange(600) / 20
    range_m = 5000.0 + 30.0 * t_s + rng.normal(0.0, 1.0, 600)
    azimuth = (350.0 + t_s + rng.normal(0.0, 0.003, 600)) % 360.0
    range_m[[100, 101, 400]] += 60.0
    lines = [
        f"{1767225600 + t:.2f},{r:.4f},{a:.6f},"
        for t, r, a in zip(t_s.tolist(), range_m.tolist(), azimuth.tolist(), strict=True)
    ]
    lines[200], lines[201] = lines[201], lines[200]
    lines.insert(300, lines[299])
    lines.insert(301, "1767225615.3,50")
    path = tmp_path / "theo.csv"
    path.write_text("\n".join([HEADER, *lines]) + "\n")
    return path


def table(path) -> list[dict]:
    with path.open() as lines:
        return list(csv.DictReader(lines))


def test_outliers_are_flagged_and_replaced(feed, tmp_path):
    report = run(feed, tmp_path / "out")
    assert report["unreadable"] == 1
    assert report["range"]["outlier"] == 3
    assert report["azimuth"]["outlier"] == 0
    assert "elevation" not in report
    flags = [row for row in table(tmp_path / "out" / "theo.flags.csv") if row["flag"] == "outlier"]
    assert [int(row["t_ns"]) for row in flags] == [
        1767225600_000000000 + k * 50_000_000 for k in (100, 101, 400)
    ]
    assert [float(row["value"]) - float(row["predicted"]) for row in flags] == pytest.approx(
        [60.0] * 3, abs=6.0
    )
    cleaned = table(tmp_path / "out" / "theo.cleaned.csv")
    assert len(cleaned) == 600
    times = [float(row["t"]) for row in cleaned]
    assert times == sorted(times)
    assert float(cleaned[400]["range_m"]) == pytest.approx(5600.0, abs=6.0)


def test_the_cleaned_file_is_a_feed_and_the_picture_opens(feed, tmp_path):
    run(feed, tmp_path)
    again = run(tmp_path / "theo.cleaned.csv", tmp_path)
    assert again["unreadable"] == 0
    assert again["range"]["outlier"] == 0
    picture = ElementTree.parse(tmp_path / "theo.svg").getroot()
    assert len(picture.findall("{*}circle")) == 3
    assert len(picture.findall("{*}path")) == 2


def test_noise_is_told_apart_from_flight_and_outliers():
    rng = np.random.default_rng(1)
    t_s = np.arange(5000) / 20
    x = 1000.0 + 300.0 * np.sin(t_s / 10) + rng.normal(0.0, 2.0, 5000)
    x[rng.random(5000) < 0.04] += 500.0
    assert noise_of(x) == pytest.approx(2.0, rel=0.35)  # a start value
    assert noise_of(np.tile([1.0] * 15 + [1.001], 20)) == pytest.approx(0.001, rel=1e-6)


@pytest.mark.parametrize(
    ("text", "complaint"),
    [
        (None, "No such file"),
        ("t,range\n1,2\n", "unknown column 'range'"),
        (f"{HEADER}\n" + "1767225600,5,,\n" * 3, "no channel has 20 values"),
        (f"{HEADER}\nyesterday,5,,\n", "no line can be read"),
    ],
)
def test_what_is_no_feed_is_refused_in_one_line(tmp_path, text, complaint):
    path = tmp_path / "feed.csv"
    if text is not None:
        path.write_text(text)
    with pytest.raises(InputError, match=complaint) as refused:
        run(path, tmp_path)
    assert "\n" not in str(refused.value)


def test_unknown_method_is_refused(feed, tmp_path):
    with pytest.raises(InputError, match="choose one of linear-adaptive"):
        run(feed, tmp_path, method="best")
