"""Several vehicles on one page in headless Chromium: the worst first, and each viewer looks at his own."""

import math

import msgspec
import numpy as np
import pytest

from gcs.contract.messages import State
from tests.web import browser, flight
from tests.web.page import blue, choose, opened, tab, until
from web.panel.limits import OperatorLimits

pytestmark = browser.NEEDED


@pytest.fixture(scope="module")
def view():
    view = opened(None)
    view.limits = OperatorLimits(silent_s=0.0, refused_share=0.0)
    view.expect(("uav1", "uav2", "uav3"))
    view.add(msgspec.structs.replace(flight.SCENE, vehicle="uav2", instruments=flight.SCENE.instruments[:1]))
    for message, source in flight.messages(20.0):
        if isinstance(message, State):
            east, north, up = message.position_enu_m
            message = msgspec.structs.replace(message, position_enu_m=(east, north, up + 500.0), quality=-1)
        view.put(message, source, "uav2")
    view.put(next(flight.messages(1.0))[0], "", "uav3")  # nobody is there to show it yet
    yield view
    view.close()


def names(page) -> list[str]:
    rows = page.locator(".gcs tr").filter(has=page.locator("td"))
    firsts = (row.locator("td").first.inner_text() for row in rows.all()[:3])
    return [text.lstrip("▸ ") for text in firsts]


def test_a_row_each_and_details_of_the_one_that_is_looked_at(page, view):
    page.get_by_text("NO STATION").wait_for()
    assert set(names(page)) == {"uav1", "uav2", "uav3"}
    page.get_by_text("uav3: its station has not been heard").wait_for()
    page.get_by_text("▸ uav1").wait_for()
    tab(page, "Sensors")
    assert page.get_by_text("radar-west").first.is_visible()


def test_another_one_is_looked_at_by_choice_and_the_first_again(page, view):
    client = next(iter(view._viewers))
    assert until(lambda: blue(page) > 300)
    choose(page, "vehicle", "uav2")
    assert until(lambda: view._viewers[client].vehicle.name == "uav2")
    page.get_by_text("▸ uav2").wait_for()
    assert until(lambda: page.title() == "demo · uav2")
    page.get_by_text("14:13:39.9").wait_for()  # 20 s flown, the other 40
    assert until(lambda: blue(page) > 300)
    camera = view._viewers[client].camera
    assert until(lambda: np.linalg.norm(camera.eye()) > 0.0)
    tab(page, "Show")
    page.get_by_role("checkbox", name="newest", exact=True).click()
    assert until(lambda: blue(page) < 150)  # neither this one's track nor that of the other
    page.get_by_role("checkbox", name="newest", exact=True).click()
    choose(page, "vehicle", "uav1")
    page.get_by_text("14:13:59.9").wait_for()
    assert until(lambda: blue(page) > 300)
    page.keyboard.press("t")
    assert until(lambda: view._viewers[client].camera.mode == "top")


def test_a_new_page_shows_the_worst_one(page, view, monkeypatch):
    monkeypatch.setattr(view.seen[0].flight, "arrived_s", math.inf)  # is as new as can be; the other is old
    other = page.context.browser.new_page(viewport=browser.SMALL)
    other.set_default_timeout(60_000)
    try:
        other.goto(view.url)
        other.get_by_text("▸ uav2").wait_for()
    finally:
        other.close()


def test_the_choice_is_one_viewer_s_own(page, view):
    other = page.context.browser.new_page(viewport=browser.SMALL)
    other.set_default_timeout(60_000)
    try:
        other.goto(view.url)
        other.get_by_text("▸ uav1").wait_for()
        choose(other, "vehicle", "uav2")
        other.get_by_text("▸ uav2").wait_for()
        assert page.get_by_text("▸ uav1").is_visible()
    finally:
        other.close()
