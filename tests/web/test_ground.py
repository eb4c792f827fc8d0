"""The user's picture of the ground, on the page in headless Chromium."""

import numpy as np
import pytest

from gcs.contract.frames import Frame
from tests.ports import free_port
from tests.web import browser, flight
from tests.web.page import canvas, picture, pixel, tab, until
from web.memory.site import GroundPicture
from web.view import View

pytestmark = browser.NEEDED
PLACE_M = np.array([240.0, 330.0, 0.0])  # of what is marked, station ENU
SIDE, HALF_DEG = 400, 0.012


@pytest.fixture(scope="module")
def view():
    """Blue ground of two kilometres with a cyan mark."""
    scene = flight.SCENE
    frame = Frame(scene.origin_lat_deg, scene.origin_lon_deg, scene.origin_alt_m)
    step = 2 * HALF_DEG / SIDE
    west, north = scene.origin_lon_deg - HALF_DEG, scene.origin_lat_deg + HALF_DEG
    place = np.array([(step, 0.0, west), (0.0, -step, north)])
    lat_deg, lon_deg, _ = frame.to_geodetic(PLACE_M)
    pixels = np.full((SIDE, SIDE, 3), (30, 60, 160), np.uint8)
    row, column = round((north - float(lat_deg)) / step), round((float(lon_deg) - west) / step)
    pixels[row - 9 : row + 10, column - 9 : column + 10] = (20, 230, 250)
    view = View(scene, port=free_port(), ground=GroundPicture(pixels, place))
    yield view
    view.close()


@pytest.fixture(scope="module")
def page(view):
    with browser.open_page(view.url, browser.SMALL) as page:
        yield page


def cyan(page) -> np.ndarray:
    """(n, 2) across and down of the page's pixels that have the mark's colour."""
    r, g, b = np.moveaxis(picture(page), -1, 0)
    rows, columns = np.nonzero((r < 90) & (g > 150) & (b > 180))
    box = canvas(page)
    return np.column_stack([columns + box["x"], rows + box["y"]])


def test_a_place_on_the_ground_is_seen_where_it_is(page, view):
    page.keyboard.press("t")
    page.get_by_role("tab", name="Show", exact=True).click()
    assert until(lambda: len(cyan(page)) > 20)
    page.wait_for_timeout(1000)
    seen = cyan(page).mean(axis=0)
    np.testing.assert_allclose(seen, pixel(page, view, PLACE_M), atol=4.0)


def test_it_is_a_layer_of_its_own(page):
    tab(page, "Show")
    for shown in (False, True):
        page.get_by_role("checkbox", name="ground picture", exact=True).click()
        assert until(lambda shown=shown: (len(cyan(page)) > 20) == shown)
