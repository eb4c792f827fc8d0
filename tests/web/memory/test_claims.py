"""Which claim becomes a raw point and which an outlier."""

import pytest

from gcs.contract.messages import Verdict
from tests.web.memory.made import verdict
from web.memory.claims import HOLD_NS, Claim, Claims

LATER = verdict(t_ns=HOLD_NS + 1, sensor="clock", position=None)


def settled_after(*verdicts: Verdict) -> list[Claim]:
    claims = Claims()
    for each in verdicts:
        claims.take(each)
    return claims.settle()


def test_one_refused_channel_makes_an_outlier():
    (claim,) = settled_after(
        verdict(channel="range", position=None), verdict(channel="azimuth", word="patch"), LATER
    )
    assert (claim.sensor, claim.position, claim.kind, claim.misplaced) == (
        "radar",
        (1.0, 2.0, 3.0),
        "patch",
        True,
    )


@pytest.mark.parametrize(
    ("words", "kind"),
    [
        (("used", "deweighted"), "accepted"),
        (("patch", "isolated"), "patch"),
        (("invalid", "patch"), "invalid"),
    ],
)
def test_the_worst_channel_speaks_for_the_claim(words, kind):
    shots = [verdict(channel=c, word=w) for c, w in zip(("range", "azimuth"), words, strict=True)]
    assert settled_after(*shots, LATER)[0].kind == kind


def test_a_refused_rate_leaves_the_place_standing():
    shots = [verdict(channel="range"), verdict(channel="range_rate", word="isolated"), LATER]
    (claim,) = settled_after(*shots)
    assert (claim.kind, claim.misplaced) == ("isolated", False)


def test_a_revision_takes_the_outlier_back():
    assert settled_after(verdict(word="isolated"), verdict(word="used"), LATER)[0].kind == "accepted"


def test_a_duplicate_does_not_condemn_the_original():
    assert settled_after(verdict(), verdict(word="duplicate"), LATER)[0].kind == "accepted"


def test_a_line_without_channels_claims_nothing():
    assert settled_after(verdict(channel="", word="invalid", position=None), LATER) == []


def test_nothing_settles_while_it_may_be_revised():
    claims = Claims()
    claims.take(verdict(word="isolated"))
    claims.take(verdict(t_ns=HOLD_NS, sensor="theo"))
    assert claims.settle() == []
    assert [(c.sensor, c.kind) for c in claims.pending()] == [("radar", "isolated"), ("theo", "accepted")]


def test_claims_settle_in_order_of_time():
    shots = [verdict(t_ns=t) for t in (30, 10, 20)]
    far = verdict(t_ns=HOLD_NS + 31, position=None)
    assert [claim.t_ns for claim in settled_after(*shots, far)] == [10, 20, 30]
