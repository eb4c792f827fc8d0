"""Trails lose no point, send little, and stay bounded."""

import numpy as np
import pytest

from web.scene import trail
from web.scene.trail import CHUNK, MOST, TAIL, Trail, dots, drops, line, needed, shadow, sticks


class Canvas:
    """What the browser shows: the last segments of every name, and what they cost."""

    def __init__(self):
        self.shown: dict[str, np.ndarray] = {}
        self.sent_bytes = 0

    def draw(self, name: str, segments: np.ndarray) -> None:
        self.sent_bytes += segments.nbytes
        if len(segments):
            self.shown[name] = segments
        else:
            self.shown.pop(name, None)

    def segments(self) -> np.ndarray:
        everything = np.vstack([np.zeros((0, 2, 3)), *self.shown.values()])
        return everything[np.argsort(everything[:, 0, 0])]

    def dots(self) -> np.ndarray:
        everything = np.vstack([np.zeros((0, 3)), *self.shown.values()])
        return everything[np.argsort(everything[:, 0])]


def walk(n: int) -> np.ndarray:
    """(n, 3) points whose first coordinate counts, exactly in float32."""
    return np.stack([np.arange(n), np.arange(n) % 7, np.zeros(n)], axis=1).astype(float)


@pytest.mark.parametrize("n", [1, 2, TAIL, TAIL + 1, CHUNK, CHUNK + 1, 3 * CHUNK + TAIL + 17])
@pytest.mark.parametrize("every", [1, 7, 100, 1700])
def test_a_line_is_whole_after_every_update(n, every):
    canvas = Canvas()
    drawn = Trail("t", line, canvas.draw)
    points = walk(n)
    for i, point in enumerate(points):
        drawn.add(point)
        if i % every == 0 or i == n - 1:
            drawn.update()
            want = np.stack([points[:i], points[1 : i + 1]], axis=1)
            np.testing.assert_array_equal(canvas.segments(), want)


@pytest.mark.parametrize("n", [1, TAIL, CHUNK, 2 * CHUNK + TAIL + 3])
def test_every_dot_is_shown_once(n):
    canvas = Canvas()
    drawn = Trail("t", dots, canvas.draw)
    for point in walk(n):
        drawn.add(point)
        drawn.update()
    np.testing.assert_array_equal(canvas.dots(), walk(n))


def test_a_cut_leaves_a_gap():
    canvas = Canvas()
    drawn = Trail("t", line, canvas.draw)
    for point in ((0, 0, 0), (1, 0, 0)):
        drawn.add(point)
    drawn.cut()
    for point in ((50, 0, 0), (51, 0, 0)):
        drawn.add(point)
    drawn.update()
    np.testing.assert_array_equal(canvas.segments()[:, :, 0], [(0, 1), (50, 51)])


def test_pending_points_are_shown_until_taken_back():
    canvas = Canvas()
    drawn = Trail("t", dots, canvas.draw)
    drawn.update([(1, 2, 3)])
    assert len(canvas.dots()) == 1
    drawn.update([])
    assert len(canvas.dots()) == 0


def test_an_update_costs_a_tail_not_the_flight():
    canvas = Canvas()
    drawn = Trail("t", line, canvas.draw)
    n = 20 * CHUNK
    for point in walk(n):
        drawn.add(point)
        drawn.update()
    per_update = canvas.sent_bytes / n
    assert per_update < (TAIL + CHUNK / TAIL / 2 + 2) * 24  # half a tail, and each chunk's growth
    before = canvas.sent_bytes
    drawn.update()
    assert canvas.sent_bytes == before  # nothing new, nothing sent


@pytest.mark.parametrize("shape", [line, dots])
def test_hours_stay_bounded_and_reach_from_first_to_last(shape, monkeypatch):
    monkeypatch.setattr(trail, "CHUNK", 100)
    monkeypatch.setattr(trail, "TAIL", 10)
    canvas = Canvas()
    drawn = Trail("t", shape, canvas.draw)
    n = 5 * MOST * 100
    for i, point in enumerate(walk(n)):
        drawn.add(point)
        if i % 50 == 0:
            drawn.update()
    drawn.update()
    ends = canvas.segments()[:, :, 0] if shape is line else canvas.dots()[:, :1]
    assert len(ends) <= (MOST + 2) * 100 + 2 * MOST
    assert ends.min() == 0
    assert round(ends.max()) == n - 1
    assert len(canvas.shown) <= MOST + 2
    if shape is line:  # no hole: each segment starts where the one before ends
        np.testing.assert_array_equal(ends[1:, 0], ends[:-1, 1])


def test_an_old_line_keeps_what_it_needs_to_be_true():
    angle = np.arange(3 * CHUNK) * 0.1 / 20.0  # 0.1 s of a turn with 400 m radius at 20 m/s
    circle = np.column_stack([400.0 * np.cos(angle), 400.0 * np.sin(angle), np.full(len(angle), 200.0)])
    kept = needed(circle, 0.25)
    assert len(kept) < len(circle) / 8
    np.testing.assert_array_equal(kept[[0, -1]], circle[[0, -1]])
    middles = (kept[1:] + kept[:-1]) / 2
    assert 400.0 - np.hypot(middles[:, 0], middles[:, 1]).min() < 0.25


def test_a_corner_and_a_cut_of_an_old_line_stay():
    corner = np.array([(k, 0.0, 0.0) for k in range(30)] + [(29.0, k, 0.0) for k in range(30)])
    assert (29.0, 0.0, 0.0) in set(map(tuple, needed(corner, 0.01)))
    cut = np.vstack([corner[:5], [(np.nan,) * 3], corner[7:12]])
    kept = needed(cut, 1.0)
    np.testing.assert_array_equal(kept[:, 0], [0, 4, np.nan, 7, 11])


def test_redraw_sends_everything_once_more():
    canvas = Canvas()
    drawn = Trail("t", line, canvas.draw)
    for point in walk(CHUNK + 2 * TAIL + 3):
        drawn.add(point)
    drawn.update()
    before = canvas.segments()
    canvas.shown.clear()
    drawn.redraw()
    drawn.update()
    np.testing.assert_array_equal(canvas.segments(), before)


def test_what_goes_with_a_place_goes_with_its_segment():
    drawn = {}
    trail_ = Trail("t", line, lambda name, segments: drawn.update({name: segments}), wide=5)
    for k in range(3):
        trail_.add((k, 0, 0, 10 * k, np.nan))
    trail_.update()
    np.testing.assert_array_equal(drawn["t/tail"][:, :, 3], [(0, 10), (10, 20)])


def test_clear_takes_everything_away():
    canvas = Canvas()
    drawn = Trail("t", line, canvas.draw)
    for point in walk(2 * CHUNK + TAIL + 5):
        drawn.add(point)
    drawn.update()
    drawn.clear()
    assert canvas.shown == {}


def test_shadow_and_drops_end_on_the_ground():
    points = np.array([(0.0, 0, 50), (10.0, 0, 60)])
    np.testing.assert_array_equal(shadow(points), [[(0, 0, 0), (10, 0, 0)]])
    np.testing.assert_array_equal(drops(points)[1], [(10, 0, 60), (10, 0, 0)])


def test_a_stick_joins_the_claim_and_the_track():
    np.testing.assert_array_equal(sticks(np.array([(1.0, 2, 3, 4, 5, 6)])), [[(1, 2, 3), (4, 5, 6)]])
