"""Files of a run on a disk that is full, slow, or taken away: nothing raised, nothing torn, all counted."""

import os
import resource
import shutil
import threading
import time
from contextlib import contextmanager

import pytest

from gcs.outputs import disk
from gcs.outputs.disk import Beside, RunFile, replace


@pytest.fixture(autouse=True)
def at_once(monkeypatch):
    """A disk that refuses is tried at every write."""
    monkeypatch.setattr(disk, "RETRY_S", 0.0)
    monkeypatch.setattr(disk, "LAST_TRY_S", 0.01)


@contextmanager
def full_at(size: int):
    """Files of this process cannot grow beyond ``size`` bytes."""
    soft, hard = resource.getrlimit(resource.RLIMIT_FSIZE)
    resource.setrlimit(resource.RLIMIT_FSIZE, (size, hard))
    try:
        yield
    finally:
        resource.setrlimit(resource.RLIMIT_FSIZE, (soft, hard))


class Operator(list):
    """What the operator was told."""

    def __call__(self, level: str, text: str) -> None:
        self.append((level, text))


def test_a_disk_full_for_a_while_costs_nothing(tmp_path):
    told = Operator()
    file = RunFile(tmp_path / "track.csv", told)
    lines = [f"line {number}\n".encode() for number in range(100)]
    with full_at(123):  # in the middle of a line
        for line in lines[:50]:
            assert file.write(line)
        assert (tmp_path / "track.csv").stat().st_size == 123
    for line in lines[50:]:
        assert file.write(line)
    assert file.close()
    assert (tmp_path / "track.csv").read_bytes() == b"".join(lines)
    assert [level for level, _ in told] == ["error", "info"]
    assert "nothing is missing" in told[1][1]


def test_what_no_longer_fits_in_memory_is_whole_or_counted(tmp_path, monkeypatch):
    monkeypatch.setattr(disk, "WAITING_BYTES", 1000)
    told = Operator()
    file = RunFile(tmp_path / "verdicts.csv", told)
    block = b"a row\nanother\n" * 10
    with full_at(0):
        taken = sum(file.write(block, 20) for _ in range(10))
    assert 0 < taken < 10
    assert file.write(block, 20)
    assert file.close()
    assert (tmp_path / "verdicts.csv").read_bytes() == block * (taken + 1)
    assert file.lost == 20 * (10 - taken)
    assert str(file.lost) in told[-1][1]


def test_a_disk_that_stays_full_is_given_up_at_the_end(tmp_path):
    (tmp_path / "track.csv").symlink_to("/dev/full")
    told = Operator()
    file = RunFile(tmp_path / "track.csv", told)
    file.write(b"1\n2\n3\n", 3)
    file.write(b"4\n")
    assert not file.close()
    assert file.lost == 4
    assert told == [("error", f"{tmp_path}/track.csv: No space left on device; it is tried again every 0 s")]


def test_a_folder_that_is_taken_away_comes_back_whole(tmp_path):
    told = Operator()
    file = RunFile(tmp_path / "run" / "track.csv", told)
    file.write(b"lost?\n")
    assert "No such file" in told[0][1]  # the folder is made by whoever chooses it
    (tmp_path / "run").mkdir()
    file.write(b"1\n")
    shutil.rmtree(tmp_path / "run")
    file.write(b"2\n")
    assert (tmp_path / "run" / "track.csv").read_bytes() == b"lost?\n1\n2\n"
    shutil.rmtree(tmp_path / "run")
    (tmp_path / "run").write_text("in the way")
    file.write(b"3\n")
    (tmp_path / "run").unlink()
    file.write(b"4\n")
    assert file.close()
    assert (tmp_path / "run" / "track.csv").read_bytes() == b"lost?\n1\n2\n3\n4\n"


def test_nobody_elses_file_is_written_over(tmp_path):
    told = Operator()
    file = RunFile(tmp_path / "track.csv", told)
    file.write(b"1\n")
    (tmp_path / "track.csv").rename(tmp_path / "moved.csv")
    (tmp_path / "track.csv").write_text("another's\n")
    file.write(b"2\n")
    assert told[-1][0] == "error"
    file.close()
    assert (tmp_path / "track.csv").read_text() == "another's\n"


def test_replacing_a_file_keeps_the_old_one_until_it_is_done(tmp_path):
    path = tmp_path / "smoothed.csv"
    path.write_text("old")
    with full_at(5):
        assert replace(path, ["new and", " longer"])
    assert path.read_text() == "old"
    assert replace(path, ["new and", " longer"]) == ""
    assert path.read_text() == "new and longer"
    assert os.listdir(tmp_path) == ["smoothed.csv"]


def test_beside_keeps_order_and_refuses_what_it_has_no_room_for(monkeypatch):
    monkeypatch.setattr(disk, "WAITING_WORK", 10)
    beside, done, gate = Beside(int), [], threading.Event()
    assert beside.put(gate.wait)
    assert [beside.put(lambda n=n: done.append(n), 3) for n in range(5)] == [True, True, True, False, False]
    assert beside.put(lambda: done.append("end"), refuse=False)
    assert not beside.end(0.01)  # hangs
    gate.set()
    assert beside.end(10.0)
    assert done == [0, 1, 2, "end"]


def test_beside_has_all_the_time_for_what_goes_on():
    """The best estimate of a day takes longer to write than anybody waits for a disk that hangs."""
    beside, done, patience_s = Beside(int), [], 1.0

    def long_piece() -> None:
        for part in range(5):
            time.sleep(0.3)
            beside.goes_on()
            done.append(part)

    beside.put(long_piece)
    beside.wait(patience_s)
    assert len(done) == 5
    beside.put(long_piece)
    assert beside.end(patience_s)
    assert len(done) == 10


def test_beside_takes_one_piece_of_any_size(monkeypatch):
    """At the end of a run the rows of minutes may come at once."""
    monkeypatch.setattr(disk, "WAITING_WORK", 10)
    beside, done = Beside(int), []
    assert beside.put(lambda: done.append(1), 1_000)
    assert beside.end(10.0)
    assert done == [1]


def test_beside_leaves_the_processor_alone_until_it_is_woken(monkeypatch):
    monkeypatch.setattr(disk, "IDLE_S", 60.0)
    beside, done = Beside(int), threading.Event()
    assert beside.put(int)
    beside.wait(10.0)
    assert beside.put(done.set, wake=False)
    assert not done.wait(0.05)
    assert beside.put(int)
    assert done.wait(10.0)
    assert beside.end(10.0)


def test_beside_goes_on_after_a_fault_and_tells_it_once():
    beside, done = Beside(int), []
    beside.put(lambda: 1 / 0)
    beside.put(lambda: done.append(1))
    beside.wait(10.0)
    with pytest.raises(ZeroDivisionError):
        beside.check()
    beside.check()
    assert beside.end(10.0)
    assert done == [1]


def test_beside_uses_the_time_when_nothing_comes(monkeypatch):
    monkeypatch.setattr(disk, "IDLE_S", 0.001)
    idle = threading.Event()
    beside = Beside(idle.set)
    assert idle.wait(10.0)
    assert beside.end(10.0)
