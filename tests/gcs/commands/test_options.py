"""What commands share: a run folder is never written over."""

from pathlib import Path

import pytest

from gcs.commands.options import new_file, run_folder
from gcs.contract.messages import InputError


def test_an_earlier_run_keeps_its_folder(tmp_path, capsys):
    out = tmp_path / "run.a"
    assert run_folder(out) == out
    assert run_folder(out) == out  # empty: nothing to lose
    assert capsys.readouterr().err == ""
    (out / "track.csv").touch()
    assert run_folder(out) == tmp_path / "run.a-2"
    line = capsys.readouterr().err
    assert f"{out} is not empty" in line
    assert f"{tmp_path / 'run.a-2'}" in line
    (tmp_path / "run.a-2" / "anything").touch()
    assert run_folder(out) == tmp_path / "run.a-3"
    assert (out / "track.csv").exists()


def test_a_folder_without_a_name_of_its_own(tmp_path, monkeypatch):
    (tmp_path / "here" / "below").mkdir(parents=True)
    monkeypatch.chdir(tmp_path / "here")
    assert run_folder(Path(".")) == tmp_path / "here-2"
    assert run_folder(Path("below/..")) == tmp_path / "here-2"
    with pytest.raises(InputError, match="name a folder"):
        run_folder(Path("/"))


@pytest.mark.parametrize("name", ["file", "file/below", "x" * 300, "nul\0"])
def test_odd_folders_are_refused(tmp_path, name):
    (tmp_path / "file").touch()
    with pytest.raises(InputError, match="--out"):
        run_folder(tmp_path / name)


def test_a_new_file_is_new(tmp_path):
    assert new_file(tmp_path / "link.tlog") == tmp_path / "link.tlog"
    for path in (tmp_path / "link.tlog", tmp_path / "nowhere" / "link.tlog", tmp_path / "nul\0"):
        with pytest.raises(InputError, match="name a new file"):
            new_file(path)
