"""Dots: sent when they change, sized for who looks."""

from types import SimpleNamespace

import numpy as np

from web.scene.clouds import DOT, Clouds


class DotApi:
    def __init__(self):
        self.drawn: list[str] = []
        self.handles: dict[str, SimpleNamespace] = {}

    def add_point_cloud(self, name, points, colors, *, point_size, **_look):
        self.drawn.append(name)
        handle = SimpleNamespace(points=points, colors=colors, point_size=point_size, removed=False)
        handle.remove = lambda: setattr(handle, "removed", True)
        self.handles[name] = handle
        return handle


def test_what_the_browser_has_is_not_sent_again_and_nothing_takes_it_away():
    clouds, places = Clouds(api := DotApi(), 1000.0), np.arange(6.0).reshape(2, 3)
    for _ in range(2):
        clouds.draw("raw/a/tail", places, (1, 2, 3))
    clouds.draw("raw/a/tail", places[:1], (1, 2, 3))
    assert api.drawn == ["raw/a/tail"] * 2
    clouds.recolour("raw/a/", (9, 9, 9))
    np.testing.assert_array_equal(api.handles["raw/a/tail"].colors, (9, 9, 9))
    clouds.draw("raw/a/tail", places[:0], (1, 2, 3))
    assert api.handles["raw/a/tail"].removed


def test_their_size_follows_the_distance_in_steps():
    clouds = Clouds(api := DotApi(), 1000.0)
    clouds.draw("a", np.zeros((1, 3)), (1, 2, 3))
    assert api.handles["a"].point_size == DOT * 1000.0
    for distance_m, size_m in ((1200.0, 1000.0), (3000.0, 3000.0)):
        clouds.resize(distance_m)
        assert api.handles["a"].point_size == DOT * size_m
