"""Six questions of an operator, each answered from the page in three actions at most; the guide has them."""

import re
from collections.abc import Callable, Iterator
from contextlib import contextmanager

import msgspec
import pytest

from gcs.contract.messages import State
from tests.ports import free_port
from tests.web import browser, flight
from tests.web.page import pixel, until
from web.panel.limits import OperatorLimits
from web.view import View

pytestmark = browser.NEEDED
MOST = 3


@pytest.fixture(scope="module")
def view() -> Iterator[View]:
    """A live flight of 31 s: theo-south has been off for a second."""
    view = View(flight.SCENE, port=free_port())
    view.limits = OperatorLimits(silent_s=0.0, refused_share=0.0)
    for message, source in flight.messages(31.0):
        if isinstance(message, State):
            message = msgspec.structs.replace(message, protection_h_m=3.2, protection_v_m=6.4)
        view.put(message, source)
    yield view
    view.close()


@pytest.fixture(scope="module")
def page(view) -> Iterator:
    with browser.open_page(view.url, browser.SMALL) as page:
        assert until(lambda: view.flight.span_ns[1] > 0)
        yield page


class Asked:
    """Counts what an operator does."""

    def __init__(self):
        self.actions = 0

    def do(self, act: Callable, *given) -> None:
        self.actions += 1
        act(*given)


@contextmanager
def question(page) -> Iterator[Asked]:
    page.get_by_role("tab", name="Flight", exact=True).click()  # where the page stands at first
    asked = Asked()
    yield asked
    assert asked.actions <= MOST


def test_which_instrument_is_lying_now_since_when_and_by_how_much(page):
    with question(page):
        bar = page.locator(".bar").filter(has_text="theo-south range off by")
        bar.filter(has_text=re.compile(r"off by \+86 m \(57 σ\) since 14:13:50\.0")).wait_for()


def test_can_i_trust_this_height(page):
    with question(page):
        page.get_by_text(re.compile("height within 6.4 m, even if one sensor lies")).wait_for()


def test_why_was_this_shot_refused(page, view):
    with question(page) as asked:
        shot = next(claim for claim in view.flight.outliers if claim.kind == "isolated")
        asked.do(page.mouse.click, *pixel(page, view, shot.position))
        page.get_by_text("too far from what everything else says").first.wait_for()
        page.get_by_text("the others then").wait_for()


def test_is_the_radar_late(page):
    with question(page) as asked:
        asked.do(page.get_by_role("tab", name="Sensors", exact=True).click)
        page.get_by_text("delay ms").wait_for()
        row = page.get_by_role("row").filter(has_text="radar-west").filter(has_text="ok")
        assert row.get_by_role("cell").all_inner_texts()[4] == "120"


def test_where_do_i_point_the_tracker_that_lost_it(page):
    with question(page) as asked:
        asked.do(
            page.get_by_role("combobox", name="position as").or_(page.get_by_label("position as")).first.click
        )
        asked.do(page.get_by_role("option", name="theo-south", exact=True).click)
        page.get_by_text("true azimuth", exact=True).wait_for()
        line = page.locator(".copy").filter(has_text="azimuth").first
        asked.do(line.click)
        assert "azimuth" in page.evaluate("getSelection().toString()")


def test_may_i_go_on_with_the_flight(page, view):
    with question(page) as asked:
        asked.do(page.get_by_role("tab", name="Limits", exact=True).click)
        asked.do(page.get_by_label("height within m").fill, "9")
        asked.do(page.get_by_label("height within m").press, "Enter")
        assert until(lambda: view.limits.protection_v_m == 9.0)
        page.get_by_text("within all limits").or_(page.locator(".bar").first).first.wait_for()
    view.limits = view.limits._replace(protection_v_m=5.0)
    with question(page):
        page.get_by_text("height holds within 6.4 m, 5 m is demanded").wait_for()
