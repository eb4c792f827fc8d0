"""When the bell rings."""

from types import SimpleNamespace

from web.panel.bell import Bell


def bell(*, on: bool) -> tuple[Bell, SimpleNamespace]:
    box, sound = SimpleNamespace(value=on), SimpleNamespace(content="")
    gui = SimpleNamespace(add_checkbox=lambda *_, **__: box, add_html=lambda *_: sound)
    return Bell(gui), sound


def heard(*alarms: int, on: bool = True) -> int:
    """How often it rang for these numbers of broken limits, one after another."""
    one, sound = bell(on=on)
    contents = []
    for count in alarms:
        one.update(count)
        contents.append(sound.content)
    return len(set(contents) - {""})


def test_each_further_limit_that_breaks_is_heard_once():
    assert heard(0, 1, 1, 1) == 1
    assert heard(0, 1, 3, 2, 3) == 3
    assert heard(2, 1, 0) == 1


def test_off_it_is_silent():
    assert heard(0, 1, 2, on=False) == 0


def test_what_was_broken_before_it_was_turned_on_is_not_told_again():
    one, sound = bell(on=False)
    one.update(2)
    one._on.value = True
    one.update(2)
    assert sound.content == ""
