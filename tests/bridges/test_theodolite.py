"""The theodolite is the feed without range rate."""

import pytest

from bridges import feed, theodolite
from gcs.contract.messages import PolarMeasurement


def test_decode():
    (seen,) = theodolite.decode(
        b'{"t": 1767225600, "range_m": 812.4, "azimuth_deg": 12.25, "elevation_deg": 3.5}', 9, "theo", "udp"
    )
    assert seen == PolarMeasurement(
        t_ns=1_767_225_600 * 10**9, arrival_ns=9, range_m=812.4, azimuth_deg=12.25, elevation_deg=3.5
    )


def test_passive_theodolite_has_no_range(tmp_path):
    path = tmp_path / "theo.csv"
    path.write_text("t,azimuth_deg,elevation_deg\n1767225600,12.25,3.5\n")
    rows, _ = theodolite.read(path, "theo")
    (seen,) = feed.measurements(rows)
    assert (seen.range_m, seen.azimuth_deg, seen.elevation_deg) == (None, 12.25, 3.5)


def test_range_rate_is_unknown_to_it(tmp_path):
    path = tmp_path / "theo.csv"
    path.write_text("t,range_rate_mps\n1767225600,1\n")
    with pytest.raises(feed.FeedError, match="'range_rate_mps'; valid columns are t, range_m, azimuth_deg"):
        theodolite.read(path, "theo")
    (bad,) = theodolite.decode(b'{"t": 1767225600, "range_rate_mps": 3}', 9, "theo", "udp")
    assert bad.reason.startswith("unknown name 'range_rate_mps'")
