"""A headless Chromium that can draw: for the tests of the view and for the picture in the README.

python tests/web/browser.py http://127.0.0.1:8080 docs/view.png [--dark]
"""

import sys
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

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
SETTLE_MS = 6000  # software rendering needs a few frames
SIZE = {"width": 1400, "height": 900}
SMALL = {"width": 1000, "height": 600}  # a third of the pixels, for what is rendered without a graphics card


@contextmanager
def open_page(url: str, size: dict[str, int] = SIZE) -> Iterator:
    """A Playwright page on the view, once its panel is there."""
    from playwright.sync_api import sync_playwright

    with sync_playwright() as playwright:
        browser = playwright.chromium.launch(executable_path=CHROMIUM, args=ARGS)
        page = browser.new_page(viewport=size)
        page.set_default_timeout(60_000)
        page.goto(url)
        page.get_by_text("Sensors").wait_for()
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
        page.wait_for_timeout(SETTLE_MS)
        page.screenshot(path=path)


if __name__ == "__main__":
    screenshot(sys.argv[1], Path(sys.argv[2]), dark="--dark" in sys.argv)
