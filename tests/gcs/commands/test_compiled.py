"""Stale machine code goes, fresh stays."""

import os

from gcs.commands.compiled import drop_stale


def test_a_newer_source_takes_all_compiled_files_with_it(tmp_path):
    cache = tmp_path / "models" / "__pycache__"
    cache.mkdir(parents=True)
    for name in ("models/a.py", "b.py"):
        (tmp_path / name).touch()
        os.utime(tmp_path / name, (100, 100))
    for name in ("a.nbi", "a.1.nbc", "b.nbi", "a.pyc"):
        (cache / name).touch()
        os.utime(cache / name, (200, 200))
    drop_stale(tmp_path)
    assert len(list(cache.iterdir())) == 4
    os.utime(tmp_path / "b.py", (300, 300))
    drop_stale(tmp_path)
    assert [file.name for file in cache.iterdir()] == ["a.pyc"]
