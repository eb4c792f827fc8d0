"""Lines of sight against triangles one can draw."""

import numpy as np
import pytest

from gcs.report.basis import geometry
from gcs.report.basis import run as runs
from tests.gcs.report import folder

SENSOR = """
[[sensor]]
name = "{}"
kind = "theodolite"
sigma = {{ azimuth_deg = 0.01, elevation_deg = 0.01 }}
position = {{ lat_deg = {:.10f}, lon_deg = {:.10f}, alt_m = {:.4f} }}
"""


def test_what_the_instrument_should_see(run):
    """The theodolite stands at the origin; after 5 s the vehicle is 100 m north of it and 100 m up."""
    seen = geometry.sight(run, "theo-a", np.array([folder.T0_NS + 50 * folder.STEP_NS]))
    assert seen.range_m[0] == pytest.approx(100 * np.sqrt(2), abs=1e-3)
    assert seen.azimuth_deg[0] % 360 == pytest.approx(0.0, abs=1e-3)
    assert seen.elevation_deg[0] == pytest.approx(45.0, abs=1e-3)


def test_one_instrument_has_no_crossing_but_a_fix_with_its_range(run):
    found = geometry.crossing(run, 1.0)
    assert np.isnan(found.angle_deg).all()
    assert np.isnan(found.horizontal_m).all()  # only ranges came


def test_two_angles_cross_at_a_right_angle(tmp_path):
    """Two passive theodolites 1 km from a target at their height, seen at a right angle.

    Each azimuth fixes one horizontal axis to d σ, both elevations the height to d σ / √2.
    """
    written = folder.write(tmp_path)
    station = (written / "station.toml").read_text()
    places = [
        folder.FRAME.to_geodetic(np.array([p])) for p in ((-1000.0, 200.0, 100.0), (0.0, -800.0, 100.0))
    ]
    text = station[: station.index("[[sensor]]")]
    for name, place in zip("ab", places, strict=True):
        text += SENSOR.format(name, *(float(x[0]) for x in place))
    (written / "station.toml").write_text(text)
    lines = ["t_ns,sensor,channel,value,predicted,sigma,weight,verdict,reason"]
    lines += [
        f"{folder.T0_NS + k * folder.STEP_NS},{name},{channel},1,1,1,1,used,"
        for k in range(101) for name in "ab" for channel in ("azimuth", "elevation")
    ]  # fmt: skip
    (written / "verdicts.csv").write_text("\n".join(lines) + "\n")
    found = geometry.crossing(runs.load(written), 10.0)  # the last one: 200 m north, 100 m up
    width = 1000.0 * np.radians(0.01)
    assert found.angle_deg[-1] == pytest.approx(90.0, abs=0.05)
    assert found.horizontal_m[-1] == pytest.approx(width * np.sqrt(2), rel=1e-3)
    assert found.height_m[-1] == pytest.approx(width / np.sqrt(2), rel=1e-3)
    assert found.dilution[-1] == pytest.approx(np.sqrt(2.5), rel=1e-3)


def test_claims_are_places_that_were_refused(run, written):
    assert len(geometry.claims(run, "theo-a", runs.REFUSED)[0]) == 0  # a range alone is no place
    rows = ["t_ns,sensor,channel,value,predicted,sigma,weight,verdict,reason"]
    for channel, value, verdict in (
        ("range", 500, "isolated"),
        ("azimuth", 90, "used"),
        ("elevation", 0, "used"),
    ):
        rows.append(f"{folder.T0_NS},theo-a,{channel},{value},1,1,1,{verdict},")
    (written / "verdicts.csv").write_text("\n".join(rows) + "\n")
    times, places = geometry.claims(runs.load(written), "theo-a", runs.REFUSED)
    assert times.tolist() == [folder.T0_NS]
    assert places[0].tolist() == pytest.approx([500.0, 0.0, 0.0], abs=1e-6)
