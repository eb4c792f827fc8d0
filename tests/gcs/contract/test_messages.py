"""The messages on the wire: what older senders leave out has a meaning."""

import json

import pytest
from msgspec.structs import replace

from gcs.contract.messages import JSON, MSGPACK, decode, encode
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
