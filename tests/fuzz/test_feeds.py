"""Every decoder against hostile input, short: `make fuzz` hunts longer. What was found once stays here."""

import json
from decimal import Decimal, InvalidOperation
from fractions import Fraction

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from pymavlink.dialects.v20 import ardupilotmega as dialect

from bridges import feed, radar
from bridges.instant import time_ns
from bridges.mavlink.decoder import Decoder
from gcs.contract import limits
from gcs.contract.messages import Bad, PolarMeasurement
from tests.fuzz import feeds, texts

COUNT = {
    "csv": 40,
    "datagram": 200,
    "payload": 2_000,
    "frames": 100,
    "station": 40,
    "override": 60,
    "stamp": 2_000,
}
FOUND = {  # target → inputs that once came through wrongly, and why
    "override": [
        b"ins.geoid_s\x81paration_m=true",  # no UTF-8: UnicodeEncodeError
        b"sensor.radar-1.position.alt_m=\xed\xa0\x80",
        b"bus.mode=\r\n\r\nbus.mode=\r\n",  # a refusal of several lines
    ],
}
SETTINGS = settings(max_examples=100, deadline=None, derandomize=True)
VALUES = st.none() | st.booleans() | st.floats() | st.integers() | st.text()
STAMPS = st.decimals() | st.decimals(9 * 10**8, 42 * 10**8) | st.sampled_from(texts.TOKENS)
NAN = float("nan")


@pytest.mark.parametrize("name", feeds.TARGETS)
def test_hostile_input_costs_itself_alone(name):
    for seed in range(COUNT[name]):
        data = feeds.made(name, seed)
        assert feeds.TARGETS[name].wrong(data) == "", f"seed {seed}: {data[:200]!r}"


@pytest.mark.parametrize(("name", "data"), [(name, data) for name, all_ in FOUND.items() for data in all_])
def test_what_was_found_once_is_mended(name, data):
    assert feeds.TARGETS[name].wrong(data) == ""


def test_air_data_that_is_no_number_is_refused():
    """It used to be sent, as null where the reader needs a number: none of ours at the other end."""
    decoder = Decoder(1)
    sent = [
        dialect.MAVLink_airspeed_message(0, 20.0, 2000, 10.0, 0),
        dialect.MAVLink_attitude_message(1, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0),
        dialect.MAVLink_vfr_hud_message(NAN, 20.0, 0, 0, 600.0, 0.0),
        dialect.MAVLink_attitude_message(2, NAN, 0.0, 0.0, 0.0, 0.0, 0.0),
        dialect.MAVLink_vfr_hud_message(20.0, 20.0, 0, 0, 600.0, 0.0),
    ]
    link = dialect.MAVLink(None, srcSystem=1, srcComponent=1)
    received = dialect.MAVLink(None).parse_buffer(b"".join(message.pack(link) for message in sent))
    found = [one for message in received for one in decoder.decode(message, feeds.ARRIVAL_NS)]
    found += decoder.flush()  # it waits for a SYSTEM_TIME
    assert [type(message) for message in found] == [Bad, Bad]


@pytest.mark.parametrize("name", feeds.TARGETS)
def test_the_generators_reach_behind_the_first_check(name):
    """A generator whose every input is refused at once would prove nothing; so would one never refused."""
    made = [feeds.made(name, seed) for seed in range(100)]
    assert len(set(made)) > 20
    if name == "datagram":
        results = [message for data in made for message in radar.decode(data, 1, "radar-1", "udp")]
        good = sum(isinstance(message, PolarMeasurement) for message in results)
        assert 0.1 < good / len(results) < 0.9
    if name == "stamp":
        assert 0 < sum(time_ns(data.decode(errors="replace")) is not None for data in made) < 100


@SETTINGS
@given(STAMPS)
def test_a_stamp_is_exact_or_refused(value):
    """Against exact fractions: the nanosecond below, inside the years that can be."""
    try:
        number = Decimal(value)
        expected = int(Fraction(number) * 10**9) if number.is_finite() else None
    except InvalidOperation:
        expected = time_ns(str(value))  # ISO 8601, or none: only its limits can be told
    inside = expected is not None and limits.FIRST_NS <= expected < limits.LAST_NS
    assert time_ns(str(value)) == (expected if inside else None)


@SETTINGS
@given(
    st.dictionaries(
        st.sampled_from(feed.COLUMNS), st.none() | st.booleans() | st.floats() | st.integers() | st.text()
    )
)
def test_any_object_is_a_measurement_or_says_why_not(fields):
    found = radar.decode(json.dumps(fields).encode(), 1, "radar-1", "udp #1")
    assert found
    for message in found:
        assert isinstance(message, Bad) or limits.FIRST_NS <= message.t_ns < limits.LAST_NS
        for name, (low, high) in feed.LIMITS.items():
            value = getattr(message, name, None)
            assert value is None or low <= value <= high
