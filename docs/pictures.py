"""Makes the pictures of the page in docs/, in a real Chromium, of the sample flight.

``python docs/pictures.py`` makes all, ``python docs/pictures.py view-picked`` one. The page is the station's
own, of ``gcs replay`` and ``gcs run``, driven as an operator would; the several vehicles are made up. Without
a graphics card a picture takes about a minute.
"""

import io
import os
import signal
import subprocess
import sys
import tempfile
import threading
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any, NamedTuple

import msgspec
import numpy as np
from PIL import Image

ROOT = Path(__file__).resolve().parents[1]
sys.path.insert(0, str(ROOT))

from gcs.contract.messages import Health, State  # noqa: E402
from tests.web import browser, flight  # noqa: E402
from web.view import View  # noqa: E402

SAMPLE, PORT = ROOT / "logs" / "sample", 26_090
BUS, MAVLINK = "tcp/127.0.0.1:26091", "udpin:127.0.0.1:26092"
SMALL, LARGE = {"width": 1280, "height": 720}, {"width": 1920, "height": 1080}
WIDE_PX = 1280  # pictures of the large window are made smaller for the page
COLOURS = 128  # of a palette: a third of the bytes


class Shot(NamedTuple):
    """One picture."""

    size: dict[str, int]
    source: Callable[[], Any]  # opens what is shown, until the picture is taken
    drive: Callable[[Any, Any], None]


def main(wanted: list[str]) -> None:
    for name, shot in SHOTS.items():
        if wanted and name not in wanted:
            continue
        with (
            shot.source() as process,
            browser.open_page(f"http://127.0.0.1:{PORT}", shot.size) as page,
        ):
            if shot.source is replayed:
                page.get_by_text("END", exact=True).wait_for()
            shot.drive(page, process)
            browser.settle(page)
            path = ROOT / "docs" / f"{name}.png"
            save(page.screenshot(), path)
            print(f"{path.relative_to(ROOT)}: {path.stat().st_size // 1000} kB")


@contextmanager
def station(*command: str) -> Iterator[subprocess.Popen]:
    """The station with its page, in a process of its own."""
    settings = (f"view.port={PORT}", f"bus.endpoint={BUS}", f"mavlink.link={MAVLINK}")
    with tempfile.TemporaryDirectory() as out:
        process = subprocess.Popen(
            [sys.executable, "-m", "gcs", *command, "--station", str(SAMPLE / "station.toml"), "--out", out,
             *(word for setting in settings for word in ("--config", setting))],
            cwd=ROOT, stderr=subprocess.PIPE, text=True,
        )  # fmt: skip
        try:
            assert process.stderr
            while process.poll() is None and "view:" not in process.stderr.readline():
                pass
            yield process
        finally:
            process.send_signal(signal.SIGCONT)
            process.send_signal(signal.SIGINT)
            process.wait(60)


FEEDS = [f"{name}={SAMPLE / name}.csv" for name in ("theo-north", "theo-east", "radar-1")]
FLOWN = ("replay", str(SAMPLE / "flight.tlog"), "--feed", *FEEDS)


def replayed() -> Any:
    """The sample flight, to its end, with its truth beside it."""
    return station(*FLOWN, "--view", "--overlay", str(SAMPLE / "truth.csv"))


def unheard() -> Any:
    """A station that has heard nothing yet."""
    return station("run")


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


def flown(page: Any, _process: subprocess.Popen) -> None:
    page.get_by_role("tab", name="Sensors", exact=True).click()


def picked(page: Any, _process: subprocess.Popen) -> None:
    """The outlier that stands most by itself, clicked, on the dark page."""
    page.get_by_role("tab", name="Show", exact=True).click()
    page.get_by_role("checkbox", name="dark", exact=True).click()
    browser.settle(page)
    pixels = np.array(Image.open(io.BytesIO(page.screenshot())).convert("RGB"), int)
    middle = slice(360, 880)  # between the panels
    r, g, b = np.moveaxis(pixels[:, middle], -1, 0)
    reds = np.argwhere((r > 190) & (g < 130) & (b < 110))
    alone = max(reds[::7], key=lambda p: np.sort(np.abs(reds - p).sum(axis=1))[min(60, len(reds) - 1)])
    page.mouse.click(int(alone[1]) + middle.start, int(alone[0]))
    page.get_by_text("the others then").wait_for()


def painted(page: Any, _process: subprocess.Popen) -> None:
    """The track by its speed, height and speed beside it, the aircraft followed, with a limit set."""
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
    left, top, right, bottom = 520, 120, 1480, 900
    page.mouse.move(left, top)
    page.mouse.down()
    page.mouse.move(right, bottom, steps=10)
    page.mouse.up()
    page.get_by_text("measurements there").wait_for()


def many(page: Any, _process: None) -> None:
    page.get_by_text("NO STATION").wait_for()


def save(png: bytes, path: Path) -> None:
    picture = Image.open(io.BytesIO(png)).convert("RGB")
    if picture.width > WIDE_PX:
        picture = picture.resize(
            (WIDE_PX, picture.height * WIDE_PX // picture.width), Image.Resampling.LANCZOS
        )
    picture.quantize(COLOURS, Image.Quantize.FASTOCTREE, dither=Image.Dither.NONE).save(path, optimize=True)


SHOTS = {
    "view": Shot(SMALL, replayed, flown),
    "view-picked": Shot(SMALL, replayed, picked),
    "view-painted": Shot(LARGE, replayed, painted),
    "view-lost": Shot(SMALL, replayed, lost),
    "view-empty": Shot(SMALL, unheard, empty),
    "view-boxed": Shot(LARGE, replayed, boxed),
    "view-vehicles": Shot(SMALL, range_of_three, many),
}

if __name__ == "__main__":
    main(sys.argv[1:])
