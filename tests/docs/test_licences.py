"""docs/licences.md is that of the lock files, and every licence in it is one that somebody has read."""

import importlib.metadata

import pytest

from docs import licences

ROWS = {
    cells[0]: cells[1:]
    for cells in (
        [cell.strip() for cell in line.strip("|\n").split("|")]
        for line in licences.PAGE.read_text(encoding="utf-8").splitlines()
        if line.startswith("| ") and not line.startswith("| package")
    )
}


def test_everything_that_is_locked_has_its_row():
    assert {name: row[0] for name, row in ROWS.items()} == licences.pins("test"), "python docs/licences.py"


def test_every_licence_is_known():
    assert {name: row[1] for name, row in ROWS.items() if row[1] not in licences.KNOWN} == {}


def test_what_a_run_needs_is_free():
    run = {row[1] for row in ROWS.values() if row[2] == "every run"}
    assert run & {"NVIDIA, for training only"} == set()
    assert len(run) > 3


@pytest.mark.parametrize("name", ["numpy", "pymavlink", "eclipse-zenoh", "viser", "msgspec"])
def test_the_page_is_what_the_package_says(name):
    assert importlib.metadata.metadata(name)
    assert ROWS[name][1] == licences.licence(name)


def test_an_unknown_licence_is_shown_as_it_is(monkeypatch):
    said = importlib.metadata.metadata("numpy")
    del said["License-Expression"]
    said["License-Expression"] = "LicenseRef-Ours-Alone"
    monkeypatch.setattr(importlib.metadata, "metadata", lambda _: said)
    assert licences.licence("numpy") == "LicenseRef-Ours-Alone"
