"""The import rules of the project, held by reading the code."""

import ast
import subprocess
import sys
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parents[1]
OURS = {"gcs", "bridges", "filters", "web"}
FILES = sorted(path for name in OURS for path in (ROOT / name).glob("**/*.py"))
MAY_IMPORT = {
    "filters": {"filters"},
    "bridges": {
        "bridges",
        "gcs.contract.messages",
        "gcs.contract.bus",
        "filters.simulation",
    },
    "web": {"web", "gcs.contract.messages", "gcs.contract.bus"},
}
ONLY_IN = {
    "zenoh": {"gcs/contract/bus.py"},
    "viser": {"web/"},
    "torch": {"filters/correction/train.py"},
    "pymavlink": {"bridges/"},
}


def imports(path: Path) -> set[str]:
    """Every module that a file imports, wherever in it: ``from a import b`` counts as a.b and as a."""
    found = set()
    for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
        if isinstance(node, ast.Import):
            found |= {alias.name for alias in node.names}
        elif isinstance(node, ast.ImportFrom) and node.module:
            found |= {f"{node.module}.{alias.name}" for alias in node.names}
    return found


def starts(module: str, names: set[str]) -> bool:
    return any(module == name or module.startswith(name + ".") for name in names)


@pytest.mark.parametrize("path", FILES, ids=lambda path: str(path.relative_to(ROOT)))
def test_imports_go_downward(path):
    place = path.relative_to(ROOT)
    allowed = MAY_IMPORT.get(place.parts[0])
    for module in imports(path):
        if allowed and module.split(".")[0] in OURS:
            assert starts(module, allowed), f"{place} imports {module}"
        if place.parts[0] == "bridges" and module.startswith("filters"):
            assert place.name == "simulated.py", f"{place} imports {module}"
        for vendor, places in ONLY_IN.items():
            if module.split(".")[0] == vendor:
                assert any(str(place).startswith(p) for p in places), f"{place} imports {module}"


def test_commands_start_light():
    """What a command may not need is imported late: these cost seconds."""
    heavy = {"torch", "viser", "zenoh", "numba", "filterpy", "pymavlink", "pymap3d"}
    code = f"import sys, gcs.commands.cli; print(*sorted(set(sys.modules) & {heavy}))"
    loaded = subprocess.run(
        [sys.executable, "-c", code], capture_output=True, text=True, check=True, cwd=ROOT
    )
    assert loaded.stdout.split() == []


def test_vocabulary_and_filters_agree():
    from filters.models import rows
    from gcs.contract import messages

    assert rows.CHANNELS == messages.CHANNELS
    assert rows.VERDICTS == messages.VERDICTS
