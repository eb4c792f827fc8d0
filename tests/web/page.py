"""What the browser tests share: a page on a flight, its picture, and where on it a place is seen."""

import math
import time

import imageio.v3 as imageio
import msgspec
import numpy as np
from viser.transforms import SO3

from gcs.contract.frames import Frame
from gcs.contract.messages import State
from tests.ports import free_port
from tests.web import flight
from web.memory.other import Geodetic
from web.view import View
from web.viewer import Viewer

S = 1_000_000_000


class Tape:
    """A replay that only remembers what it was told."""

    def __init__(self):
        self.start_ns, self.end_ns = flight.START_NS, flight.START_NS + 60 * S
        self.now_ns = flight.START_NS + 40 * S
        self.playing, self.speed = True, 1.0

    def play(self) -> None:
        self.playing = True

    def pause(self) -> None:
        self.playing = False

    def seek(self, t_ns: int) -> None:
        self.now_ns = t_ns

    def set_speed(self, speed: float) -> None:
        self.speed = speed


BESIDE_M = np.array([0.0, 0.0, 40.0])  # the other course lies so much below


def other() -> Geodetic:
    """The same flight as a survey without end would have it, and BESIDE_M lower."""
    t_s = np.arange(0.0, 60.0, 0.1)
    frame = Frame(flight.SCENE.origin_lat_deg, flight.SCENE.origin_lon_deg, flight.SCENE.origin_alt_m)
    there = frame.to_geodetic(flight.position(t_s) - BESIDE_M)
    return Geodetic("truth.csv", flight.START_NS + np.round(t_s * S).astype(np.int64), *there)


def opened(playback: Tape | None, beside: Geodetic | None = None) -> View:
    view = View(flight.SCENE, port=free_port(), playback=playback, other=beside)
    for message, source in flight.messages(40.0):
        if isinstance(message, State):
            message = msgspec.structs.replace(message, protection_h_m=3.2, protection_v_m=6.4)
        view.put(message, source)
    return view


def until(condition, timeout_s: float = 60.0) -> bool:
    end_s = time.monotonic() + timeout_s
    while not (met := condition()) and time.monotonic() < end_s:
        time.sleep(0.1)
    return bool(met)


def tab(page, name: str) -> None:
    page.get_by_role("tab", name=name, exact=True).click()


def choose(page, label: str, option: str, nth: int = 0) -> None:
    page.get_by_role("combobox", name=label, exact=True).or_(page.get_by_label(label, exact=True)).nth(
        nth
    ).click()
    page.get_by_role("option", name=option, exact=True).click()


def canvas(page) -> dict[str, float]:
    """Left, top, width and height of the 3-D picture on the page; the plots are smaller canvases."""
    return page.evaluate(
        """() => [...document.querySelectorAll('canvas')].map(c => c.getBoundingClientRect())
        .map(r => ({x: r.x, y: r.y, width: r.width, height: r.height}))
        .sort((a, b) => b.width * b.height - a.width * a.height)[0]"""
    )


def picture(page) -> np.ndarray:
    """(h, w, 3) int, the 3-D part of the page."""
    from playwright.sync_api import TimeoutError as TooSlow

    for timeout_s in (20, 20, 60):  # on a busy machine without a graphics card a picture may never be ready
        try:
            shot = page.screenshot(clip=canvas(page), timeout=1000 * timeout_s)
            return imageio.imread(shot)[..., :3].astype(int)
        except TooSlow:
            continue
    raise AssertionError("the page gives no picture")


def red(page) -> int:
    """How many pixels have the isolated outliers' colour."""
    r, g, b = np.moveaxis(picture(page), -1, 0)
    return int(((r > 190) & (g < 130) & (b < 110) & (r - g > 90)).sum())


def blue(page) -> int:
    """How many pixels have the newest track's colour."""
    return int(is_blue(picture(page)).sum())


def ink(page) -> int:
    """How many pixels are as dark as text on the light page, names among them."""
    return int((picture(page).max(axis=-1) < 90).sum())


def is_blue(pixels: np.ndarray) -> np.ndarray:
    """(h, w, 3) → (h, w) whether it has the newest track's colour."""
    r, _, b = np.moveaxis(pixels, -1, 0)
    return (b > 170) & (r < 110) & (b - r > 100)


def viewer_of(view: View) -> Viewer:
    """The first one."""
    return next(iter(view._viewers.values()))


def pixel(page, view: View, place) -> tuple[float, float]:
    """Where on the page a place of the world is seen."""
    camera = viewer_of(view).camera
    seen = camera._client.camera
    right, down, ahead = SO3(seen.wxyz).inverse().apply(np.asarray(place) + camera.offset - seen.position)
    box = canvas(page)
    focal = box["height"] / 2 / math.tan(seen.fov / 2)
    x, y = focal * right / ahead + box["width"] / 2, focal * down / ahead + box["height"] / 2
    return box["x"] + x, box["y"] + y
