"""Stale machine code goes, fresh stays."""

import os

from gcs.compiled import drop_stale


def test_a_newer_source_takes_all_compiled_files_with_it(tmp_path):
    cache = tmp_path / "__pycache__"
    cache.mkdir()
    for name, stamp in (("a.py", 100), ("b.py", 100)):
        (tmp_path / name).touch()
        os.utime(tmp_path / name, (stamp, stamp))
    for name in ("a.nbi", "a.1.nbc", "b.nbi", "a.pyc"):
        (cache / name).touch()
        os.utime(cache / name, (200, 200))
    drop_stale(tmp_path)
    assert len(list(cache.iterdir())) == 4
    os.utime(tmp_path / "b.py", (300, 300))
    drop_stale(tmp_path)
    assert [file.name for file in cache.iterdir()] == ["a.pyc"]
