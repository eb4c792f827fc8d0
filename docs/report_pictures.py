"""Draws docs/report.png and docs/compare.png in Chromium, from a replay of the sample flight.

python docs/report_pictures.py RUN
"""

import sys
import tempfile
from pathlib import Path

from bridges import simulated
from gcs.report import compare, report
from gcs.report.basis import page, run
from gcs.report.trust import Tolerance
from tests.web import browser

DOCS = Path(__file__).parent
TRUTH = DOCS.parent / "logs" / "sample" / "truth.csv"
SIZE = {"width": 1280, "height": 720}


def draw(html: str, picture: Path, *, dark: bool) -> None:
    """The first screen of a page."""
    from playwright.sync_api import sync_playwright

    with tempfile.TemporaryDirectory() as folder, sync_playwright() as playwright:
        file = Path(folder) / "page.html"
        file.write_text(html, encoding="utf-8")
        chromium = playwright.chromium.launch(executable_path=browser.CHROMIUM, args=browser.ARGS)
        tab = chromium.new_page(viewport=SIZE, color_scheme="dark" if dark else "light")
        tab.goto(file.as_uri())
        tab.locator("body[data-drawn=all]").wait_for(timeout=180_000)
        tab.screenshot(path=picture)
        chromium.close()


if __name__ == "__main__":
    flown = run.load(Path(sys.argv[1]))
    truth = compare.of_truth(TRUTH, simulated.read_truth(TRUTH), flown.frame)
    found = compare.difference(compare.of_run(flown, flown.frame, live=False), truth)
    draw(page.render(report.document(flown, Tolerance(2.0, 2.0))), DOCS / "report.png", dark=False)
    draw(page.render(compare.document(found)), DOCS / "compare.png", dark=True)
