"""What comes once a second is found again by its time."""

import msgspec

from gcs.contract.messages import Health
from tests.web.flight import START_NS, messages
from web.memory.spoken import Spoken

S = 1_000_000_000


def test_the_newest_up_to_a_time_as_it_was():
    kept, told = Spoken(Health), [m for m, _ in messages(5.0) if isinstance(m, Health)]
    week = msgspec.structs.replace(
        told[0], t_ns=START_NS + 604_800 * S
    )  # by the station's own clock, before data
    for health in (week, *told):
        kept.add(health.t_ns, health)
    assert kept.at(START_NS - 1) is None
    assert kept.at(START_NS + 3 * S - 1) == told[2]
    assert kept.at(START_NS + 99 * S) == told[-1]
    kept.clear()
    assert kept.at(START_NS + 99 * S) is None
