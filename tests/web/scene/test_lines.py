"""Line segments by name: what is sent for a colour, and what is not sent twice."""

import numpy as np

from web.look.colours import FILTERED, linear
from web.scene.lines import Lines

SEGMENTS = np.arange(12.0).reshape(2, 2, 3)


class Api:
    """A page that keeps what it was told to draw."""

    def __init__(self):
        self.drawn: list[tuple[str, np.ndarray, np.ndarray]] = []

    def add_line_segments(self, name, points, colors, **_look) -> "Handle":
        self.drawn.append((name, np.asarray(points, np.float32), np.asarray(colors, np.uint8)))
        return Handle(*self.drawn[-1][1:])


class Handle:
    def __init__(self, points: np.ndarray, colors: np.ndarray):
        self.points, self.colors = points, colors


def each_end() -> np.ndarray:
    return np.broadcast_to(np.array(FILTERED, np.uint8), SEGMENTS.shape)


def lines() -> tuple[Lines, Api]:
    api = Api()
    return Lines(api), api  # type: ignore[arg-type]


def test_a_colour_for_each_end_looks_like_the_same_one_for_all():
    drawing, api = lines()
    drawing.draw("/all", SEGMENTS, FILTERED, 2.0)
    drawing.draw("/ends", SEGMENTS, each_end(), 2.0)
    (_, _, for_all), (_, _, for_ends) = api.drawn
    np.testing.assert_array_equal(for_all, FILTERED)
    np.testing.assert_array_equal(for_ends, linear(each_end()))


def test_what_the_browser_has_is_not_sent_again():
    drawing, api = lines()
    for _ in range(2):
        drawing.draw("/ends", SEGMENTS, each_end(), 2.0)
    assert len(api.drawn) == 1
    drawing.draw("/ends", SEGMENTS + 1.0, each_end(), 2.0)
    assert len(api.drawn) == 2
