"""States in Foxglove's schemas: their fields by name, and the numbers in their places."""

import json

import msgspec
import numpy as np
import pytest

from gcs.contract.messages import Event
from gcs.outputs import foxglove
from tests.gcs.contract.ends import state

REQUIRED = {  # of the schemas that Foxglove publishes
    foxglove.Odometry: "timestamp frame_id child_frame_id",
    foxglove.LocationFix: "timestamp frame_id latitude longitude altitude position_covariance "
    "position_covariance_type",
    foxglove.FrameTransform: "timestamp parent_frame_id child_frame_id translation rotation",
    foxglove.Log: "timestamp level message name file line",
}


@pytest.mark.parametrize("kind", REQUIRED, ids=lambda kind: kind.__name__)
def test_a_schema_names_what_foxglove_requires(kind):
    described = foxglove.schema(kind)
    assert set(REQUIRED[kind].split()) <= set(described["properties"])
    assert described["properties"]["timestamp"]["properties"].keys() == {"sec", "nsec"}
    assert "$ref" not in json.dumps(described)


def test_a_state_keeps_its_numbers():
    """Each block of the covariance where Foxglove looks for it, East North Up, row by row."""
    root = np.random.default_rng(3).normal(size=(9, 9))
    whole = root @ root.T
    one = msgspec.structs.replace(
        state(0),
        t_ns=1_700_000_000_123_456_789,
        lat_deg=-35.5,
        lon_deg=149.25,
        alt_m=600.5,
        position_enu_m=(1.25, -2.5, 3.75),
        velocity_enu_mps=(4.5, 5.5, -6.5),
        covariance=whole[np.tril_indices(9)].tolist(),
    )
    odometry, fix, transform = foxglove.of_state(one, "demo", "uav1")
    assert odometry.timestamp == fix.timestamp == transform.timestamp
    assert odometry.timestamp == foxglove.Time(1_700_000_000, 123_456_789)
    assert (odometry.frame_id, odometry.child_frame_id, fix.frame_id) == ("demo", "uav1", "uav1")
    assert odometry.pose.position == transform.translation == foxglove.Vector3(1.25, -2.5, 3.75)
    assert odometry.pose.orientation == transform.rotation == foxglove.Quaternion(0, 0, 0, 1)
    assert odometry.linear_velocity == fix.velocity == foxglove.Vector3(4.5, 5.5, -6.5)
    assert (fix.latitude, fix.longitude, fix.altitude) == (-35.5, 149.25, 600.5)
    np.testing.assert_allclose(np.reshape(fix.position_covariance, (3, 3)), whole[:3, :3], rtol=1e-3)
    for given, block in (
        (odometry.pose_covariance, whole[:3, :3]),
        (odometry.velocity_covariance, whole[3:6, 3:6]),
    ):
        padded = np.reshape(given, (6, 6))
        np.testing.assert_allclose(padded[:3, :3], block, rtol=1e-3)
        assert not padded[3:].any()
        assert not padded[:, 3:].any()


@pytest.mark.parametrize(("level", "number"), [("info", 2), ("warning", 3), ("error", 4), ("what", 0)])
def test_an_event_is_a_log(level, number):
    log = foxglove.of_event(Event(t_ns=-5, level=level, text="radar-1 is back"), "uav1")
    assert (log.timestamp, log.level, log.message) == (foxglove.Time(0, 0), number, "radar-1 is back")
