"""What happens to the station is written to its log, and told once."""

import logging
import threading
from logging.handlers import RotatingFileHandler

import pytest

from gcs.contract.messages import Event
from gcs.contract.supervision import log
from gcs.outputs import log as logbook
from tests.gcs.contract.ends import until


@pytest.fixture
def told():
    return []


@pytest.fixture
def book(tmp_path, told):
    with logbook.opened(tmp_path, [told.append]):
        yield tmp_path / "station.log"


def written(book, text: str, times: int = 1) -> bool:
    """A thread of its own writes it."""
    return until(lambda: book.read_text().count(text) == times)


def test_a_warning_is_an_event_a_line_and_in_the_file(book, told, capsys):
    log.warning("%s hangs", "radar")
    [event] = told
    assert (event.level, event.text) == ("warning", "radar hangs")
    assert "warning: radar hangs" in capsys.readouterr().err
    assert written(book, "Z WARNING MainThread: radar hangs\n")


def test_a_traceback_is_in_the_file_and_one_line_in_the_event(book, told):
    try:
        raise ZeroDivisionError("by nought")
    except ZeroDivisionError:
        log.exception("link failed")
    assert [event.text for event in told] == ["link failed"]
    assert written(book, 'raise ZeroDivisionError("by nought")')


def test_where_a_hung_part_stands_is_in_the_file(book, told):
    log.error("view hangs", extra={"stack": 'File "view.py", line 7\n'})
    assert written(book, 'File "view.py", line 7')
    assert "view.py" not in told[0].text


def test_nobody_waits_for_a_disk_that_hangs(book, told, monkeypatch):
    answers, emit = threading.Event(), RotatingFileHandler.emit

    def slow(handler, record):
        answers.wait(30.0)
        emit(handler, record)

    monkeypatch.setattr(RotatingFileHandler, "emit", slow)
    for text in ("radar hangs", "link failed"):
        log.warning(text)
    assert [event.text for event in told] == ["radar hangs", "link failed"]
    assert book.read_text() == ""
    answers.set()
    assert written(book, "link failed")


def test_the_same_line_is_told_once_and_written_each_time(book, told):
    for _ in range(50):
        log.error("disk is full")
    assert len(told) == 1
    assert written(book, "disk is full", 50)


def test_a_target_that_fails_costs_the_event_and_nothing_else(tmp_path):
    def broken(event):
        log.error("and this is no endless circle")
        raise ConnectionError("the bus is closed")

    with logbook.opened(tmp_path, [broken]):
        log.error("link failed")
    assert "could not be sent: link failed" in (tmp_path / "station.log").read_text()


def test_an_event_that_is_told_anyway_is_only_written(book, told):
    logbook.note(Event(t_ns=0, level="warning", text="radar-1 is silent"))
    assert told == []
    assert written(book, "WARNING MainThread: radar-1 is silent")


@pytest.mark.filterwarnings("ignore::pytest.PytestUnhandledThreadExceptionWarning")
def test_no_thread_dies_quietly(book, told):
    hook = threading.excepthook
    thread = threading.Thread(target=lambda: 1 // 0, name="player")
    thread.start()
    thread.join()
    assert [event.text for event in told] == [
        "thread player ended: ZeroDivisionError: integer division or modulo by zero"
    ]
    assert written(book, "in <lambda>")
    assert threading.excepthook is hook


def test_the_file_is_bounded(tmp_path, monkeypatch):
    monkeypatch.setattr(logbook, "FILE_BYTES", 2_000)
    with logbook.opened(tmp_path, []):
        for number in range(1_000):
            log.info("line %d", number)
    sizes = [path.stat().st_size for path in tmp_path.iterdir()]
    assert len(sizes) == 1 + logbook.FILES
    assert sum(sizes) <= 2_000 * len(sizes)
    assert "line 999" in (tmp_path / "station.log").read_text()


def test_a_full_disk_costs_the_line(tmp_path, told, capsys):
    (tmp_path / "station.log").symlink_to("/dev/full")
    with logbook.opened(tmp_path, [told.append]):
        log.error("link failed")
    assert [event.text for event in told] == ["link failed"]
    assert "Traceback" not in capsys.readouterr().err


def test_afterwards_all_is_as_before(tmp_path):
    before = threading.excepthook, log.level, list(log.handlers)
    with logbook.opened(tmp_path, []):
        assert log.isEnabledFor(logging.INFO)
    assert (threading.excepthook, log.level, list(log.handlers)) == before
