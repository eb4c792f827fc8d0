"""Makes the pictures of the page and of the reports in docs/, in a real Chromium, of the sample flight.

    python docs/pictures.py                   those of docs/
    python docs/pictures.py view-picked       one of them
    python docs/pictures.py --all FOLDER …    each on the light and the dark page, 1280 x 720 and 1920 x 1080

The page is the station's own, of ``gcs demo``, ``replay`` and ``run``, driven as an operator would; the
several vehicles are made up. Without a graphics card a picture takes about a minute.
"""

import io
import os
import re
import signal
import subprocess
import sys
import tempfile
import threading
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from functools import partial
from pathlib import Path
from typing import Any, NamedTuple

import msgspec
import numpy as np
from PIL import Image

ROOT = Path(__file__).resolve().parents[1]
sys.path.insert(0, str(ROOT))

from gcs.contract.messages import Health, State  # noqa: E402
from tests.web import browser, flight  # noqa: E402
from web.plots.dock import WIDTH_PX  # noqa: E402
from web.view import View  # noqa: E402
from web.viewer import PANEL_PX  # noqa: E402

SAMPLE, PORT = ROOT / "logs" / "sample", 23_090
BUS, MAVLINK = "tcp/127.0.0.1:23091", "udpin:127.0.0.1:23092"
TOLERANCE = ("--tolerance-h", "2", "--tolerance-v", "2")
SMALL, LARGE = {"width": 1280, "height": 720}, {"width": 1920, "height": 1080}
WIDE_PX = 1280  # pictures of the large window are made smaller for the page
CLEAR_PX = 20
PATIENCE_MS = 240_000  # of a busy machine without a graphics card
COLOURS, TURNS = 256, 2  # of a palette, and to refine it: a quarter of the bytes, and no tint is lost
STANDS = re.compile("^(END|PAUSED)$")  # a replay that was flown; paused where an earlier look has sought


class Look(NamedTuple):
    """Of the browser's window."""

    size: dict[str, int]
    dark: bool


class Shot(NamedTuple):
    """One picture."""

    look: Look  # in docs/
    source: Callable[[], Any]  # opens what is shown, until the picture is taken
    drive: Callable[[Any, Any], None]


def main(words: list[str]) -> None:
    folder = Path(words[1]) if words[:1] == ["--all"] else None
    wanted = words[2:] if folder else words
    for name, shot in SHOTS.items():
        if wanted and name not in wanted:
            continue
        looks = (
            [Look(size, dark) for size in (SMALL, LARGE) for dark in (False, True)] if folder else [shot.look]
        )
        # a live flight is over before a third look; what stands still is opened once for all
        for together in [[look] for look in looks] if shot.source is flying else [looks]:
            take(name, shot, together, folder)


def take(name: str, shot: Shot, looks: list[Look], folder: Path | None) -> None:
    """One shot in some looks, of one source; into docs/ without a ``folder``."""
    with shot.source() as source:
        for look in looks:
            picture = (of_file if isinstance(source, Path) else of_page)(shot, source, look)
            shade = f"-{look.size['width']}-{'dark' if look.dark else 'light'}"
            path = folder / f"{name}{shade}.png" if folder else ROOT / "docs" / f"{name}.png"
            save(picture, path, shrunk=not folder)
            print(f"{path.name}: {path.stat().st_size // 1000} kB", flush=True)


def of_page(shot: Shot, process: Any, look: Look) -> bytes:
    with browser.open_page(f"http://127.0.0.1:{PORT}", look.size) as page:
        page.set_default_timeout(PATIENCE_MS)
        if shot.source is replayed:
            page.get_by_text(STANDS).first.wait_for()
            page.get_by_role("tab", name="Flight", exact=True).click()
        page.get_by_role("tab", name="Show", exact=True).click()
        dark = page.get_by_role("checkbox", name="dark", exact=True)
        dark.set_checked(look.dark, force=True)
        page.get_by_role("tab", name="Flight", exact=True).click()
        shot.drive(page, process)
        if shot.source is not flying:  # that never comes to rest
            browser.settle(page)
        picture = page.screenshot(timeout=120_000)
        if process:
            process.send_signal(signal.SIGCONT)
        return picture


def of_file(shot: Shot, file: Path, look: Look) -> bytes:
    """The first screen of a report."""
    from playwright.sync_api import sync_playwright

    with sync_playwright() as playwright:
        chromium = playwright.chromium.launch(executable_path=browser.CHROMIUM, args=browser.ARGS)
        tab = chromium.new_page(viewport=look.size, color_scheme="dark" if look.dark else "light")
        tab.goto(file.as_uri())
        shot.drive(tab, None)
        picture = tab.screenshot(timeout=120_000)
        chromium.close()
    return picture


@contextmanager
def station(*command: str) -> Iterator[subprocess.Popen]:
    """The station with its page, in a process of its own."""
    settings = (f"view.port={PORT}", f"bus.endpoint={BUS}", f"mavlink.link={MAVLINK}")
    with tempfile.TemporaryDirectory() as out:
        process = subprocess.Popen(
            [sys.executable, "-m", "gcs", *command, "--out", out,
             *(word for setting in settings for word in ("--config", setting))],
            cwd=ROOT, stderr=subprocess.PIPE, text=True,
        )  # fmt: skip
        try:
            assert process.stderr
            while "view:" not in process.stderr.readline():
                assert process.poll() is None, "the station has ended; is its port in use?"
            yield process
        finally:
            process.send_signal(signal.SIGCONT)
            process.send_signal(signal.SIGINT)
            process.wait(60)


FEEDS = [f"{name}={SAMPLE / name}.csv" for name in ("theo-north", "theo-east", "radar-1")]
STATION = ("--station", str(SAMPLE / "station.toml"))
FLOWN = ("replay", str(SAMPLE / "flight.tlog"), "--feed", *FEEDS, *STATION)


def replayed() -> Any:
    """The sample flight, to its end, with its truth beside it."""
    return station(*FLOWN, "--view", "--overlay", str(SAMPLE / "truth.csv"))


def unheard() -> Any:
    """A station that has heard nothing yet."""
    return station("run", *STATION)


def flying() -> Any:
    """The demo, live."""
    return station("demo")


@contextmanager
def reported(*, compared: bool) -> Iterator[Path]:
    """The report of the sample flight, or its best estimate against the truth."""
    with tempfile.TemporaryDirectory() as out:
        gcs, page = [sys.executable, "-m", "gcs"], Path(out, "page.html")
        here = os.environ | {"PYTHONPATH": str(ROOT)}
        run = "sample-flight"  # the page tells the folder as it was named
        what = ["compare", run, str(SAMPLE / "truth.csv")] if compared else ["report", run, *TOLERANCE]
        for words in ([*FLOWN, "--out", run], [*what, "--out", page.name]):
            subprocess.run([*gcs, *words], cwd=out, env=here, check=True, capture_output=True)
        yield page


@contextmanager
def range_of_three() -> Iterator[None]:
    """Two vehicles on a made-up flight, one of them in doubt, and a third whose station nobody has heard."""
    view, over = View(flight.SCENE, port=PORT), threading.Event()
    view.expect(("uav1", "uav2", "uav3"))
    view.add(msgspec.structs.replace(flight.SCENE, vehicle="uav2"))
    told = [pair for pair in flight.messages(60.0) if not isinstance(pair[0], Health)]

    def fly() -> None:
        for vehicle in ("uav1", "uav2"):
            for message, source in told:
                view.put(message, source, vehicle)
        last = [message for message, source in told if isinstance(message, State) and not source][-1]
        while not over.wait(0.2):
            for vehicle in ("uav1", "uav2"):
                view.put(msgspec.structs.replace(last, ambiguous=vehicle == "uav2"), "", vehicle)

    flying = threading.Thread(target=fly)
    flying.start()
    yield
    over.set()
    flying.join()
    view.close()


def live(page: Any, _process: subprocess.Popen) -> None:
    """The flight after its first turns, the sensors beside it."""
    page.get_by_role("tab", name="Sensors", exact=True).click()
    page.get_by_text("LIVE", exact=True).wait_for(timeout=180_000)
    page.wait_for_timeout(75_000)


def flagged(page: Any, _process: subprocess.Popen) -> None:
    """Back in the middle of a patch of the radar, which the bar tells."""
    seconds = page.locator(".mantine-NumberInput-input").filter(visible=True).first
    seconds.fill("26.4")
    seconds.press("Enter")
    page.locator(".bar").filter(has_text="radar-1").first.wait_for()


def picked(page: Any, _process: subprocess.Popen) -> None:
    """The outlier that stands most by itself, clicked."""
    browser.settle(page)
    pixels = np.array(Image.open(io.BytesIO(page.screenshot())).convert("RGB"), int)
    left, right = between(page)
    middle = slice(left, right)
    r, g, b = np.moveaxis(pixels[:, middle], -1, 0)
    reds = np.argwhere((r > 190) & (g < 130) & (b < 110))
    alone = max(reds[::7], key=lambda p: np.sort(np.abs(reds - p).sum(axis=1))[min(60, len(reds) - 1)])
    page.mouse.click(int(alone[1]) + middle.start, int(alone[0]))
    page.get_by_text("the others then").wait_for()


def between(page: Any) -> tuple[int, int]:
    """First and last pixel of the 3-D picture from left to right, clear of the panels' edges."""
    return WIDTH_PX + CLEAR_PX, page.viewport_size["width"] - PANEL_PX - CLEAR_PX


def painted(page: Any, _process: subprocess.Popen) -> None:
    """The track by its speed, height and speed beside it, with a limit set."""
    page.get_by_role("tab", name="Limits", exact=True).click()
    for label, limit in (("position within m", "5"), ("height within m", "5")):
        page.get_by_label(label).fill(limit)
        page.get_by_label(label).press("Enter")
    page.get_by_label("Show", exact=True).first.click()
    page.get_by_role("option", name="height and speed", exact=True).click()
    page.get_by_role("tab", name="Show", exact=True).click()
    page.get_by_label("track colour").first.click()
    page.get_by_role("option", name="speed", exact=True).click()
    page.get_by_role("checkbox", name="residual sticks", exact=True).click()


def lost(page: Any, process: subprocess.Popen) -> None:
    """The station stands still; the page says so by itself."""
    page.get_by_role("tab", name="Sensors", exact=True).click()
    time.sleep(3.0)
    os.kill(process.pid, signal.SIGSTOP)


def empty(page: Any, _process: subprocess.Popen) -> None:
    page.get_by_text("No data yet.").wait_for()


def boxed(page: Any, _process: subprocess.Popen) -> None:
    """A box over the whole flight, with its outliers told."""
    page.get_by_role("button", name="Outliers in a box").click()
    page.get_by_text("Drag a box").wait_for()
    (left, right), height = between(page), page.viewport_size["height"]
    page.mouse.move(left + (right - left) // 8, height // 9)
    page.mouse.down()
    page.mouse.move(right - (right - left) // 16, height * 5 // 6, steps=10)
    page.mouse.up()
    page.get_by_text("measurements there").wait_for()


def many(page: Any, _process: None) -> None:
    page.get_by_text("NO STATION").wait_for()


def drawn(page: Any, _process: None) -> None:
    page.locator("body[data-drawn=all]").wait_for(timeout=180_000)


def save(png: bytes, path: Path, *, shrunk: bool) -> None:
    path.parent.mkdir(parents=True, exist_ok=True)
    picture = Image.open(io.BytesIO(png)).convert("RGB")
    if shrunk and picture.width > WIDE_PX:
        picture = picture.resize(
            (WIDE_PX, picture.height * WIDE_PX // picture.width), Image.Resampling.LANCZOS
        )
    few = picture.quantize(COLOURS, Image.Quantize.MAXCOVERAGE, kmeans=TURNS, dither=Image.Dither.NONE)
    few.save(path, optimize=True)


LIGHT, DARK, WIDE = Look(SMALL, dark=False), Look(SMALL, dark=True), Look(LARGE, dark=False)
SHOTS = {
    "view": Shot(LIGHT, flying, live),
    "view-flagged": Shot(LIGHT, replayed, flagged),
    "view-picked": Shot(DARK, replayed, picked),
    "view-painted": Shot(WIDE, replayed, painted),
    "view-boxed": Shot(WIDE, replayed, boxed),
    "view-lost": Shot(LIGHT, replayed, lost),
    "view-empty": Shot(LIGHT, unheard, empty),
    "view-vehicles": Shot(LIGHT, range_of_three, many),
    "report": Shot(LIGHT, partial(reported, compared=False), drawn),
    "compare": Shot(DARK, partial(reported, compared=True), drawn),
}

if __name__ == "__main__":
    main(sys.argv[1:])
