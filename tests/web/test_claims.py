"""Which claim becomes a raw point and which an outlier."""

from gcs.contract.messages import Verdict
from web.claims import ACCEPTED, HOLD_NS, MISJUDGED, MISPLACED, Claims


def verdict(t_ns=0, sensor="radar", channel="range", word="used", position=(1.0, 2.0, 3.0)) -> Verdict:
    return Verdict(
        t_ns=t_ns,
        sensor=sensor,
        channel=channel,
        value=1.0,
        predicted=1.0,
        sigma=1.0,
        weight=1.0,
        verdict=word,
        reason="",
        position_enu_m=position,
    )


def settled_after(*verdicts: Verdict) -> list:
    settled = []
    claims = Claims(lambda *claim: settled.append(claim))
    for each in verdicts:
        claims.take(each)
    claims.settle()
    return settled


LATER = verdict(t_ns=HOLD_NS + 1, sensor="clock", position=None)


def test_one_refused_channel_makes_an_outlier():
    shots = [verdict(channel="range", position=None), verdict(channel="azimuth", word="patch"), LATER]
    assert settled_after(*shots) == [("radar", (1.0, 2.0, 3.0), MISPLACED)]


def test_a_refused_rate_leaves_the_place_standing():
    shots = [verdict(channel="range"), verdict(channel="range_rate", word="isolated"), LATER]
    assert settled_after(*shots)[0][2] == MISJUDGED


def test_a_revision_takes_the_outlier_back():
    assert settled_after(verdict(word="isolated"), verdict(word="used"), LATER) == [
        ("radar", (1.0, 2.0, 3.0), ACCEPTED)
    ]


def test_a_duplicate_does_not_condemn_the_original():
    assert settled_after(verdict(), verdict(word="duplicate"), LATER)[0][2] == ACCEPTED


def test_nothing_settles_while_it_may_be_revised():
    claims = Claims(lambda *claim: pytest_fail(claim))
    claims.take(verdict(word="isolated"))
    claims.take(verdict(t_ns=HOLD_NS, sensor="theo"))
    claims.settle()
    assert [(sensor, kind) for sensor, _, kind in claims.pending()] == [
        ("radar", MISPLACED),
        ("theo", ACCEPTED),
    ]


def pytest_fail(claim) -> None:
    raise AssertionError(f"{claim} settled too early")


def test_claims_settle_in_order_of_time():
    shots = [verdict(t_ns=t, position=(t, 0, 0)) for t in (30, 10, 20)]
    far = verdict(t_ns=HOLD_NS + 31, position=None)
    assert [position[0] for _, position, _ in settled_after(*shots, far)] == [10, 20, 30]
