"""What the bus refuses to carry."""

import msgspec
import pytest

from gcs.contract.messages import PolarMeasurement, decode, encode, to_columns


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
