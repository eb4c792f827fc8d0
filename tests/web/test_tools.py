"""The page's tools in headless Chromium: another course, outliers in a box, marks of time."""

import re
from functools import partial

import numpy as np

from tests.web import browser
from tests.web.page import S, canvas, choose, ink, pixel, tab, until, viewer_of
from web.camera import modes
from web.panel.limits import OperatorLimits
from web.panel.place import forms
from web.plots.curves import CHOICES
from web.plots.dock import SPANS_S
from web.scene.paint import UNITS
from web.scene.picture import LAYERS
from web.viewer import NAMES

pytestmark = browser.NEEDED


def test_another_course_lies_beside_the_flight_and_is_told_apart(page):
    tab(page, "Flight")
    page.get_by_text(re.compile(r"(39|4[01])\.\d\d m above")).wait_for()  # and the state's own noise
    tab(page, "Show")
    page.get_by_text("truth.csv").filter(visible=True).wait_for()
    assert until(lambda: ink(page) > 800)
    page.get_by_role("checkbox", name="other", exact=True).click()
    assert until(lambda: ink(page) < 800)
    page.get_by_role("checkbox", name="other", exact=True).click()


def drag(page, start: tuple[float, float], end: tuple[float, float]) -> None:
    page.mouse.move(*start)
    page.mouse.down()
    page.mouse.move(*end, steps=8)
    page.mouse.up()


def test_outliers_in_a_box_are_counted_by_sensor_and_channel(page, view):
    patch = [claim for claim in view.flight.outliers if claim.kind == "patch"]
    seen = np.array([pixel(page, view, claim.position) for claim in patch])
    camera = viewer_of(view).camera
    eye = camera.eye()
    page.get_by_role("button", name="Outliers in a box").click()
    page.get_by_text("Drag a box").wait_for()
    drag(page, tuple(seen.min(axis=0) - 6), tuple(seen.max(axis=0) + 6))
    page.get_by_text(re.compile(r"of \d+ measurements there")).wait_for()
    row = page.get_by_role("row").filter(has_text="theo-south").filter(has_text="range").last
    values = row.get_by_role("cell").all_inner_texts()
    assert int(values[2]) >= len(patch)
    assert values[5].endswith(" m")
    np.testing.assert_allclose(camera.eye(), eye)
    page.get_by_role("button", name="Close").click()
    page.get_by_role("button", name="Outliers in a box").wait_for()


def test_the_key_begins_a_box_and_leaves_it(page, view):
    boxing = viewer_of(view)._boxing
    page.evaluate("document.activeElement.blur()")
    for waiting in (True, False):
        page.keyboard.press("b")
        assert until(lambda waiting=waiting: boxing.waiting == waiting)
    box = canvas(page)
    eye = viewer_of(view).camera.eye()
    middle = box["x"] + box["width"] / 2, box["y"] + box["height"] / 2

    def turned() -> bool:
        drag(page, middle, (middle[0] + 80, middle[1]))
        return np.abs(viewer_of(view).camera.eye() - eye).max() > 10.0

    assert until(turned)
    tab(page, "Show")
    page.get_by_role("button", name="Reset view").click()


def test_a_patch_is_marked_on_the_slider_and_the_event_keys_go_there(page, view, tape):
    tab(page, "Flight")
    page.locator(".mantine-Slider-markLabel").filter(has_text="■").wait_for()
    page.evaluate("document.activeElement.blur()")
    page.keyboard.press("PageUp")
    patch_ns = next(t_ns for t_ns, what in view.flight.marks.items() if what == "patch")
    assert until(lambda: abs(view.playback.now_ns - patch_ns) < S)
    slider = viewer_of(view)._player._slider
    sent = slider._marks
    view.playback.seek(tape.start_ns + 40 * S)
    assert until(lambda: page.locator("[role=slider]").first.get_attribute("aria-valuenow") == "40")
    assert slider._marks is sent


def test_a_limit_that_breaks_is_heard_once_the_bell_is_on(page, view):
    page.evaluate(
        """() => { window.rung = 0; const real = window.AudioContext;
        window.AudioContext = function () { window.rung += 1; return new real(); } }"""
    )
    view.limits = OperatorLimits(silent_s=0.0, refused_share=0.0)
    tab(page, "Limits")
    page.get_by_text("no limit for the position is set").wait_for()
    page.get_by_role("checkbox", name="sound when a limit breaks").click()
    view.limits = view.limits._replace(protection_v_m=5.0)
    assert until(lambda: page.evaluate("window.rung") == 1)
    page.get_by_text("height holds within 6.4 m, 5 m is demanded").wait_for()
    assert page.evaluate("window.rung") == 1
    view.limits = OperatorLimits()


def test_a_control_that_fails_is_logged(page, view, caplog, monkeypatch):
    def broken(*_):
        raise ValueError("cannot happen")

    monkeypatch.setattr(viewer_of(view)._dock, "tell", broken)
    monkeypatch.setattr(viewer_of(view)._boxing, "press", broken)
    page.get_by_role("button", name="Outliers in a box").click()
    assert until(lambda: "view failed: ValueError: cannot happen" in caplog.text)


def test_every_box_shows_and_hides_its_layer(page, view):
    tab(page, "Show")
    viewer = viewer_of(view)
    boxes = viewer._boxes
    assert {*boxes} == {*LAYERS} - {"site"}  # that one has a page of its own
    for name in boxes:
        before = name not in viewer._hidden
        for shown in (not before, before):
            page.get_by_role("checkbox", name=NAMES.get(name, name), exact=True).click()
            assert until(lambda name=name, shown=shown: (name not in viewer._hidden) == shown), name
            there = partial(viewer._layers.get, name)  # drawn anew now and then
            assert until(lambda there=there, shown=shown: getattr(there(), "visible", False) == shown), name


def test_every_camera_is_chosen(page, view):
    tab(page, "Show")
    for mode in (*modes(view.flight.scene)[1:], "orbit"):
        choose(page, "camera", mode)
        assert until(lambda mode=mode: viewer_of(view).camera.mode == mode), mode


def test_every_colour_of_the_track_is_chosen(page, view):
    tab(page, "Show")
    for choice in (*UNITS, "plain"):
        choose(page, "track colour", choice)
        assert until(lambda choice=choice: view.picture.paint == choice), choice


def test_every_form_of_the_position_is_chosen(page, view):
    tab(page, "Flight")
    local, geodetic, *names = forms(view.flight.scene)
    for form, told in ((geodetic, "latitude"), *((name, "true azimuth") for name in names), (local, "East")):
        choose(page, "position as", form)
        page.locator(".copy").filter(has_text=told).first.wait_for()


def test_every_plot_and_span_is_chosen(page, view):
    dock = viewer_of(view)._dock
    for label, options, handle in (("Show", CHOICES, dock._choice), ("Over", tuple(SPANS_S), dock._span)):
        for option in (*options[1:], options[0]):
            choose(page, label, option)
            assert until(lambda option=option, handle=handle: handle.value == option), option


def test_every_level_of_events_is_chosen(page):
    tab(page, "Events")
    for level, told in (
        ("errors", "none yet"),
        ("warnings", "12 azimuths in a row"),
        ("all", "recording started"),
    ):
        choose(page, "show", level)
        page.get_by_text(told).filter(visible=True).first.wait_for()


def test_every_limit_is_set_by_hand_and_shown_to_all(page, view):
    tab(page, "Limits")
    for label, name, value in (
        ("position within m", "protection_h_m", 2.5),
        ("height within m", "protection_v_m", 7.5),
        ("refused share", "refused_share", 0.35),
        ("silent for s", "silent_s", 4.0),
    ):
        page.get_by_label(label).fill(str(value))
        page.get_by_label(label).press("Enter")
        assert until(lambda name=name, value=value: getattr(view.limits, name) == value), name
    page.get_by_text("position holds within 3.2 m, 2.5 m is demanded").wait_for()
    view.limits = OperatorLimits()
    assert until(lambda: page.get_by_label("silent for s").input_value() == "2")


def test_a_time_that_is_typed_is_gone_to(page, view):
    tab(page, "Flight")
    seconds = page.locator(".mantine-NumberInput-input").filter(visible=True).first
    seconds.fill("12.5")
    seconds.press("Enter")
    assert until(lambda: 12 * S <= view.playback.now_ns - view.playback.start_ns < 16 * S)
    view.playback.seek(view.playback.start_ns + 40 * S)
