"""What is final of a flight, on the disk: nothing is missing whatever that does, and nothing is left over."""

import os
import subprocess
import sys
import threading
import time

import numpy as np
import pytest

from filters import methods
from filters.models.settings import Settings
from filters.models.store import InMemory
from filters.smoother import buffer
from gcs.station import scratch
from gcs.station.scratch import OnDisk, Scratch
from tests.filters.scenes import run, scene

KIND = np.dtype([("t", "i8"), ("P", "f8", (2, 2))])
FULL = OSError(28, "No space left on device")
WAIT_S = 30.0


def records(begin: int, end: int) -> np.ndarray:
    some = np.zeros(end - begin, KIND)
    some["t"] = np.arange(begin, end)
    some["P"] = some["t"][:, None, None] / 7
    return some


def holds(store, size: int) -> bool:
    """All of it, whole, in its middle and at its edges."""
    spans = ((0, size), (0, 0), (size, size), (3, size - 3), (size // 2, size // 2 + 1))
    return len(store) == size and all(
        np.array_equal(store.read(begin, end), records(begin, end)) for begin, end in spans
    )


@pytest.fixture
def place(tmp_path, monkeypatch):
    """A scratch below a folder, and what the operator was told of it."""
    monkeypatch.setattr(scratch, "PERIOD_S", 0.001)
    monkeypatch.setattr(scratch, "RETRY_S", 0.001)
    monkeypatch.setattr(scratch, "PATIENCE_S", 0.1)
    told = []
    with Scratch(tmp_path, lambda level, text: told.append((level, text))) as made:
        yield made, told


def until(there) -> None:
    end_s = time.monotonic() + WAIT_S
    while not there():
        assert time.monotonic() < end_s
        time.sleep(0.001)


@pytest.mark.parametrize("make", [lambda _: InMemory(KIND), lambda folder: OnDisk(folder, KIND)])
def test_it_gives_back_what_came_whether_written_or_not(make, tmp_path):
    store, size = make(tmp_path), 0
    for count in (1, 40, 0, 500, 7):
        store.append(records(size, size + count))
        size += count
        if count == 40 and isinstance(store, OnDisk):
            store.write()
    assert holds(store, size)


def test_what_is_written_leaves_the_memory(place, tmp_path):
    made, told = place
    store = made.keep(KIND)
    store.append(records(0, 1000))
    until(lambda: not len(store._waiting))
    assert holds(store, 1000)
    assert isinstance(store.whole().base, np.memmap)
    assert np.array_equal(store.whole(), records(0, 1000))
    assert (told, list(tmp_path.iterdir())) == ([], [])  # and it has no name


def test_a_disk_that_refuses_costs_memory_alone_and_is_told_once(place, monkeypatch):
    made, told = place
    real, tries = os.pwrite, []

    def torn(descriptor, block, at):
        """A few bytes more, then full, nine times."""
        tries.append(at)
        if len(tries) < 20 and len(tries) % 2:
            return real(descriptor, block[:5], at)
        if len(tries) < 20:
            raise FULL
        return real(descriptor, block, at)

    monkeypatch.setattr(os, "pwrite", torn)
    store = made.keep(KIND)
    store.append(records(0, 10))
    until(lambda: told)
    store.append(records(10, 1000))
    assert holds(store, 1000)
    assert np.array_equal(store.whole(), records(0, 1000))
    until(lambda: not len(store._waiting))
    assert holds(store, 1000)
    assert len(told) == 1
    assert "No space left on device" in told[0][1]


def test_a_folder_that_cannot_be_written_to_costs_memory_alone(tmp_path):
    told = []
    with Scratch(tmp_path / "gone", lambda *said: told.append(said)) as made:
        for _ in range(2):
            store = made.keep(KIND)
            store.append(records(0, 100))
            assert holds(store, 100)
    assert len(told) == 1


def test_nobody_waits_for_a_disk_that_hangs(place, monkeypatch):
    made, _ = place
    hangs, go_on, real = threading.Event(), threading.Event(), os.pwrite

    def slow(*arguments):
        hangs.set()
        go_on.wait(WAIT_S)
        return real(*arguments)

    monkeypatch.setattr(os, "pwrite", slow)
    store = made.keep(KIND)
    store.append(records(0, 10))
    assert hangs.wait(WAIT_S)
    store.append(records(10, 500))
    assert holds(store, 500)
    assert np.array_equal(store.whole(), records(0, 500))
    go_on.set()
    until(lambda: not len(store._waiting))
    assert holds(store, 500)


def test_a_killed_process_leaves_no_file(tmp_path):
    killed = (
        "import os, signal, sys, numpy as np\n"
        "from pathlib import Path\n"
        "from gcs.station.scratch import OnDisk\n"
        "store = OnDisk(Path(sys.argv[1]), np.dtype([('t', 'i8')]))\n"
        "store.append(np.zeros(100_000, [('t', 'i8')]))\n"
        "store.write()\n"
        "os.kill(os.getpid(), signal.SIGKILL)\n"
    )
    assert subprocess.run([sys.executable, "-c", killed, str(tmp_path)], check=False).returncode == -9
    assert list(tmp_path.iterdir()) == []


def test_a_store_that_nobody_holds_is_closed(tmp_path):
    def handles() -> int:
        return len(os.listdir("/proc/self/fd"))

    before = handles()
    store = OnDisk(tmp_path, KIND)
    assert handles() == before + 1
    del store
    assert handles() == before


def test_an_estimator_says_the_same_wherever_its_past_is(place, monkeypatch):
    monkeypatch.setattr(buffer, "BLOCK", 256)
    made, _ = place
    _, used, rows, _ = scene(3, share=0.05, seconds=12.0)
    said = []
    for keep in (InMemory, made.keep):
        estimator = methods.make("default", used, Settings(lateness_s=1.0), keep=keep)
        said.append((*run(estimator, rows, batch=100), estimator.smooth()))
    assert all(a.tobytes() == b.tobytes() for a, b in zip(*said, strict=True))
