"""A long flight, in short: what the live session keeps does not grow, and nothing is left open."""

import pytest

from bench.speed import long

pytestmark = pytest.mark.slow


def test_a_flight_leaves_no_handle_and_no_thread(capsys):
    found = long.run(12.0, trace=False)
    assert (found["handles"], found["threads"]) == (0, 0)
    assert len(capsys.readouterr().out.splitlines()) == long.PARTS + 2
