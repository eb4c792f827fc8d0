"""The page in headless Chromium: what is on it, and what its buttons do.

Skipped where Chromium or Playwright is missing.
"""

import importlib.util
import math
import re
import socket
import time
from pathlib import Path

import imageio.v3 as imageio
import numpy as np
import pytest

from tests.web import browser, flight
from web.view import View

MISSING = [
    name
    for name, found in (
        ("chromium", Path(browser.CHROMIUM).exists()),
        ("playwright", importlib.util.find_spec("playwright")),
    )
    if not found
]
pytestmark = [pytest.mark.browser, pytest.mark.skipif(bool(MISSING), reason=f"needs {' and '.join(MISSING)}")]


class Tape:
    """A replay that only remembers what it was told."""

    def __init__(self):
        self.start_ns, self.end_ns = flight.START_NS, flight.START_NS + 60_000_000_000
        self.now_ns = flight.START_NS + 40_000_000_000
        self.playing, self.speed = True, 1.0

    def play(self) -> None:
        self.playing = True

    def pause(self) -> None:
        self.playing = False

    def seek(self, t_ns: int) -> None:
        self.now_ns = t_ns

    def set_speed(self, speed: float) -> None:
        self.speed = speed


@pytest.fixture(scope="module")
def tape() -> Tape:
    return Tape()


@pytest.fixture(scope="module")
def view(tape):
    with socket.socket() as probe:
        probe.bind(("127.0.0.1", 0))
        port = probe.getsockname()[1]
    view = View(flight.SCENE, port=port, playback=tape)
    for message, source in flight.messages(40.0):
        view.put(message, source)
    yield view
    view.close()


@pytest.fixture(scope="module")
def page(view):
    with browser.open_page(view.url, browser.SMALL) as page:
        yield page


def until(condition, timeout_s: float = 40.0) -> bool:
    end_s = time.monotonic() + timeout_s
    while not (met := condition()) and time.monotonic() < end_s:
        time.sleep(0.1)
    return bool(met)


def picture(page) -> np.ndarray:
    """(h, w, 3) int, the 3-D part of the page."""
    pixels = imageio.imread(page.screenshot())[..., :3].astype(int)
    return pixels[:, : pixels.shape[1] * 3 // 5]


def red(page) -> int:
    """How many pixels have the outliers' colour."""
    r, g, b = np.moveaxis(picture(page), -1, 0)
    return int(((r > 190) & (g < 130) & (b < 110) & (r - g > 90)).sum())


def blue(page) -> int:
    """How many pixels have the filtered trajectory's colour."""
    r, _, b = np.moveaxis(picture(page), -1, 0)
    return int(((b > 170) & (r < 110) & (b - r > 100)).sum())


def test_the_panel_tells_the_flight(page):
    for text in ("uav1", "theo-north", "theo-south", "radar-west", "8.3%", "12 azimuths in a row refused"):
        page.get_by_text(text).first.wait_for()
    page.get_by_text("14:13:59.9").wait_for()  # START_NS and 39.9 s, in UTC


def test_the_tab_names_range_and_vehicle(page):
    assert until(lambda: page.title() == "demo · uav1")
    assert "svg" in page.locator("link[rel=icon]").get_attribute("href")


def test_old_data_are_called_old(page):
    page.get_by_text(re.compile(r"DATA \d+\.\d s OLD")).wait_for()


def test_trajectory_and_outliers_are_drawn_and_can_be_hidden(page):
    assert until(lambda: red(page) > 200 and blue(page) > 400)
    for box, count in (("outliers", red), ("filtered", blue)):
        before = count(page)
        page.get_by_role("checkbox", name=box).click()
        assert until(lambda count=count, before=before: count(page) < before / 4), box
        page.get_by_role("checkbox", name=box).click()
        assert until(lambda count=count, before=before: count(page) > before / 2), box


def test_pause_and_play(page, tape):
    page.get_by_role("button", name="Pause").click()
    page.get_by_text("PAUSED").wait_for()
    assert not tape.playing
    page.get_by_role("button", name="Play").click()
    page.get_by_role("button", name="Pause").wait_for()
    assert tape.playing


def test_at_the_end_play_begins_anew(page, tape):
    here_ns, tape.now_ns = tape.now_ns, tape.end_ns
    page.get_by_text("END", exact=True).wait_for()
    page.get_by_role("button", name="Play").click()
    assert until(lambda: tape.now_ns == tape.start_ns)
    assert tape.playing
    tape.now_ns = here_ns


def test_arrow_keys_seek(page, tape):
    slider = page.locator("[role=slider]").first
    assert until(lambda: slider.get_attribute("aria-valuenow") == "40")
    slider.focus()
    for _ in range(3):
        slider.press("ArrowLeft")
    assert until(lambda: tape.now_ns == tape.start_ns + 37_000_000_000)


def test_speed(page, tape):
    for name, speed in (("10×", 10.0), ("max", math.inf)):
        page.get_by_role("combobox", name="Speed").or_(page.get_by_label("Speed")).first.click()
        page.get_by_role("option", name=name, exact=True).click()
        assert until(lambda speed=speed: tape.speed == speed)


def test_dark_and_follow_change_the_picture(page, tmp_path):
    page.screenshot(path=tmp_path / "light.png")
    assert picture(page)[:60, :60].min() > 200
    page.get_by_role("checkbox", name="dark", exact=True).click()
    assert until(lambda: picture(page)[:60, :60].max() < 60)
    page.screenshot(path=tmp_path / "dark.png")
    before = picture(page)
    page.get_by_role("checkbox", name="follow aircraft").click()
    assert until(lambda: (np.abs(picture(page) - before).max(axis=2) > 60).sum() > 2_000)


def test_reset_view_brings_the_camera_back(page):
    def moved_px() -> int:
        return int((np.abs(picture(page) - before).max(axis=2) > 60).sum())

    before = picture(page)
    page.mouse.move(300, 300)
    page.mouse.wheel(0, 2_000)
    assert until(lambda: moved_px() > 2_000)
    page.get_by_role("button", name="Reset view").click()
    assert until(lambda: moved_px() < 500)


def test_clear_wipes_the_trails(page, view):
    assert red(page) > 0
    view.clear()
    assert until(lambda: red(page) == 0)


def test_a_dead_station_shows_without_its_help(page, view):
    def warning_px() -> int:
        return page.evaluate("document.querySelector('.lost')?.offsetHeight ?? 0")

    assert warning_px() == 0
    view.close()
    assert until(lambda: warning_px() > 10)
