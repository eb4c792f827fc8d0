"""One page for the tests of a file: a replay, with another course beside it."""

from collections.abc import Iterator

import pytest

from tests.web import browser
from tests.web.page import Tape, opened, other
from web.view import View


@pytest.fixture(scope="module")
def tape() -> Tape:
    return Tape()


@pytest.fixture(scope="module")
def view(tape: Tape) -> Iterator[View]:
    view = opened(tape, other())
    yield view
    view.close()


@pytest.fixture(scope="module")
def page(view: View) -> Iterator:
    with browser.open_page(view.url, browser.SMALL) as page:
        yield page
