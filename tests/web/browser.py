"""A headless Chromium that can draw: for the tests of the view and for the picture in the README.

python tests/web/browser.py http://127.0.0.1:8080 docs/view.png [--dark]
"""

import importlib.util
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import imageio.v3 as imageio
import numpy as np
import pytest

CHROMIUM = "/usr/bin/chromium"
ARGS = [
    "--no-sandbox",
    "--use-gl=angle",
    "--use-angle=swiftshader",
    "--enable-unsafe-swiftshader",
    "--disable-background-networking",
    "--disable-component-update",
    "--disable-sync",
    "--no-first-run",
]
MISSING = [
    name
    for name, found in (
        ("chromium", Path(CHROMIUM).exists()),
        ("playwright", importlib.util.find_spec("playwright")),
    )
    if not found
]
NEEDED = [pytest.mark.browser, pytest.mark.skipif(bool(MISSING), reason=f"needs {' and '.join(MISSING)}")]
SETTLE_TRIES, SETTLED = 12, 0.5  # looks, and grey levels a pixel may still change by
SIZE = {"width": 1400, "height": 900}
SMALL = {
    "width": 1280,
    "height": 640,
}  # two thirds of the pixels, for what is rendered without a graphics card


@contextmanager
def open_page(url: str, size: dict[str, int] = SIZE) -> Iterator:
    """A Playwright page on the view, once its panel is there."""
    from playwright.sync_api import sync_playwright

    with sync_playwright() as playwright:
        browser = playwright.chromium.launch(executable_path=CHROMIUM, args=ARGS)
        page = browser.new_page(viewport=size)
        page.set_default_timeout(60_000)
        page.goto(url)
        page.get_by_text("Sensors").first.wait_for()
        # The page warns those without a graphics card; in a picture of the view that is no news.
        page.add_style_tag(content=".mantine-Notifications-root { display: none }")
        try:
            yield page
        finally:
            browser.close()


def screenshot(url: str, path: Path, dark: bool = False) -> None:
    """Write a PNG of the view as a newcomer sees it."""
    with open_page(url) as page:
        if dark:
            page.get_by_role("checkbox", name="dark", exact=True).click()
        settle(page)
        page.screenshot(path=path)


def settle(page) -> None:
    """Wait until the picture has stopped building up: software rendering takes a while."""
    before = None
    for _ in range(SETTLE_TRIES):
        page.wait_for_timeout(3000)
        now = imageio.imread(page.screenshot())[..., :3].astype(int)
        if before is not None and np.abs(now - before).mean() < SETTLED:
            return
        before = now


if __name__ == "__main__":
    screenshot(sys.argv[1], Path(sys.argv[2]), dark="--dark" in sys.argv)
