"""The radar is the feed with range rate."""

from bridges import feed, radar
from gcs.contract.messages import PolarMeasurement


def test_decode():
    (seen,) = radar.decode(
        b'{"t": 1767225600, "range_m": 2500, "range_rate_mps": -12.5}', 9, "radar-1", "udp"
    )
    assert seen == PolarMeasurement(
        t_ns=1_767_225_600 * 10**9, arrival_ns=9, range_m=2500, range_rate_mps=-12.5
    )


def test_range_rate_from_file(tmp_path):
    path = tmp_path / "radar-1.csv"
    path.write_text("range_rate_mps,t,range_m\n-12.5,1767225600,2500\n99999,1767225601,2600\n")
    rows, (bad,) = radar.read(path, "radar-1")
    assert [m.range_rate_mps for m in feed.measurements(rows)] == [-12.5, None]
    assert bad.reason.startswith("range_rate_mps: '99999'")
