"""The legend: every sensor, every shape, and the scale of a painted track."""

import numpy as np

from tests.web.flight import SCENE
from web.memory.other import Geodetic, OtherTrack
from web.panel import legend
from web.scene.paint import PLAIN, Scale


def test_sensors_shapes_and_the_factor_are_named():
    said = legend.shown(SCENE, 50, PLAIN, None)
    for text in ("theo-north", "radar-west", "ins", "isolated", "patch", "invalid", "×50"):
        assert text in said
    assert "gradient" not in said


def test_another_course_is_named_where_there_is_one():
    nothing = np.zeros(1)
    other = OtherTrack(Geodetic("truth <1>", np.array([7]), nothing, nothing, nothing), SCENE)
    assert "truth &lt;1&gt;" in legend.shown(SCENE, 1, PLAIN, None, other)
    assert "truth" not in legend.shown(SCENE, 1, PLAIN, None)


def test_a_painted_track_has_its_scale():
    said = legend.shown(SCENE, 1, "speed", Scale(12.0, 34.5))
    for text in ("gradient", "speed 12.0", "34.5 m/s"):
        assert text in said
