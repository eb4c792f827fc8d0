"""The rules of docs/architecture.md, held by reading the code."""

import ast
import re
import subprocess
import sys
from collections import Counter
from collections.abc import Iterator
from functools import cache
from pathlib import Path
from typing import NamedTuple

import pytest

ROOT = Path(__file__).resolve().parents[1]
PACKAGES = ("gcs", "bridges", "filters", "web", "bench")
LINES, FILES_IN_FOLDER, PARAMETERS = 300, 12, 8
KERNELS = {"njit", "kernel", "exact"}  # decorators: arrays and numbers only, so their lists of them are long
EXEMPT = {  # rule → folders that it does not hold
    "class names": ("bench/trials",),  # still being written, and so below
    "files in a folder": ("bench/trials",),
    "flags and annotations": ("bench/trials",),
    "parameters": ("gcs/commands", "bench/trials"),  # a command's parameters are its options
}


def files(*tops: str) -> list[Path]:
    return sorted(path for top in tops for path in (ROOT / top).rglob("*.py"))


@cache
def tree(path: Path) -> ast.Module:
    return ast.parse(path.read_text(encoding="utf-8"))


def place(path: Path) -> str:
    return path.relative_to(ROOT).as_posix()


def held(rule: str, *tops: str) -> list[Path]:
    """The files that a rule holds for."""
    return [path for path in files(*tops) if not place(path).startswith(EXEMPT[rule])]


def table(heading: str) -> dict[str, list[str]]:
    """A table of docs/architecture.md: first cell → the other cells, back quotes left in."""
    text = (ROOT / "docs" / "architecture.md").read_text(encoding="utf-8").split(f"\n## {heading}\n")[1]
    rows = [
        line.strip("|").split("|") for line in text.split("\n## ")[0].splitlines() if line.startswith("| `")
    ]
    return {row[0].strip(" `"): [cell.strip() for cell in row[1:]] for row in rows}


FOLDERS = {folder: cells[1] for folder, cells in table("Folders").items()}
LIBRARIES = {library: cells[0].strip("`") for library, cells in table("Libraries").items()}


def row_of(folder: str) -> str:
    """The folder itself, or the nearest one above it, that has a row."""
    while folder not in FOLDERS:
        folder, slash, _ = folder.rpartition("/")
        assert slash, "a folder needs a row in docs/architecture.md"
    return folder


def may_import(here: str, there: str) -> bool:
    """Whether the table lets folder ``here`` import ``there``; `gcs` names its page of words alone."""
    cell = FOLDERS[row_of(here)]
    names = re.findall("`(.+?)`", cell)
    return here == there or cell == "everything" or there in names or within(there, set(names) - {"gcs"})


def modules(path: Path) -> Iterator[tuple[ast.stmt, str]]:
    """Every module or name that a file imports, wherever in it: ``from a import b`` is a.b."""
    for node in ast.walk(tree(path)):
        if isinstance(node, ast.Import):
            yield from ((node, alias.name) for alias in node.names)
        elif isinstance(node, ast.ImportFrom):
            assert not node.level, f"{place(path)}: relative import"
            yield from ((node, f"{node.module}.{alias.name}") for alias in node.names)


def folder_of(module: str) -> str | None:
    """The folder that a module of ours lies in; None for one that is not ours."""
    if module.split(".")[0] not in PACKAGES:
        return None
    path = ROOT / module.replace(".", "/")
    while not (path.is_dir() or path.with_suffix(".py").is_file()):
        path = path.parent
    return place(path if path.is_dir() else path.parent)


def within(place: str, names: set[str]) -> bool:
    return any(place == name or place.startswith(name + "/") for name in names)


@pytest.mark.parametrize("path", files(*PACKAGES), ids=place)
def test_imports_are_those_of_the_table(path):
    if path.name == "__main__.py":
        return  # a door into the package; nothing imports it
    here = place(path.parent)
    for _, module in modules(path):
        there = folder_of(module)
        assert there is None or may_import(here, there), f"{place(path)} imports {module}"


def test_no_two_folders_import_each_other():
    arrows: dict[str, set[str]] = {}
    for path in files(*PACKAGES):
        if path.name != "__main__.py":
            here = place(path.parent)
            arrows.setdefault(here, set()).update(folder_of(module) or here for _, module in modules(path))
    done: set[str] = set()

    def visit(folder: str, way: tuple[str, ...]) -> None:
        assert folder not in way, f"a circle of imports: {' → '.join((*way, folder))}"
        if folder not in done:
            for other in arrows.get(folder, set()) - {folder}:
                visit(other, (*way, folder))
            done.add(folder)

    for folder in arrows:
        visit(folder, ())


def test_every_folder_of_the_table_is_there():
    assert [folder for folder in FOLDERS if not (ROOT / folder).is_dir()] == []


@pytest.mark.parametrize("path", files("gcs", "bridges", "filters", "web"), ids=place)
def test_libraries_stay_where_they_belong(path):
    for node, module in modules(path):
        library = module.split(".")[0]
        if library in LIBRARIES:
            assert within(place(path), {LIBRARIES[library]}), f"{place(path)} imports {module}"
        assert library != "torch" or node not in tree(path).body, (
            f"{place(path)} imports torch before it is needed"
        )


@pytest.mark.parametrize("path", files(*PACKAGES, "tests"), ids=place)
def test_files_have_one_subject(path):
    assert len(path.read_text(encoding="utf-8").splitlines()) <= LINES


def test_folders_are_seen_at_a_glance():
    code = (path for path in held("files in a folder", *PACKAGES, "tests") if path.name != "__init__.py")
    counts = Counter(place(path.parent) for path in code)
    assert {folder: count for folder, count in counts.items() if count > FILES_IN_FOLDER} == {}


def test_a_class_name_has_one_meaning():
    found: dict[str, list[str]] = {}
    for path in held("class names", *PACKAGES, "tests"):
        for node in ast.walk(tree(path)):
            if isinstance(node, ast.ClassDef):
                found.setdefault(node.name, []).append(place(path))
    assert {name: places for name, places in found.items() if len(places) > 1} == {}


class Signature(NamedTuple):
    """One function that is no compiled kernel."""

    where: str
    node: ast.FunctionDef
    public: bool

    @property
    def positional(self) -> list[ast.arg]:
        return [*self.node.args.posonlyargs, *self.node.args.args]

    @property
    def parameters(self) -> list[ast.arg]:
        stars = [star for star in (self.node.args.vararg, self.node.args.kwarg) if star]
        return [
            arg
            for arg in (*self.positional, *self.node.args.kwonlyargs, *stars)
            if arg.arg not in ("self", "cls")
        ]


def signatures(path: Path, node: ast.AST | None = None, public: bool = True) -> Iterator[Signature]:
    for child in ast.iter_child_nodes(node or tree(path)):
        if isinstance(child, ast.FunctionDef):
            marks = {getattr(getattr(d, "func", d), "id", "") for d in child.decorator_list}
            named = not child.name.startswith("_") or child.name in ("__init__", "__call__")
            if not marks & KERNELS:
                yield Signature(f"{place(path)}:{child.lineno} {child.name}", child, public and named)
            yield from signatures(path, child, public=False)
        elif isinstance(child, ast.ClassDef):
            yield from signatures(path, child, public and not child.name.startswith("_"))
        else:
            yield from signatures(path, child, public)


def test_functions_are_called_with_few_things():
    found = (one for path in held("parameters", *PACKAGES) for one in signatures(path))
    assert [one.where for one in found if len(one.parameters) > PARAMETERS] == []


def test_a_flag_is_named_where_it_is_given():
    wrong = []
    for one in (one for path in held("flags and annotations", *PACKAGES) for one in signatures(path)):
        defaults = [None] * (len(one.positional) - len(one.node.args.defaults)) + one.node.args.defaults
        for arg, default in zip(one.positional, defaults, strict=True):
            said = ast.unparse(arg.annotation) if arg.annotation else ""
            usual = default.value if isinstance(default, ast.Constant) else None
            if said in ("bool", "bool | None") or isinstance(usual, bool):
                wrong.append(f"{one.where}: {arg.arg}")
    assert wrong == []


def test_public_functions_are_annotated():
    wrong = []
    annotated = held("flags and annotations", *PACKAGES)
    public = (one for path in annotated for one in signatures(path) if one.public)
    for one in public:
        bare = [arg.arg for arg in one.parameters if arg.annotation is None]
        if bare or (one.node.returns is None and one.node.name != "__init__"):
            wrong.append(f"{one.where}: {', '.join(bare) or 'its return'}")
    assert wrong == []


def test_who_catches_everything_says_why():
    """In the line itself: at such a boundary a mistake of ours is caught too."""
    silent = []
    for path in files(*PACKAGES, "tests"):
        lines = path.read_text(encoding="utf-8").splitlines()
        for node in ast.walk(tree(path)):
            if isinstance(node, ast.ExceptHandler):
                caught = ast.unparse(node.type) if node.type else ""
                broad = not caught or {"Exception", "BaseException"} & set(re.findall(r"\w+", caught))
                if broad and "#" not in lines[node.lineno - 1]:
                    silent.append(f"{place(path)}:{node.lineno}")
    assert silent == []


def test_commands_start_light():
    """What a command may not need is imported late: these cost seconds."""
    heavy = {"torch", "viser", "zenoh", "numba", "filterpy", "pymavlink", "pymap3d"}
    code = f"import sys, gcs.commands.cli; print(*sorted(set(sys.modules) & {heavy}))"
    loaded = subprocess.run(
        [sys.executable, "-c", code], capture_output=True, text=True, check=True, cwd=ROOT
    )
    assert loaded.stdout.split() == []


def test_every_command_is_there():
    from importlib import import_module

    from gcs.commands.cli import COMMANDS, module_of

    for name in COMMANDS:
        assert import_module(module_of(name)).command


def test_vocabulary_and_filters_agree():
    from filters.models import rows
    from gcs.contract import messages

    assert rows.CHANNELS == messages.CHANNELS
    assert rows.VERDICTS == messages.VERDICTS
