"""A clicked outlier: everything about it, in words."""

from tests.web.memory.made import claim
from web.memory.residuals import Statement
from web.panel import picked


def test_the_story_tells_value_prediction_verdict_reason_and_the_others():
    shot = claim(
        0,
        "radar",
        {"range": (105.0, 100.0, 0.5, "isolated", "innovation (10.0 sigma)"), "azimuth": (1.0, 1.0, 0.1)},
    )
    said = picked.story(shot, [Statement("theo", 0.04, "azimuth", 1.1, "accepted")])
    for text in ("isolated", "105.00 m", "100.00 m", "+10.0 σ", "too far from what everything else says"):
        assert text in said
    assert "0.04 s apart" in said
    assert "azimuth +1.1 σ" in said
    assert "believed" in said


def test_a_sentence_stays_as_it_is():
    shot = claim(0, "ins", {"e": (1.0, None, None, "invalid", "the autopilot has lost GPS")})
    assert "the autopilot has lost GPS" in picked.story(shot, [])
