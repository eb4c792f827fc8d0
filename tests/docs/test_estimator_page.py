"""docs/estimator.md states the constants that the code has, and the sections one looks for."""

import importlib
import re
from pathlib import Path

import numpy as np
import pytest

ROOT = Path(__file__).resolve().parents[2]
TEXT = (ROOT / "docs" / "estimator.md").read_text(encoding="utf-8")
SECTIONS = ("Model", "Inference", "What is published", "Constants", "Tried and rejected", "Measured")
WORDS = {"log": np.log, "radians": np.radians, "pi": np.pi}
ELSEWHERE = {"REFRACTION", "BY_STATUS"}  # coefficients in the text; a rule without numbers


def table() -> dict[str, str]:
    """Name within ``filters`` → value as written."""
    part = TEXT.split("\n## Constants\n")[1].split("\n## ")[0]
    rows = [
        [cell.strip() for cell in line.split("|")[1:-1]] for line in part.splitlines() if "| `" in line[:4]
    ]
    assert all(len(row) == 4 and row[3] for row in rows)
    return {row[0].strip("`"): row[1] for row in rows}


@pytest.mark.parametrize("name", table())
def test_a_constant_of_the_page_is_that_of_the_code(name):
    module, _, constant = name.rpartition(".")
    found = getattr(importlib.import_module(f"filters.{module}"), constant)
    written = eval(table()[name], {"__builtins__": {}}, WORDS)
    assert np.shape(found) == np.shape(written)
    assert np.allclose(found, written, rtol=1e-12, atol=0.0), "change docs/estimator.md with the code"


def test_a_constant_of_the_code_is_on_the_page():
    """Those that are written with a fraction or an exponent: whole numbers are mostly names."""
    fraction, missing = re.compile(r"\d\.\d|\de-?\d"), []
    for path in sorted((ROOT / "filters").glob("*/*.py")):
        if path.parent.name not in ("models", "smoother"):
            continue
        for line in path.read_text(encoding="utf-8").splitlines():
            left, _, right = line.partition(" = ")
            if re.fullmatch(r"[A-Z][A-Z0-9_, ]+", left) and fraction.search(right):
                missing += [f"{path.parent.name}.{path.stem}.{name}" for name in left.split(", ")]
    missing = [name for name in missing if name not in table()]
    assert [name for name in missing if name.rpartition(".")[2] not in ELSEWHERE] == []


def test_every_section_is_there():
    found = re.findall(r"^## (.*)$", TEXT, re.MULTILINE)
    assert [name for name in SECTIONS if name not in found] == []
