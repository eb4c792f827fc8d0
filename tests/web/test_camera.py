"""Who is moved by the camera rules, and who is left alone."""

from contextlib import nullcontext
from types import SimpleNamespace

import numpy as np
import pytest
from viser.transforms import SO3

from tests.web.flight import SCENE
from web.camera import ABOVE, AWAY, FOLLOW, ROOM, TOP, Camera, corners, fit, modes

NONE = np.zeros(3)


def viewer() -> tuple[Camera, SimpleNamespace]:
    handle = SimpleNamespace(
        position=np.zeros(3), look_at=np.zeros(3), fov=0.9, image_height=900, image_width=900
    )
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


@pytest.mark.parametrize("away", [AWAY, ABOVE])
@pytest.mark.parametrize("aspect", [0.6, 0.77, 1.0, 1.8])
def test_all_is_inside_the_picture_and_as_large_as_can_be(aspect, away):
    points = corners(np.array([-1000.0, -640.0, 0.0]), np.array([950.0, 1900.0, 400.0]))
    eye, at = fit(points, away, 0.9, aspect)
    view = SO3.from_matrix(looking(eye, at)).inverse()
    x, y, z = np.array([view.apply(point - eye) for point in points]).T
    assert np.all(z > 0)
    wide, high = np.abs(x / z).max() / (aspect * np.tan(0.45)), np.abs(y / z).max() / np.tan(0.45)
    assert max(wide, high) == pytest.approx(ROOM)
    for across, much in ((x, wide), (y, high)):  # what there is, is in the middle
        if much == pytest.approx(ROOM):
            assert (across / z).min() == pytest.approx(-(across / z).max())


def looking(eye: np.ndarray, at: np.ndarray) -> np.ndarray:
    """(3, 3) right, down, ahead, by columns."""
    ahead = (at - eye) / np.linalg.norm(at - eye)
    right = np.cross(ahead, (0, 0, 1))
    right /= np.linalg.norm(right)
    return np.column_stack([right, np.cross(ahead, right), ahead])


def test_a_picture_that_became_narrower_is_looked_at_from_farther():
    (camera, untouched), (other, moved) = viewer(), viewer()
    low, high = np.array([-900.0, -600.0, 0.0]), np.array([900.0, 600.0, 300.0])
    for each in (camera, other):
        each.update(None, low, high)
    before = untouched.position
    moved.position = chosen = np.array([1.0, 2000.0, 50.0])
    for each, handle in ((camera, untouched), (other, moved)):
        handle.image_width = 500
        each.update(None, low, high)
    assert np.linalg.norm(untouched.position) > 1.2 * np.linalg.norm(before)
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


def test_what_it_sees_in_pixels():
    camera, handle = viewer()
    handle.position, handle.wxyz = NONE, SO3.identity().wxyz  # looks along z, x to the right
    reach, lens = np.tan(handle.fov / 2), camera.lens()
    places = np.array([[0, 0, 1], [reach, 0, 1], [0, -reach, 1], [0, 0, -1]])
    np.testing.assert_allclose(
        lens.pixels(places), [(450, 450), (900, 450), (450, 0), (np.nan, np.nan)], atol=1e-9
    )
    assert lens.size_px == (900, 900)
