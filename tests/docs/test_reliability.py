"""Every row of docs/reliability.md names tests, and each of them exists."""

import ast
import re
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parents[2]
TEXT = (ROOT / "docs" / "reliability.md").read_text(encoding="utf-8")
ROWS = [
    [cell.strip() for cell in line.strip("|").split(" | ")]
    for part in TEXT.split("| what happens | what is promised | shown by |\n|---|---|---|\n")[1:]
    for line in part.split("\n\n")[0].splitlines()
]


def names_in(file: str) -> set[str]:
    path = ROOT / "tests" / file
    assert path.is_file(), f"no file tests/{file}"
    return {
        n.name
        for n in ast.walk(ast.parse(path.read_text(encoding="utf-8")))
        if isinstance(n, ast.FunctionDef)
    }


@pytest.mark.parametrize("row", ROWS, ids=lambda row: row[0][:60])
def test_a_promise_is_shown_by_tests_that_exist(row):
    _, promised, shown = row
    named = re.findall(r"`([\w/]+\.py)::(\w+)`", shown)
    assert promised
    assert len(named) == shown.count("::") >= 1
    for file, name in named:
        assert name.startswith("test_")
        assert name in names_in(file), f"tests/{file} has no {name}"


def test_the_page_has_its_parts():
    assert len(ROWS) > 15
    for heading in ("Who and what is expected", "What is not promised", "How it is tried"):
        assert f"\n## {heading}\n" in TEXT
