"""The outbox: in order, none lost at the end, and nobody waits for a reader that stalls."""

import threading
import time

from gcs.outputs import outbox
from gcs.outputs.outbox import Outbox
from tests.gcs.contract.ends import until


class Reader:
    """Where messages go; it can stall and fail."""

    def __init__(self, fails=()):
        self.got, self.go_on, self._fails = [], threading.Event(), fails
        self.go_on.set()

    def __call__(self, subject, message, source):
        self.go_on.wait(10.0)
        if message in self._fails:
            raise ConnectionError("closed")
        self.got.append(message)


def running(box: Outbox) -> tuple[threading.Event, threading.Thread]:
    stop = threading.Event()
    thread = threading.Thread(target=box.run, args=(stop,))
    thread.start()
    return stop, thread


def test_messages_arrive_in_order_and_all_before_the_end():
    reader = Reader()
    box = Outbox(reader)
    stop, thread = running(box)
    for number in range(5_000):
        box("state", number)
    stop.set()
    thread.join(10.0)
    assert reader.got == list(range(5_000))


def test_nobody_waits_for_a_reader_that_stalls_and_memory_is_bounded(monkeypatch, caplog):
    monkeypatch.setattr(outbox, "MOST", 100)
    reader = Reader()
    reader.go_on.clear()
    box = Outbox(reader)
    stop, thread = running(box)
    box("state", -1)
    assert until(lambda: not box._waiting)  # the reader has the first, and keeps it
    began = time.process_time()
    for number in range(1_000):
        box("state", number)
    assert time.process_time() - began < 5.0
    assert box.dropped == 900
    reader.go_on.set()
    stop.set()
    thread.join(10.0)
    assert reader.got == [-1, *range(900, 1_000)]
    assert "publishing is stalled" in caplog.text


def test_one_that_cannot_be_sent_costs_itself_only():
    reader = Reader(fails=(1,))
    box, stop = Outbox(reader), threading.Event()
    for number in range(4):
        box("state", number)
    stop.set()
    try:
        box.run(stop)
    except ConnectionError:
        box.run(stop)
    assert reader.got == [0, 2, 3]
