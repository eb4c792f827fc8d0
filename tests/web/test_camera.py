"""Who is moved by the camera rules, and who is left alone."""

from contextlib import nullcontext
from types import SimpleNamespace

import numpy as np
import pytest

from web.camera import Cameras


def client(number: int) -> SimpleNamespace:
    camera = SimpleNamespace(position=np.zeros(3), look_at=np.zeros(3))
    return SimpleNamespace(client_id=number, camera=camera, atomic=nullcontext)


@pytest.fixture
def two():
    return [client(0), client(1)]


@pytest.fixture
def cameras(two):
    world = SimpleNamespace(position=np.zeros(3))
    server = SimpleNamespace(
        scene=SimpleNamespace(add_frame=lambda *_, **__: world),
        get_clients=lambda: dict(enumerate(two)),
        initial_camera=SimpleNamespace(),
    )
    cameras = Cameras(server)
    for each in two:
        cameras.look(each)
    return cameras


def seen_deg(viewer: SimpleNamespace, point) -> float:
    """Angle between a viewer's axis and a point."""
    axis = viewer.camera.look_at - viewer.camera.position
    ray = np.asarray(point) - viewer.camera.position
    return np.degrees(np.arccos(axis @ ray / np.linalg.norm(axis) / np.linalg.norm(ray)))


def test_the_sight_widens_with_the_flight_but_not_for_a_hand_on_the_mouse(cameras, two):
    untouched, moved = two
    moved.camera.position = chosen = np.array([1.0, 2000.0, 50.0])
    for corner in ((3000.0, 0.0, 0.0), (0.0, 2000.0, 400.0)):
        cameras.include(corner)
        cameras.update(np.array(corner))
    for corner in ((0.0, 0.0, 0.0), (3000.0, 0.0, 0.0), (0.0, 2000.0, 400.0)):
        assert seen_deg(untouched, corner) < 40
    np.testing.assert_array_equal(moved.camera.position, chosen)


def test_following_moves_the_world_and_back(cameras, two):
    aircraft = np.array([500.0, -200.0, 120.0])
    cameras.set_follow(follow=True)
    cameras.update(aircraft)
    distance_m = cameras.distance(aircraft)
    cameras.update(aircraft + 1000.0)
    assert np.isclose(cameras.distance(aircraft + 1000.0), distance_m)
    np.testing.assert_array_equal(two[0].camera.look_at, 0.0)
    cameras.set_follow(follow=False)
    cameras.update(aircraft)
    assert np.isclose(cameras.distance(aircraft), np.linalg.norm(two[0].camera.position - aircraft))
