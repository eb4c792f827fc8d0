"""Which limits are broken, and in which words."""

import msgspec

from gcs.contract.messages import Health, State
from tests.web.flight import messages
from web.panel.limits import OperatorLimits, alarms

FLOWN = [message for message, source in messages(3.0) if source == ""]
STATE = next(m for m in FLOWN if isinstance(m, State))
HEALTH = next(m for m in FLOWN if isinstance(m, Health))
HELD = msgspec.structs.replace(STATE, protection_h_m=3.0, protection_v_m=9.0)


def test_without_a_limit_the_position_alarms_nobody():
    assert not OperatorLimits().demanded
    assert alarms(OperatorLimits(), STATE, HEALTH) == []


def test_a_bound_beyond_its_limit_is_told_with_both_numbers():
    limits = OperatorLimits(protection_h_m=5.0, protection_v_m=5.0)
    assert limits.demanded
    assert alarms(limits, HELD, HEALTH) == ["height holds within 9.0 m, 5 m is demanded"]


def test_no_bound_is_no_better_than_a_large_one():
    assert alarms(OperatorLimits(protection_h_m=5.0), STATE, HEALTH) == [
        "position: nothing bounds the error, 5 m is demanded"
    ]


def test_doubt_and_failure_need_no_limit():
    doubted = msgspec.structs.replace(HELD, ambiguous=True, quality=-1)
    found = alarms(OperatorLimits(), doubted, HEALTH)
    assert "failed" in found[0]
    assert "two positions" in found[1]
    assert alarms(OperatorLimits(), None, None) == ["there is no position"]


def test_a_silent_and_a_refused_sensor_are_named():
    silent = msgspec.structs.replace(HELD, age_s={"radar-west": 7.0})
    assert alarms(OperatorLimits(), silent, HEALTH) == ["radar-west has said nothing for 7 s"]
    assert alarms(OperatorLimits(refused_share=0.05), HELD, HEALTH) == [
        "theo-south: 8% of the last 10 s refused"
    ]
    assert alarms(OperatorLimits(refused_share=0.0, silent_s=0.0), silent, HEALTH) == []
