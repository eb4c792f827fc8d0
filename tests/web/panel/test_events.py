"""Events: which are shown, where the next one is."""

from web.panel import events

MOMENTS = {(10, "started"): "info", (30, "radar is silent"): "warning", (20, "theo: a patch"): "patch"}


def texts(level: str, upto_ns: int) -> list[str]:
    return [event.text for event in events.chosen(MOMENTS, level, upto_ns)]


def test_they_come_in_order_up_to_now_and_from_a_level_on():
    assert texts("all", 99) == ["started", "theo: a patch", "radar is silent"]
    assert texts("warnings", 25) == ["theo: a patch"]
    assert texts("errors", 99) == []


def test_the_neighbours_of_a_moment():
    assert events.neighbour(MOMENTS, {}, "all", 20, 1) == 30
    assert events.neighbour(MOMENTS, {}, "all", 20, -1) == 10
    assert events.neighbour(MOMENTS, {}, "warnings", 20, -1) is None


def test_a_mark_is_a_neighbour_whatever_the_level():
    assert events.neighbour(MOMENTS, {25: "reset", 5: "gap"}, "errors", 20, 1) == 25
    assert events.neighbour(MOMENTS, {25: "reset", 5: "gap"}, "errors", 20, -1) == 5


def test_the_slider_has_the_newest_marks_of_its_time_in_order():
    marks = {k * 10**9: "patch" for k in range(events.MOST_MARKS + 5)} | {90 * 10**9: "gap"}
    shown = events.on_slider(marks, 2 * 10**9, 44 * 10**9)
    assert (len(shown), shown[0], shown[-1]) == (events.MOST_MARKS, (3.0, "■"), (42.0, "■"))
    assert events.on_slider({7_260_000_000: "reset"}, 10**9, 8 * 10**9) == ((6.3, "↺"),)


def test_names_from_outside_are_text_not_html():
    bad = {(5, "<script>alert(1)</script>"): "info"}
    assert "<script>" not in events.listed(events.chosen(bad, "all", 9), [])
    assert "<script>" not in events.strip(bad, 0, 10, 5)


def test_the_newest_is_first_and_the_page_speaks_before_it():
    said = events.listed(events.chosen(MOMENTS, "all", 99), ["the view skipped 12 messages"])
    order = [said.index(text) for text in ("skipped 12", "radar is silent", "theo: a patch", "started")]
    assert order == sorted(order)
    assert "none yet" in events.listed([], [])


def test_a_mark_is_as_far_along_as_its_time():
    assert "left:25.00%" in events.strip({(20, "x"): "info"}, 10, 50, 10)
    assert "beyond" not in events.strip({(99, "beyond"): "info"}, 10, 50, 10)
