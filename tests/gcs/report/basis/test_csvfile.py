"""Files of a run folder: whole, torn, damaged."""

import numpy as np
import pytest

from gcs.contract.messages import InputError
from gcs.report.basis import csvfile


def test_times_stay_whole_numbers_and_an_empty_field_is_nan(tmp_path):
    file = tmp_path / "a.csv"
    file.write_text("t_ns,x,y\n1795320734057433361,,2.5\n3,1.0,\n")
    rows, damaged = csvfile.numbers(file, ("t_ns", "x"))
    assert damaged == 0
    assert rows["t_ns"].tolist() == [1795320734057433361, 3]
    assert np.isnan(rows["x"][0])
    assert rows["y"][0] == 2.5
    assert np.isnan(rows["y"][1])


def test_a_torn_or_damaged_line_costs_that_line(tmp_path):
    file = tmp_path / "a.csv"
    file.write_text("t_ns,x\n1,1.0\nrubbish\n2,2.0\n3,\x00\x01\n4,4.0\n5")
    rows, damaged = csvfile.numbers(file, ("t_ns",))
    assert rows["t_ns"].tolist() == [1, 2, 4]
    assert damaged == 3


def test_a_file_longer_than_a_block(tmp_path, monkeypatch):
    monkeypatch.setattr(csvfile, "BLOCK", 7)
    file = tmp_path / "a.csv"
    file.write_text("t_ns,word\n" + "".join(f'{k},"a, {k}"\n' for k in range(20)) + "20\n")
    blocks = list(csvfile.texts(file, ("word", "t_ns")))
    assert [len(block.columns[0]) for block in blocks] == [7, 7, 6]
    assert sum(block.damaged for block in blocks) == 1
    assert blocks[1].columns[0][0] == "a, 7"
    assert blocks[1].columns[1][0] == "7"


def test_what_is_no_such_file_is_one_line(tmp_path):
    file = tmp_path / "a.csv"
    file.write_text("t_ns,x\n")
    with pytest.raises(InputError, match=r"a\.csv:1: no column y"):
        csvfile.numbers(file, ("t_ns", "y"))
    with pytest.raises(InputError, match="No such file"):
        list(csvfile.texts(tmp_path / "b.csv", ("t_ns",)))
    assert csvfile.optional(tmp_path / "b.csv", ("t_ns",)) is None
