"""The legend: every sensor, every shape, and the scale of a painted track."""

from tests.web.flight import SCENE
from web.panel import legend
from web.scene.paint import PLAIN, Scale


def test_sensors_shapes_and_the_factor_are_named():
    said = legend.shown(SCENE, 50, PLAIN, None)
    for text in ("theo-north", "radar-west", "ins", "isolated", "patch", "invalid", "×50"):
        assert text in said
    assert "gradient" not in said


def test_a_painted_track_has_its_scale():
    said = legend.shown(SCENE, 1, "speed", Scale(12.0, 34.5))
    for text in ("gradient", "speed 12.0", "34.5 m/s"):
        assert text in said
