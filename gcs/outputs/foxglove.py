"""The cleaned state and the events in the schemas that Foxglove defines, as JSON.

``Odometry`` and ``FrameTransform`` place the vehicle in the range's frame, East-North-Up at the origin;
``LocationFix`` is the same in WGS84, altitude above the ellipsoid. Attitude is not estimated: the vehicle's
axes are drawn as the range's, so velocities are East-North-Up in both. Foxglove's ``Log`` is our event.
Names and meaning of the fields: foxglove.dev, "Message schemas".
"""

from collections.abc import Iterator
from typing import Any

import msgspec
import numpy as np

from gcs.contract.messages import Event, State

KNOWN = 3  # position_covariance_type
LEVELS = {"info": 2, "warning": 3, "error": 4}


class Time(msgspec.Struct, frozen=True):
    """Unix time; Foxglove has none before 1970."""

    sec: int
    nsec: int


class Vector3(msgspec.Struct, frozen=True):
    x: float
    y: float
    z: float


class Quaternion(msgspec.Struct, frozen=True):
    x: float = 0.0
    y: float = 0.0
    z: float = 0.0
    w: float = 1.0


class Pose(msgspec.Struct, frozen=True):
    position: Vector3
    orientation: Quaternion = Quaternion()


class Odometry(msgspec.Struct, frozen=True):
    """Position and velocity with their covariances, (6, 6) row by row; what is not estimated is zero."""

    timestamp: Time
    frame_id: str
    child_frame_id: str
    pose: Pose
    linear_velocity: Vector3
    pose_covariance: list[float]
    velocity_covariance: list[float]


class LocationFix(msgspec.Struct, frozen=True):
    timestamp: Time
    frame_id: str
    latitude: float
    longitude: float
    altitude: float
    position_covariance: list[float]  # (3, 3) m² East-North-Up, row by row
    velocity: Vector3
    position_covariance_type: int = KNOWN


class FrameTransform(msgspec.Struct, frozen=True):
    timestamp: Time
    parent_frame_id: str
    child_frame_id: str
    translation: Vector3
    rotation: Quaternion = Quaternion()


class Log(msgspec.Struct, frozen=True):
    timestamp: Time
    level: int
    message: str
    name: str
    file: str = ""
    line: int = 0


Shown = Odometry | LocationFix | FrameTransform | Log
TOPICS: dict[type, str] = {
    Odometry: "/state/odometry",
    LocationFix: "/state/location",
    FrameTransform: "/tf",
    Log: "/events",
}


def of_state(state: State, range_name: str, vehicle: str) -> Iterator[Shown]:
    """A state in its three forms; metres to 0.1 mm, covariances to 4 digits."""
    at, position = _time(state.t_ns), _vector(state.position_enu_m)
    velocity = _vector(state.velocity_enu_mps)
    whole = np.zeros((9, 9))
    whole[np.tril_indices(9)] = state.covariance
    p = [[_short(whole[max(i, j), min(i, j)]) for j in range(3)] for i in range(3)]
    v = [[_short(whole[max(i, j), min(i, j)]) for j in range(3, 6)] for i in range(3, 6)]
    yield Odometry(at, range_name, vehicle, Pose(position), velocity, _padded(p), _padded(v))
    place = round(state.lat_deg, 9), round(state.lon_deg, 9), round(state.alt_m, 4)
    yield LocationFix(at, vehicle, *place, [*p[0], *p[1], *p[2]], velocity)
    yield FrameTransform(at, range_name, vehicle, position)


def of_event(event: Event, name: str) -> Log:
    return Log(_time(event.t_ns), LEVELS.get(event.level, 0), event.text, name)


def schema(message_type: type) -> dict[str, Any]:
    """JSON schema of a message, in one piece: not every reader follows references."""
    _, parts = msgspec.json.schema_components([message_type], ref_template="{name}")

    def whole(node: Any) -> Any:
        if isinstance(node, dict):
            if set(node) <= {"$ref", "default"} and "$ref" in node:
                return whole(parts[node["$ref"]])
            return {key: whole(value) for key, value in node.items()}
        return [whole(item) for item in node] if isinstance(node, list) else node

    return whole(parts[message_type.__name__])


def _time(t_ns: int) -> Time:
    return Time(*divmod(max(t_ns, 0), 1_000_000_000))


def _vector(xyz: tuple[float, float, float]) -> Vector3:
    return Vector3(*(round(value, 4) for value in xyz))


def _padded(block: list[list[float]]) -> list[float]:
    """A (3, 3) block as the first of a (6, 6) matrix."""
    return [*(value for row in block for value in (*row, 0.0, 0.0, 0.0)), *[0.0] * 18]


def _short(value: float) -> float:
    return float(f"{value:.4g}")
