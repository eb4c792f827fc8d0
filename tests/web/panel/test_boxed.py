"""Outliers in a box, in words."""

from tests.web.memory.made import claim
from web.memory.boxed import Boxed, Refused
from web.panel.boxed import story

SHOT = claim(0, "radar", {"range": (105.0, 100.0, 0.5, "isolated", "innovation (10.0 sigma)")})


def test_count_share_and_every_channel_are_told():
    channel = Refused("radar <1>", "range_rate", 2, 0.25, -7.25, float("nan"))
    said = story(Boxed([SHOT, SHOT], 40, [channel]))
    for text in (
        "2 outliers",
        "5.0%",
        "of 40 measurements",
        "radar &lt;1&gt;",
        "range rate",
        "25%",
        "-7.2 σ",
    ):
        assert text in said
    assert "nan" not in said


def test_an_empty_box_says_so():
    assert "no outlier in the box, of 12 measurements" in story(Boxed([], 12, []))
