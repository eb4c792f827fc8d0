"""Who is moved by the camera rules, and who is left alone."""

from contextlib import nullcontext
from types import SimpleNamespace

import numpy as np
import pytest

from tests.web.flight import SCENE
from web.camera import FOLLOW, TOP, Camera, modes

NONE = np.zeros(3)


def viewer() -> tuple[Camera, SimpleNamespace]:
    handle = SimpleNamespace(position=np.zeros(3), look_at=np.zeros(3), fov=0.9, image_height=900)
    world = SimpleNamespace(position=np.zeros(3))
    client = SimpleNamespace(
        camera=handle, atomic=nullcontext, scene=SimpleNamespace(add_frame=lambda *_, **__: world)
    )
    camera = Camera(client, SCENE)
    camera.look()
    return camera, handle


def seen_deg(handle: SimpleNamespace, point) -> float:
    """Angle between a viewer's axis and a point."""
    axis = handle.look_at - handle.position
    ray = np.asarray(point) - handle.position
    return np.degrees(np.arctan2(np.linalg.norm(np.cross(axis, ray)), axis @ ray))


def test_the_sight_widens_with_the_flight_but_not_for_a_hand_on_the_mouse():
    (camera, untouched), (other, moved) = viewer(), viewer()
    moved.position = chosen = np.array([1.0, 2000.0, 50.0])
    low, high = np.array([0.0, 0.0, 0.0]), np.array([3000.0, 2000.0, 400.0])
    for each in (camera, other):
        each.update(None, low, high)
    for corner in (low, high, (0.0, 2000.0, 400.0)):
        assert seen_deg(untouched, corner) < 40
    np.testing.assert_array_equal(moved.position, chosen)


def test_following_moves_this_viewer_s_world_and_back():
    camera, handle = viewer()
    aircraft = np.array([500.0, -200.0, 120.0])
    camera.set_mode(FOLLOW)
    camera.update(aircraft, NONE, NONE)
    distance_m = np.linalg.norm(camera.eye() - aircraft)
    camera.update(aircraft + 1000.0, NONE, NONE)
    assert np.isclose(np.linalg.norm(camera.eye() - aircraft - 1000.0), distance_m)
    np.testing.assert_array_equal(handle.look_at, 0.0)
    camera.set_mode("orbit")
    camera.update(aircraft, NONE, NONE)
    np.testing.assert_array_equal(camera.offset, 0.0)


def test_from_an_instrument_the_aircraft_is_in_the_middle():
    camera, handle = viewer()
    camera.set_mode("from theo-north")
    for aircraft in (np.array([500.0, -200.0, 120.0]), np.array([0.0, 900.0, 300.0])):
        camera.update(aircraft, NONE, NONE)
        assert seen_deg(handle, aircraft) < 0.1
    stand = SCENE.instruments[0].position_enu_m
    assert np.linalg.norm(handle.position - np.array(stand)) < 10.0
    assert handle.fov < 0.5
    camera.set_mode(TOP)
    assert handle.fov == pytest.approx(0.9)


def test_from_above_is_straight_down():
    camera, handle = viewer()
    camera.update(None, np.array([0.0, 0, 0]), np.array([1000.0, 1000.0, 100.0]))
    camera.set_mode(TOP)
    assert seen_deg(handle, (500.0, 500.0, -1e6)) < 2.0


def test_every_instrument_is_a_way_to_look():
    assert modes(SCENE) == ["orbit", "follow", "top", "from theo-north", "from theo-south", "from radar-west"]
