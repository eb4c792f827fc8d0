"""The window waits while two explanations are close, and no longer than that helps."""

import numpy as np
import pytest

from filters import methods
from filters.smoother import bank, estimator, gated
from filters.smoother.bank import PROOF_NS, Bank, Trial
from tests.filters.smoother.kit import small
from tests.filters.smoother.kit.flights import SENSORS, finals

decision = pytest.mark.decision  # all but the longest run are looked at without numba, too
LAG_NS, CELL_NS = 1_000_000_000, 250_000_000


@pytest.fixture(autouse=True)
def _rows_enough(monkeypatch):
    """These windows have few rows: challenging each would take long without numba, and is not of this."""
    for module in (bank, estimator):
        monkeypatch.setattr(module, "FEW_ROWS", 0)


def flown(seconds=6.0):
    """(oldest row that is not decided yet at the end of each step, age in ns; all verdicts)."""
    rows = small.fly(SENSORS, seconds)
    one, ages, verdicts = methods.make("default", SENSORS), [], []
    for part in np.array_split(rows, 40):
        verdicts.append(one.step(part)[2])
        buffer = one._buffer
        left = buffer.view(buffer.decided, buffer.done).t
        ages.append(left[-1] - left[0])
    return np.array(ages), np.concatenate([*verdicts, one.finish()[2]])


@decision
def test_all_is_decided_one_lag_later():
    ages, _ = flown()
    assert ages.max() <= LAG_NS + 2 * CELL_NS


def test_nothing_is_decided_while_two_are_close_and_all_is_in_the_end(monkeypatch):
    monkeypatch.setattr(Bank, "undecided", property(lambda self: True))
    ages, verdicts = flown()
    assert PROOF_NS <= ages.max() <= LAG_NS + PROOF_NS + 2 * CELL_NS
    assert len(finals(verdicts)) == len(small.fly(SENSORS, 6.0))


@decision
def test_where_neither_explains_the_window_waiting_does_not_help():
    one = methods.make("default", SENSORS)
    one.step(small.fly(SENSORS, 3.0))
    main = one._window.now.banks[0]
    assert not main.undecided
    main.alternative = Trial(0.0, main.best.copy())
    main.best.shortfall = 0.0
    assert main.undecided
    main.best.shortfall = bank.WRONG
    assert not main.undecided


@decision
def test_the_banks_without_a_sensor_take_turns(monkeypatch):
    """All at once would be the longest wait for a state; so would be one beside the incumbent."""
    one, looked, redecide = methods.make("default", SENSORS), [], Bank.redecide

    def look(bank, rows, *given):
        looked.append((bank.excluded, int(rows.t[-1]) // estimator.CELL_NS))
        return redecide(bank, rows, *given)

    monkeypatch.setattr(Bank, "redecide", look)
    one.step(small.fly(SENSORS, 6.0))  # all is well, so there are no surprises
    turns = [k for k, _ in looked if k >= 0]
    for k in range(len(SENSORS)):
        at = np.flatnonzero(np.array(turns) == k)
        assert len(at) >= 2
        assert (np.diff(at) == len(SENSORS)).all()
    cells = [cell for _, cell in looked[1:]]
    assert len(set(cells)) == len(cells)


@decision
@pytest.mark.parametrize("waited", [1, 3])
def test_who_was_surprised_goes_first_but_for_one_that_has_waited_a_round_longer(waited):
    one = methods.make("default", SENSORS)
    one.step(small.fly(SENSORS, 3.0))
    now, window = one._window.now, one._window
    now.looked = tuple(now.turn - waited - (k == 0) * (1 + k) for k in range(len(SENSORS)))
    now.banks[3].best.surprise = gated.SURPRISE + 1.0
    before = now.looked
    window.take_turn()
    assert [k for k in range(len(SENSORS)) if now.looked[k] != before[k]] == [2]
    now.looked = (now.turn - len(SENSORS) - 3, *now.looked[1:])
    now.banks[3].best.surprise = gated.SURPRISE + 1.0
    window.take_turn()
    assert now.looked[0] == now.turn


@decision
def test_an_alternative_sees_the_same_rows_and_ends_where_they_are_decided():
    one = methods.make("default", SENSORS)
    rows = small.fly(SENSORS, 4.0)
    before = rows["t_ns"] < 3_100_000_000
    one.step(rows[before])
    main = one._window.now.banks[0]
    main.alternative = Trial(0.0, main.best.copy())
    same = (rows["t_ns"] >= 3_100_000_000) & (rows["t_ns"] < 3_200_000_000)
    one.step(rows[same])
    assert len(main.alternative.hypothesis.own.weight) == len(main.best.own.weight)
    assert main.alternative.hypothesis.head.t_ns == main.best.head.t_ns
    one.step(rows[rows["t_ns"] >= 3_200_000_000])
    assert main.alternative is None


@decision
def test_a_copy_of_a_bank_has_an_alternative_of_its_own():
    one = methods.make("default", SENSORS)
    one.step(small.fly(SENSORS, 3.0))
    main = one._window.now.banks[0]
    main.alternative = Trial(-1.0, main.best.copy())
    other = main.copy()
    assert other.alternative.prior == -1.0
    other.alternative.hypothesis.own.weight[:] = 0.0
    assert main.alternative.hypothesis.own.weight.any()
    other.forget()
    assert other.alternative is None
    assert main.alternative is not None
