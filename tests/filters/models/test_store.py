"""Records in memory: numbered as they came, copied, and forgotten from the oldest on."""

import numpy as np

from filters.models.store import InMemory

KIND = np.dtype([("t", "i8"), ("x", "f8", (2,))])


def records(begin, end):
    made = np.zeros(end - begin, KIND)
    made["t"], made["x"] = np.arange(begin, end), np.arange(begin, end)[:, None] + [0.25, 0.5]
    return made


def filled(*counts):
    store, size = InMemory(KIND), 0
    for count in counts:
        store.append(records(size, size + count))
        size += count
    return store


def test_they_are_numbered_as_they_came():
    store = filled(1, 0, 70, 500)
    assert len(store) == 571
    assert np.array_equal(store.whole(), records(0, 571))
    assert np.array_equal(store.read(60, 80), records(60, 80))
    assert not len(store.read(5, 5))


def test_what_came_is_a_copy():
    store, mine = InMemory(KIND), records(0, 3)
    store.append(mine)
    mine["t"] = -1
    assert store.whole()["t"].tolist() == [0, 1, 2]


def test_what_is_dropped_is_the_oldest():
    store = filled(100)
    store.drop(30)
    assert np.array_equal(store.whole(), records(30, 100))
    store.append(records(100, 400))
    assert np.array_equal(store.read(0, 370), records(30, 400))
