"""What a click hits, and where an instrument has to look, against closed forms."""

import numpy as np

from tests.web.flight import SCENE
from web.memory.geometry import Rectangle, hit, look, off_ray, on_picture


def test_the_angle_to_a_ray_is_that_of_trigonometry():
    points = np.array([(10.0, 0, 0), (10.0, 10.0, 0), (-5.0, 0, 0)])
    np.testing.assert_allclose(off_ray((0, 0, 0), (2.0, 0, 0), points), [0.0, np.pi / 4, np.pi])


def test_a_click_hits_the_nearest_within_its_reach_or_nothing():
    points = np.array([(100.0, 2.0, 0), (100.0, 1.0, 0), (50.0, 30.0, 0)])
    assert hit((0, 0, 0), (1, 0, 0), points, 0.05) == 1
    assert hit((0, 0, 0), (1, 0, 0), points, 0.005) is None
    assert hit((0, 0, 0), (1, 0, 0), np.zeros((0, 3)), 0.1) is None


def test_looking_from_the_origin_is_plain_trigonometry():
    range_m, azimuth_deg, elevation_deg = look(SCENE, (0, 0, 0), (-300.0, 300.0, 100.0))
    assert np.isclose(range_m, np.sqrt(190_000.0))
    assert np.isclose(azimuth_deg, 315.0)
    assert np.isclose(elevation_deg, np.degrees(np.arctan2(100.0, np.hypot(300.0, 300.0))))


def test_ten_kilometres_away_up_leans_by_the_curve_of_the_earth():
    _, _, here = look(SCENE, (0, 0, 0), (0.0, 10_000.0, 0.0))
    _, _, there = look(SCENE, (0.0, 10_000.0, 0.0), (0, 0, 0))
    assert abs(here) < 1e-9
    assert np.isclose(there, -np.degrees(10_000.0 / 6_371_000.0), rtol=0.01)


def test_a_place_on_the_picture_is_where_similar_triangles_have_it():
    away = np.array([(0.0, 10.0, 0.0), (5.0, 10.0, 0.0), (0.0, 20.0, 10.0), (0.0, -1.0, 0.0)])
    axes = np.column_stack([(1.0, 0, 0), (0, 0, -1.0), (0, 1.0, 0)])  # to the north, upright
    seen = on_picture(away, axes, np.pi / 2, 2.0)
    np.testing.assert_allclose(seen[:3], [(0.5, 0.5), (0.625, 0.5), (0.5, 0.25)])
    assert np.isnan(seen[3]).all()


def test_a_rectangle_holds_what_is_inside_and_nothing_unseen():
    seen = np.array([(0.2, 0.3), (0.2, 0.9), (0.0, 0.3), (np.nan, np.nan)])
    assert Rectangle(0.1, 0.1, 0.5, 0.5).holds(seen).tolist() == [True, False, False, False]
