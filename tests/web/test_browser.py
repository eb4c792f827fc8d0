"""The page in headless Chromium: what is on it, and what every control, key and click does.

Skipped where Chromium or Playwright is missing.
"""

import math
import re

import numpy as np

from tests.web import browser, flight
from tests.web.page import (
    S,
    blue,
    canvas,
    choose,
    ink,
    is_blue,
    opened,
    picture,
    pixel,
    red,
    tab,
    until,
    viewer_of,
)
from web.panel.limits import OperatorLimits
from web.view import View

pytestmark = browser.NEEDED


def test_the_panel_tells_the_flight(page):
    page.get_by_text("14:13:59.9").wait_for()  # START_NS and 39.9 s, in UTC
    tab(page, "Sensors")
    for text in ("theo-north", "theo-south", "radar-west", "8.3%"):
        page.get_by_text(text).first.wait_for()
    tab(page, "Events")
    page.get_by_text("12 azimuths in a row refused").first.wait_for()
    choose(page, "show", "errors")
    page.get_by_text("none yet").wait_for()
    choose(page, "show", "all")
    tab(page, "Flight")
    page.get_by_text("even if one sensor lies").wait_for()


def test_the_tab_names_range_and_vehicle(page):
    assert until(lambda: page.title() == "demo · uav1")
    assert "svg" in page.locator("link[rel=icon]").get_attribute("href")


def test_old_data_are_called_old(page):
    page.get_by_text(re.compile(r"DATA \d+\.\d s OLD")).wait_for()


def test_the_position_is_told_as_an_instrument_has_to_point(page):
    tab(page, "Flight")
    choose(page, "position as", "radar-west")
    page.get_by_text("true azimuth", exact=True).wait_for()
    choose(page, "position as", "East North Up")


def test_a_limit_that_is_broken_alarms(page, view):
    tab(page, "Limits")
    page.get_by_label("height within m").fill("5")
    page.get_by_label("height within m").press("Enter")
    page.get_by_text("height holds within 6.4 m, 5 m is demanded").wait_for()
    view.limits = OperatorLimits(protection_v_m=9.0, silent_s=0.0)
    page.get_by_text("within all limits").wait_for()


def test_track_and_outliers_are_drawn_and_can_be_hidden(page):
    tab(page, "Show")
    assert until(lambda: red(page) > 100 and blue(page) > 400)
    for box, count in (("outliers", red), ("newest", blue)):
        shown = count(page)
        page.get_by_role("checkbox", name=box, exact=True).click()
        assert until(lambda count=count, shown=shown: count(page) < shown * 0.7), box
        hidden = count(page)  # not ``shown``: where drawing is slow the page draws coarser as time goes on
        page.get_by_role("checkbox", name=box, exact=True).click()
        assert until(lambda count=count, hidden=hidden: count(page) > hidden * 1.3), box


def test_the_track_takes_the_colour_of_a_quantity_with_its_scale(page):
    tab(page, "Show")
    assert until(lambda: blue(page) > 400)
    track = is_blue(picture(page))
    choose(page, "track colour", "speed")
    assert until(lambda: _painted(picture(page)[track]) > 0.5)
    page.locator(".gcs [style*=linear-gradient]").wait_for()
    choose(page, "track colour", "plain")
    assert until(lambda: blue(page) > track.sum() * 0.5)


def _painted(pixels: np.ndarray) -> float:
    """Share of (n, 3) pixels with a colour that is not the plain track's; the page and its grid are grey."""
    return float((~is_blue(pixels[None])[0] & (np.ptp(pixels, axis=1) > 40)).mean())


def test_a_clicked_outlier_tells_why(page, view):
    chosen = next(claim for claim in view.flight.outliers if claim.kind == "isolated")
    page.mouse.click(*pixel(page, view, chosen.position))
    page.get_by_text("too far from what everything else says").first.wait_for()
    page.get_by_text("the others then").wait_for()
    page.get_by_role("button", name="Close").click()
    assert until(lambda: not page.get_by_text("the others then").is_visible())


def test_a_click_on_the_track_seeks_there(page, view):
    places = view.flight.newest.view
    clear = [claim.position for claim in view.flight.outliers]
    at = max(range(0, len(places), 5), key=lambda k: _away(page, view, places[k], clear))
    page.mouse.click(*pixel(page, view, places["position_enu_m"][at]))
    assert until(lambda: abs(view.playback.now_ns - int(places["t_ns"][at])) < 2 * S)
    view.playback.seek(view.playback.start_ns + 40 * S)


def _away(page, view: View, row: np.void, others: list) -> float:
    here = np.array(pixel(page, view, row["position_enu_m"]))
    return min(float(np.linalg.norm(here - pixel(page, view, other))) for other in others)


def test_the_plots_change_with_what_is_chosen(page):
    for choice, title in (
        ("height and speed", "height above the origin, m"),
        ("sigma and protection", "sigma and protection level, m"),
        ("zero errors, clocks", "range zero, m"),
        ("residuals in σ", "radar-west"),
    ):
        choose(page, "Show", choice)
        page.locator(".u-title").filter(has_text=title).first.wait_for()
        assert (
            page.get_by_text("Value", exact=True).filter(visible=True).count() == 0
        )  # of a band, without a name
    choose(page, "Over", "whole flight")


def test_pause_steps_and_events(page, view, tape):
    tab(page, "Flight")
    page.get_by_role("button", name="pause").click()
    page.get_by_text("PAUSED").wait_for()
    assert not tape.playing
    here_ns = view.playback.now_ns
    page.get_by_role("button", name="‹ step").click()
    assert until(lambda: view.playback.now_ns == here_ns - S // 10)
    page.get_by_role("button", name="step ›").click()
    assert until(lambda: view.playback.now_ns == here_ns)
    page.get_by_role("button", name="« event").click()
    assert until(lambda: view.playback.now_ns == flight.START_NS + 30 * S)
    page.locator(".clock").filter(has_text="14:13:50.0").wait_for()
    view.playback.seek(flight.START_NS)
    page.get_by_role("button", name="event »").click()
    assert until(lambda: view.playback.now_ns == flight.START_NS + 30 * S)
    view.playback.seek(here_ns)
    page.get_by_role("button", name="play").click()
    page.get_by_role("button", name="pause").wait_for()
    assert view.playback.playing


def test_keys(page, view):
    time = view.playback
    page.evaluate("document.activeElement.blur()")  # keys typed into a field are text
    page.keyboard.press("Space")
    assert until(lambda: not time.playing)
    here_ns = time.now_ns
    for key, there_ns in (("j", here_ns - S // 10), ("l", here_ns)):
        page.keyboard.press(key)
        assert until(lambda there_ns=there_ns: time.now_ns == there_ns), key
    time.seek(flight.START_NS)
    for key, there_s in (("PageDown", 30), ("PageUp", 0)):
        page.keyboard.press(key)
        assert until(lambda there_s=there_s: time.now_ns == flight.START_NS + there_s * S), key
    time.seek(here_ns)
    page.keyboard.press("Space")
    assert until(lambda: time.playing)
    viewer = viewer_of(view)
    eyes = [(str(k + 1), f"from {one.name}") for k, one in enumerate(flight.SCENE.instruments)]
    for key, mode in (("f", "follow"), ("t", "top"), *eyes, ("o", "orbit")):
        page.keyboard.press(key)
        assert until(lambda mode=mode: viewer.camera.mode == mode), mode
    for shown in (True, False):
        page.keyboard.press("s")
        assert until(lambda shown=shown: ("sticks" not in viewer._hidden) == shown)


def test_at_the_end_play_begins_anew(page, view, tape):
    choose(page, "speed", "1×")
    tape.now_ns = tape.end_ns
    page.get_by_text("END", exact=True).wait_for()
    page.get_by_role("button", name="play").click()
    page.locator(".clock").filter(has_text=re.compile(r"14:13:2\d\.\d")).wait_for()
    assert view.playback.playing
    assert view.playback.now_ns < tape.start_ns + 10 * S
    tape.now_ns = tape.start_ns + 40 * S
    view.playback.seek(tape.now_ns)


def test_the_slider_seeks_by_arrow_keys_and_by_a_click(page, view):
    tab(page, "Flight")
    slider = page.locator("[role=slider]").first
    view.playback.seek(flight.START_NS + 40 * S)
    view.playback.pause()
    assert until(lambda: slider.get_attribute("aria-valuenow") == "40")
    slider.focus()
    for _ in range(3):
        slider.press("ArrowLeft")
    assert until(lambda: view.playback.now_ns == flight.START_NS + 39_700_000_000)
    box = page.locator(".mantine-Slider-trackContainer").first.bounding_box()
    page.mouse.click(box["x"] + box["width"] / 4, box["y"] + box["height"] / 2)
    assert until(lambda: abs(view.playback.now_ns - flight.START_NS - 15 * S) < 2 * S)
    page.locator(".clock").filter(has_text=re.compile(r"14:13:3[3-7]\.\d")).wait_for()
    view.playback.seek(flight.START_NS + 40 * S)
    view.playback.play()


def test_speed(page, tape):
    for name, speed in (("10×", 10.0), ("max", math.inf), ("0.1×", 0.1)):
        choose(page, "speed", name)
        assert until(lambda speed=speed: tape.speed == speed)


def test_dark_and_the_camera_change_the_picture(page):
    tab(page, "Show")
    assert until(lambda: picture(page)[:40, :40].min() > 200)
    page.get_by_role("checkbox", name="dark", exact=True).click()
    assert until(lambda: picture(page)[:40, :40].max() < 60)
    before = picture(page)
    choose(page, "camera", "top")
    assert until(lambda: (np.abs(picture(page) - before).max(axis=2) > 60).sum() > 2_000)
    choose(page, "camera", "orbit")


def test_reset_view_brings_the_camera_back(page, view):
    camera = viewer_of(view).camera
    box = canvas(page)
    page.get_by_role("button", name="Reset view").click()
    assert until(lambda: np.linalg.norm(camera.eye() - camera._placed.eye) < 1.0)
    there = camera.eye()
    page.mouse.move(box["x"] + box["width"] / 2, box["y"] + box["height"] / 2)
    page.mouse.wheel(0, 2_000)
    assert until(lambda: np.linalg.norm(camera.eye() - there) > 100.0)
    page.get_by_role("button", name="Reset view").click()
    assert until(lambda: np.linalg.norm(camera.eye() - there) < 1.0)


def test_a_live_flight_is_looked_back_upon_by_one_viewer(page):
    live = opened(None)
    other = page.context.browser.new_page(viewport=browser.SMALL)
    other.set_default_timeout(60_000)
    try:
        other.goto(live.url)
        other.get_by_text("14:13:59.9").wait_for()
        browser.settle(other)
        names_and_aircraft = ink(other)
        other.get_by_role("button", name="pause").click()
        other.get_by_role("button", name="« event").click()
        other.get_by_text(re.compile(r"BACK \d+ s")).wait_for()
        other.get_by_text("14:13:50.0").wait_for()  # the event at 30 s
        assert until(lambda: not np.any([frame.visible for frame in viewer_of(live)._ghost._now]))
        other.get_by_role("button", name="now", exact=True).click()
        other.get_by_text("14:13:59.9").wait_for()
        assert until(lambda: abs(ink(other) - names_and_aircraft) < 0.05 * names_and_aircraft)
    finally:
        other.close()
        live.close()


def test_clear_wipes_the_picture(page, view):
    assert until(lambda: red(page) > 0)
    view.clear()
    assert until(lambda: red(page) == 0)
    tab(page, "Flight")
    page.get_by_text("No data yet.").wait_for()


def test_a_dead_station_shows_without_its_help(page, view):
    def warning_px() -> int:
        return page.evaluate("document.querySelector('.lost')?.offsetHeight ?? 0")

    assert warning_px() == 0
    view.close()
    assert until(lambda: warning_px() > 10)
