"""The book of rows against a plain dictionary."""

import numpy as np
import pytest

from filters.models.rows import ROW, USED
from filters.window.book import Book

pytestmark = pytest.mark.decision


def some(rng, n: int) -> np.ndarray:
    """Rows in any order, some of them twice."""
    rows = np.zeros(n, ROW)
    rows["id"], rows["value"] = np.arange(n), rng.normal(size=n)
    rows["t_ns"], rows["sensor"], rows["channel"] = rng.integers(0, (400, 3, 4), (n, 3)).T
    return rows


def test_rows_stand_in_order_and_the_first_of_equals_stays():
    rows = some(np.random.default_rng(0), 6000)
    book, known = Book(), {}
    twice = [int(i) for part in np.array_split(rows, 7) for i in book.enter(part)["id"]]
    again = [int(r["id"]) for r in rows if known.setdefault(tuple(r.item()[1:4]), r) is not r]
    assert sorted(twice) == again
    expected = [int(known[key]["id"]) for key in sorted(known)]
    assert book.span(0, book.size).part("id").tolist() == expected


def test_a_verdict_is_told_when_new_changed_and_final():
    book = Book()
    book.enter(some(np.random.default_rng(1), 50)[:9])
    book.rows.verdict[:9], book.done = USED, 6
    told = book.span(0, 6).part("id").tolist()
    assert book.changes()["id"].tolist() == told
    assert len(book.changes()) == 0
    book.rows.verdict[4] += 1
    book.final = 2
    changed = book.changes()
    assert changed["id"].tolist() == [told[k] for k in (0, 1, 4)]
    assert changed["final"].tolist() == [True, True, False]
    assert len(book.changes()) == 0


def test_a_span_can_be_put_back_as_it_was():
    book = Book()
    book.enter(some(np.random.default_rng(2), 30))
    span = book.span(5, 15)
    book.rows.weight[:30] = np.arange(30)
    before = span.judged()
    book.rows.weight[:30] = 0.0
    span.restore(before)
    assert book.rows.weight[:30].nonzero()[0].tolist() == list(range(5, 15))
    assert np.array_equal(span.part("weight"), np.arange(5, 15))
