"""The ellipsoid and the aircraft's attitude, against closed forms."""

from unittest.mock import MagicMock

import numpy as np
from viser.transforms import SO3

from web.scene.aircraft import OF_NOW, THEN, Aircraft, attitude, barrel, ellipsoid


def lower(position_covariance: np.ndarray) -> list[float]:
    full = np.eye(9)
    full[:3, :3] = position_covariance
    return full[np.tril_indices(9)].tolist()


def test_ellipsoid_of_a_turned_covariance():
    turn = SO3.from_rpy_radians(0.3, -0.5, 1.1).as_matrix()
    radii, axes = ellipsoid(lower(turn @ np.diag([1.0, 4.0, 9.0]) @ turn.T))
    np.testing.assert_allclose(radii, [3.0, 6.0, 9.0])
    assert np.isclose(np.linalg.det(axes), 1.0)
    np.testing.assert_allclose(np.abs(axes.T @ turn), np.eye(3), atol=1e-9)


def test_level_flight_points_the_nose_along_the_velocity():
    rotation = SO3(attitude((0.0, 20.0, 0.0), (0.0, 0.0, 0.0))).as_matrix()
    np.testing.assert_allclose(rotation @ (1, 0, 0), (0, 1, 0), atol=1e-12)
    np.testing.assert_allclose(rotation @ (0, 0, 1), (0, 0, 1), atol=1e-12)


def test_a_coordinated_turn_banks_by_the_ratio_of_accelerations():
    left_mps2 = 9.80665  # one g to the left, so 45° of bank to the left
    up = SO3(attitude((20.0, 0.0, 0.0), (0.0, left_mps2, 0.0))).as_matrix() @ (0, 0, 1)
    np.testing.assert_allclose(up, (0, np.sqrt(0.5), np.sqrt(0.5)), atol=1e-12)


def test_the_protection_level_is_a_cylinder_of_radius_and_half_height_one():
    corners = barrel().reshape(-1, 3)
    np.testing.assert_allclose(np.hypot(corners[:, 0], corners[:, 1]), 1.0)
    assert (corners[:, 2].min(), corners[:, 2].max()) == (-1.0, 1.0)


def test_what_is_looked_back_upon_shares_no_node_with_now():
    now, then = MagicMock(), MagicMock()
    Aircraft(now, "/f", "uav1")
    Aircraft(then, "/f", "uav1", THEN)
    names, others = ({call.args[0] for call in api.method_calls} for api in (now, then))
    hidden = tuple(f"/f/{path}/" for path in OF_NOW)
    assert names
    assert all(name.startswith(hidden) for name in names)
    assert not any(name.startswith(hidden) for name in others)
