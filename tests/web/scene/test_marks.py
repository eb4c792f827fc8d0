"""Outliers of one size on the screen, one solid a kind, sent once."""

from types import SimpleNamespace

import numpy as np
import pytest

from tests.web.flight import SCENE
from tests.web.memory.made import claim
from web.memory.flight import SeenFlight
from web.scene import marks
from web.scene.marks import MARK_PX, PIECE, RATE_PX, Marks, sizes_m


class Stage:
    """A scene that only remembers its nodes."""

    def __init__(self):
        self.nodes: dict[str, SimpleNamespace] = {}
        self.sent = 0

    def add_batched_meshes_simple(self, name, vertices, faces, wxyzs, positions, **more):
        self.sent += 1
        node = SimpleNamespace(positions=np.array(positions), batched_scales=more["batched_scales"])
        node.remove = lambda: self.nodes.pop(name, None)
        self.nodes[name] = node
        return node

    def count(self, kind: str) -> int:
        return sum(len(node.positions) for name, node in self.nodes.items() if f"/{kind}-" in name)


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
    sizes = sizes_m(places, np.array([8.0, 8.0]), np.zeros(3), 0.001)
    np.testing.assert_allclose(sizes / [100.0, 3000.0], 0.008)


def test_every_outlier_is_shown_once_by_its_kind(flight):
    stage = Stage()
    shown = Marks(stage, flight)
    flight.outliers.extend(outliers(2 * PIECE + 7, "isolated") + outliers(5, "patch"))
    shown.update(np.array([0, 0, 500.0]), 0.001)
    assert [stage.count(kind) for kind in ("isolated", "patch", "invalid")] == [2 * PIECE + 7, 5, 0]
    sent = stage.sent
    shown.update(np.array([0, 0, 500.0]), 0.001)
    assert stage.sent == sent


def test_a_refused_rate_is_marked_smaller(flight):
    stage = Stage()
    flight.outliers.extend(outliers(1, "isolated") + outliers(1, "patch", "range_rate"))
    Marks(stage, flight).update(np.array([0, 0, 1000.0]), 0.001)
    sizes = {name.split("/")[-1]: float(node.batched_scales[0]) for name, node in stage.nodes.items()}
    np.testing.assert_allclose(sizes["isolated-tail"] / sizes["patch-tail"], MARK_PX / RATE_PX, rtol=1e-5)


def test_sizes_follow_the_eye(flight):
    stage = Stage()
    flight.outliers.extend(outliers(3, "patch"))
    shown = Marks(stage, flight)
    shown.update(np.array([0, 0, 1000.0]), 0.001)
    far = stage.nodes["/world/outliers/patch-tail"].batched_scales
    shown.update(np.array([0, 0, 100.0]), 0.001)
    near = stage.nodes["/world/outliers/patch-tail"].batched_scales
    np.testing.assert_allclose(far / near, 10.0, rtol=0.01)


def test_what_may_still_be_revised_is_marked_too_and_taken_back(flight, monkeypatch):
    stage = Stage()
    shown = Marks(stage, flight)
    monkeypatch.setattr(flight.claims, "pending", lambda: outliers(1, "isolated"))
    shown.update(np.zeros(3), 0.001)
    assert stage.count("isolated") == 1
    monkeypatch.setattr(flight.claims, "pending", lambda: [])
    shown.update(np.zeros(3), 0.001)
    assert stage.nodes == {}


def test_what_the_flight_keeps_no_more_is_taken_away(flight, monkeypatch):
    monkeypatch.setattr(marks, "PIECE", 10)
    stage = Stage()
    shown = Marks(stage, flight)
    flight.outliers.extend(outliers(35, "isolated"))
    shown.update(np.zeros(3), 0.001)
    for _ in range(20):
        flight.outliers.popleft()
    flight.outliers_before = 20
    flight.outliers.extend(outliers(1, "isolated", first=35))
    shown.update(np.zeros(3), 0.001)
    places = sorted(x for node in stage.nodes.values() for x in node.positions[:, 0].tolist())
    assert places == list(range(20, 36))


def test_clear_takes_all_marks_away(flight):
    stage = Stage()
    shown = Marks(stage, flight)
    flight.outliers.extend(outliers(PIECE + 3, "invalid"))
    shown.update(np.zeros(3), 0.001)
    shown.clear()
    assert stage.nodes == {}
