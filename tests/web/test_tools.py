"""The page's tools in headless Chromium: another course, outliers in a box, marks of time."""

import re

from tests.web import browser
from tests.web.page import ink, tab, until

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
