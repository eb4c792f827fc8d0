"""Outliers of one size on the screen, one solid a kind, sent once."""

from types import SimpleNamespace

import numpy as np
import pytest

from tests.web.flight import SCENE
from tests.web.memory.made import claim
from web.memory.flight import SeenFlight
from web.scene import marks
from web.scene.marks import MARK_PX, PIECE, RATE_PX, SHAPES, Eye, Marks, sizes_m


class Stage:
    """A scene that only remembers its nodes."""

    def __init__(self):
        self.nodes: dict[str, SimpleNamespace] = {}
        self.sent = 0

    def add_line_segments(self, name, points, colour, **_):
        self.sent += 1
        node = SimpleNamespace(points=points, remove=lambda: self.nodes.pop(name, None))
        self.nodes[name] = node
        return node

    def places(self, kind: str) -> np.ndarray:
        """(n, 3) the middles of that kind's marks."""
        lines = len(SHAPES[kind])
        found = [
            n.points.reshape(-1, 2 * lines, 3).mean(axis=1)
            for name, n in self.nodes.items()
            if f"/{kind}-" in name
        ]
        return np.concatenate([np.zeros((0, 3)), *found])

    def width(self, name: str) -> float:
        points = self.nodes[f"/world/uav1/outliers/{name}"].points
        return float(np.ptp(points.reshape(-1, 3), axis=0).max())


@pytest.fixture
def flight():
    return SeenFlight(SCENE)


def outliers(n: int, kind: str, channel: str = "range", first: int = 0) -> list:
    return [
        claim(k, "radar", {channel: (9.0, 1.0, 1.0, kind)}, position=(float(k), 0.0, 0.0))
        for k in range(first, first + n)
    ]


def test_a_mark_takes_the_same_angle_near_and_far():
    places = np.array([(100.0, 0, 0), (3000.0, 0, 0)])
    sizes = sizes_m(places, np.array([8.0, 8.0]), Eye(np.zeros(3), 0.001))
    np.testing.assert_allclose(sizes / [100.0, 3000.0], 0.008)


def test_every_outlier_is_shown_once_by_its_kind(flight):
    stage = Stage()
    shown = Marks(stage, flight)
    flight.outliers.extend(outliers(2 * PIECE + 7, "isolated") + outliers(5, "patch"))
    shown.update(Eye(np.array([0, 0, 500.0]), 0.001))
    assert [len(stage.places(kind)) for kind in ("isolated", "patch", "invalid")] == [2 * PIECE + 7, 5, 0]
    sent = stage.sent
    shown.update(Eye(np.array([0, 0, 500.0]), 0.001))
    assert stage.sent == sent


def test_a_refused_rate_is_marked_smaller(flight):
    stage = Stage()
    flight.outliers.extend(outliers(1, "isolated") + outliers(1, "patch", "range_rate"))
    Marks(stage, flight).update(Eye(np.array([0, 0, 1000.0]), 0.001))
    ratio = stage.width("isolated-tail") / (stage.width("patch-tail") / np.ptp(SHAPES["patch"]))
    np.testing.assert_allclose(ratio, MARK_PX / RATE_PX, rtol=1e-3)


def test_sizes_follow_the_eye(flight):
    stage = Stage()
    flight.outliers.extend(outliers(3, "patch"))
    shown = Marks(stage, flight)
    shown.update(Eye(np.array([0, 0, 1000.0]), 0.001))
    far = stage.places("patch"), stage.nodes["/world/uav1/outliers/patch-tail"].points[0]
    shown.update(Eye(np.array([0, 0, 100.0]), 0.001))
    near = stage.places("patch"), stage.nodes["/world/uav1/outliers/patch-tail"].points[0]
    np.testing.assert_allclose(far[0], near[0], atol=1e-4)
    edges = [np.linalg.norm(line[1] - line[0]) for line in (far[1], near[1])]
    np.testing.assert_allclose(edges[0] / edges[1], 10.0, rtol=0.01)


def test_what_may_still_be_revised_is_marked_too_and_taken_back(flight, monkeypatch):
    stage = Stage()
    shown = Marks(stage, flight)
    monkeypatch.setattr(flight.claims, "pending", lambda: outliers(1, "isolated"))
    shown.update(Eye(np.zeros(3), 0.001))
    assert len(stage.places("isolated")) == 1
    monkeypatch.setattr(flight.claims, "pending", lambda: [])
    shown.update(Eye(np.zeros(3), 0.001))
    assert stage.nodes == {}


def test_what_the_flight_keeps_no_more_is_taken_away(flight, monkeypatch):
    monkeypatch.setattr(marks, "PIECE", 10)
    stage = Stage()
    shown = Marks(stage, flight)
    flight.outliers.extend(outliers(35, "isolated"))
    shown.update(Eye(np.zeros(3), 0.001))
    for _ in range(20):
        flight.outliers.popleft()
    flight.outliers_before = 20
    flight.outliers.extend(outliers(1, "isolated", first=35))
    shown.update(Eye(np.zeros(3), 0.001))
    assert sorted(np.round(stage.places("isolated")[:, 0]).tolist()) == list(range(20, 36))


def test_clear_takes_all_marks_away(flight):
    stage = Stage()
    shown = Marks(stage, flight)
    flight.outliers.extend(outliers(PIECE + 3, "invalid"))
    shown.update(Eye(np.zeros(3), 0.001))
    shown.clear()
    assert stage.nodes == {}


@pytest.mark.parametrize("kind", SHAPES)
def test_a_shape_is_about_one_unit_wide_and_centred(kind):
    corners = SHAPES[kind].reshape(-1, 3)
    np.testing.assert_allclose(corners.min(axis=0), -corners.max(axis=0), atol=1e-9)
    assert 0.6 < np.ptp(corners, axis=0).max() <= 1.0
