"""The messages on the wire: what older senders leave out has a meaning, what nobody can mean is refused."""

import json

import msgspec
import pytest
from msgspec.structs import replace

from gcs.contract.messages import JSON, MSGPACK, PolarMeasurement, decode, encode, to_columns
from tests.gcs.contract.ends import state


def test_a_state_of_an_older_station_decodes_and_tells_no_protection():
    payload, _ = encode(state(1))
    fields = json.loads(payload)
    for name in ("protection_h_m", "protection_v_m", "ambiguous"):
        del fields[name]
    old = decode(json.dumps(fields).encode())
    assert (old.protection_h_m, old.protection_v_m, old.ambiguous) == (None, None, False)


@pytest.mark.parametrize("media", [JSON, MSGPACK])
def test_doubt_goes_there_and_back(media):
    sent = replace(state(1), protection_h_m=3.25, protection_v_m=None, ambiguous=True)
    assert decode(*encode(sent, media)) == sent


@pytest.mark.parametrize("t_ns", [2**63 - 1, 2**63, 2**64 - 1, -(2**63), 10**400])
def test_a_time_that_overflows_is_refused_where_it_is_decoded(t_ns):
    payload = b'{"type":"PolarMeasurement","t_ns":%d,"arrival_ns":0}' % t_ns
    with pytest.raises(msgspec.ValidationError, match="t_ns"):
        decode(payload)


def test_a_value_may_bring_its_own_noise():
    one = PolarMeasurement(t_ns=1, arrival_ns=2, range_m=3.0, sigma_range_m=0.5)
    assert decode(*encode(one)) == one
    row = to_columns([one], PolarMeasurement)[0]
    assert row["sigma_range_m"] == 0.5
    assert row["sigma_azimuth_deg"] != row["sigma_azimuth_deg"]
