"""Pieces of text."""

from web.look import html


def test_the_clock_is_utc_with_tenths():
    assert html.clock(1_790_000_000_250_000_000) == "14:13:20.2"  # date -u -d @1790000000


def test_what_is_copied_is_text():
    assert "<b>" not in html.copied("<b>1</b>")


def test_a_table_has_a_row_each():
    assert html.table([["a", "b"], ["c", "d"]], ("x", "y")).count("<tr>") == 3


def test_coloured_words_take_some_of_the_ink_of_the_page():
    assert "currentColor" in html.inked("late", (214, 140, 0))
    assert html.inked("late", None) == "late"
