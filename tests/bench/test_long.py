"""A long flight, in short: what the live session keeps does not grow, and nothing is left open."""

import itertools

import pytest

from bench.speed import long


@pytest.mark.slow
def test_a_flight_leaves_no_handle_and_no_thread(capsys):
    found = long.run(12.0, trace=False)
    assert (found["handles"], found["threads"]) == (0, 0)
    assert len(capsys.readouterr().out.splitlines()) == long.PARTS + 2


def test_what_is_flown_is_planned_in_order_and_only_as_it_is_asked_for():
    began = list(long.planned(7, 2.0))
    assert began == sorted(began)
    assert [sum(name == of for _, name in began) for of in long.RATES_HZ] == [70, 40, 40, 40, 40]
    endless = long.planned(7, 1e15)
    assert list(itertools.islice(endless, len(began))) == began
