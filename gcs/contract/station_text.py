"""The text behind a station file: reading it, where a setting stands in it, and why it is refused."""

import re
import tomllib
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Any, NamedTuple

from msgspec import inspect

from gcs.contract.messages import InputError

Steps = list[str | int]  # the way to a setting: ["sensor", 0, "sigma", "range_m"]


class Given(NamedTuple):
    """What the operator gave, before anything is checked."""

    name: str  # of the file
    text: str
    tree: dict[str, Any]
    overrides: list[tuple[Steps, str]]  # where each one went, and how it was written


class Setting(NamedTuple):
    """One resolved setting."""

    name: str  # sensor.theo-north.latency_s
    value: Any
    source: str  # "station.toml:12", "--config", "default"


def read(path: Path | None, overrides: Sequence[str] = ()) -> Given:
    """The file at ``path`` (nothing for None) with overrides in it. Raises ``InputError``."""
    text = "" if path is None else _read(path)
    name = "station" if path is None else str(path)
    try:
        tree = tomllib.loads(text)
    except (tomllib.TOMLDecodeError, RecursionError) as error:
        what, line = re.fullmatch(r"(.*?)(?: \(at line (\d+), .*\))?", str(error), re.DOTALL).groups()  # type: ignore[union-attr]
        raise InputError(f"{name}:{line or 1}: not TOML: {what[:1].lower()}{what[1:]}") from None
    return Given(name, text, tree, [(_override(tree, override), override) for override in overrides])


def _read(path: Path) -> str:
    try:
        return path.read_text(encoding="utf-8")
    except FileNotFoundError:
        raise InputError(f"{path}: no such station file; name one with --station") from None
    except (OSError, ValueError) as error:  # no UTF-8 in it, or a name that no file can have
        raise InputError(f"{path}: not a readable text file ({error})") from None


def _override(tree: dict, override: str) -> Steps:
    """Set one dotted key; sensors go by name: ``sensor.theo-north.latency_s=0.1``. Returns where it went."""
    key, equals, raw = override.partition("=")
    if not override.isprintable():
        raise InputError(f"--config {ascii(override)[1:-1]}: holds a character that cannot be printed")
    if not equals:
        raise InputError(f"--config {override}: expected KEY=VALUE, such as ins.height_m=2.0")
    try:
        value = tomllib.loads(f"x = {raw}")["x"]
    except (tomllib.TOMLDecodeError, RecursionError):
        value = raw
    steps: Steps = []
    node, parts = tree, key.strip().split(".")
    if parts[0] == "sensor" and len(parts) > 2:
        listed = tree.get("sensor", [])
        sensors = [s for s in listed if isinstance(s, dict)] if isinstance(listed, list) else []
        names = [sensor.get("name") for sensor in sensors]
        if parts[1] not in names:
            raise InputError(f"--config {override}: no sensor {parts[1]!r}; there are {_names(names)}")
        steps = ["sensor", names.index(parts[1])]
        node, parts = sensors[names.index(parts[1])], parts[2:]
    for part in parts[:-1]:
        node = node.setdefault(part, {})
        if not isinstance(node, dict):
            raise InputError(f"--config {override}: {part!r} is no section")
    node[parts[-1]] = value
    return [*steps, *parts]


def explain(given: Given, schema: type, error: str) -> str:
    """msgspec's ``error``, with where it was given, the valid names and the valid values."""
    what, _, path = error.partition(" - at `$")
    steps: Steps = [int(s) if s.isdigit() else s for s in re.findall(r"[\w-]+", path)]
    unknown = re.search(r"unknown field `(.+?)`", what)
    if unknown:
        kind = _type_at(schema, steps)
        steps.append(unknown[1])
        what = f"unknown name {unknown[1]!r}; valid names are {_names(_fields(kind))}"
    elif what.startswith(("Expected", "Invalid", "Number")):
        value = repr(_at(given.tree, steps))
        shown = value if len(value) <= 40 else value[:39] + "…"
        what = f"{'.'.join(map(str, steps))}: {shown} cannot be; valid is {valid(_type_at(schema, steps))}"
    else:
        what = f"{'.'.join(map(str, steps))}: {what[0].lower()}{what[1:]}"
    return f"{where(given, steps)}: {what}"


def where(given: Given, steps: Steps) -> str:
    """``FILE:LINE`` of the setting at ``steps``, or the option that set it."""
    for at, override in reversed(given.overrides):
        if steps[: len(at)] == at:
            return f"--config {override}"
    return f"{given.name}:{_line_of(given.text, steps)}"


def valid(kind: inspect.Type) -> str:
    """What a value of a type can be, in words."""
    kind = plain(kind)
    if isinstance(kind, inspect.UnionType):
        kinds = [k for k in map(plain, kind.types) if not isinstance(k, inspect.NoneType)]
        return ", or ".join(map(valid, kinds))
    if isinstance(kind, (inspect.FloatType, inspect.IntType)):
        word = "a whole number" if isinstance(kind, inspect.IntType) else "a number"
        if kind.ge is None:
            return word
        return f"{word} from {kind.ge:g} to {kind.le:g}"
    if isinstance(kind, inspect.LiteralType):
        return _names(kind.values)
    if isinstance(kind, inspect.StrType):
        return "a text of a-z, 0-9 and -, with none of - at its ends" if kind.pattern else "a text"
    if isinstance(kind, inspect.ListType):
        return f"a list of {valid(kind.item_type)}"
    if isinstance(kind, inspect.StructType):
        return f"a table of {_names(_fields(kind))}"
    return "true or false"


def settings(given: Given, tree: Any) -> list[Setting]:
    """Every leaf of the resolved ``tree``, with where it was given."""
    found = []
    for steps, value in _leaves(tree, []):
        source = "default"
        if any(steps[: len(at)] == at for at, _ in given.overrides):
            source = "--config"
        elif _at(given.tree, steps) is not None:
            source = where(given, steps)
        found.append(Setting(_name_of(tree, steps), value, source))
    return found


def _leaves(node: Any, steps: Steps) -> Iterator[tuple[Steps, Any]]:
    sections = isinstance(node, list) and any(isinstance(item, dict) for item in node)
    if isinstance(node, dict):
        for key, value in node.items():
            yield from _leaves(value, [*steps, key])
    elif sections:
        for number, item in enumerate(node):
            yield from _leaves(item, [*steps, number])
    else:
        yield steps, node


def _name_of(tree: Any, steps: Steps) -> str:
    """Dotted, a sensor by its name: as ``--config`` takes it."""
    names = []
    for step in steps:
        tree = tree[step]
        names.append(tree["name"] if isinstance(step, int) else step)
    return ".".join(names)


def _at(tree: Any, steps: Steps) -> Any:
    """What stands at ``steps``; None where nothing does."""
    for step in steps:
        try:
            tree = tree[step]
        except (KeyError, IndexError, TypeError):
            return None
    return tree


def plain(kind: inspect.Type) -> inspect.Type:
    """The type without what is said about it."""
    while isinstance(kind, inspect.Metadata):
        kind = kind.type
    return kind


def _fields(kind: inspect.Type) -> list[str]:
    return [field.name for field in kind.fields] if isinstance(kind, inspect.StructType) else []


def _type_at(schema: type, steps: Steps) -> inspect.Type:
    """msgspec's description of the type that ``steps`` leads to."""
    kind = plain(inspect.type_info(schema))
    for number, step in enumerate([*steps, None]):
        if isinstance(kind, inspect.UnionType) and number and step is not None:
            kind = next(k for k in map(plain, kind.types) if isinstance(k, inspect.StructType))
        if isinstance(step, int) and isinstance(kind, inspect.ListType):
            kind = plain(kind.item_type)
        elif step is not None and isinstance(kind, inspect.StructType):
            kind = plain(next(f.type for f in kind.fields if f.name == step))
    if isinstance(kind, inspect.UnionType):
        some = [k for k in map(plain, kind.types) if not isinstance(k, inspect.NoneType)]
        return some[0] if len(some) == 1 else kind
    return kind


def _line_of(text: str, steps: Steps) -> int:
    """The line where the setting at ``steps`` stands: its own, else its section's, else 1."""
    names = [s for s in steps if isinstance(s, str)] or [""]
    section, key, parent = names[0], names[-1], names[-2] if len(names) > 2 else ""
    nth = next((s for s in steps if isinstance(s, int)), 0)
    best, line_of_best, current = 0, 1, ""
    seen: dict[str, int] = {}
    for number, line in enumerate(text.splitlines(), 1):
        code = line.split("#")[0]
        header = re.match(r"\s*\[+\s*([\w.-]+)\s*\]+", code)
        if header:
            current = header[1]
            if code.lstrip().startswith("[[") and "." not in current:
                seen[current] = seen.get(current, -1) + 1
        top, _, below = current.partition(".")
        inside = top == section and seen.get(top, 0) == nth
        score = 0
        if header and inside:
            score = 2 if below and below in (key, parent) else 1
        elif not header and (inside or (not current and _sets(code, section))) and _sets(code, key):
            score = 4 if not parent or _sets(code, parent) or below == parent else 3
        if score > best:
            best, line_of_best = score, number
    return line_of_best


def _sets(code: str, key: str) -> bool:
    """Does a line set ``key``, alone, in an inline table or dotted?"""
    return bool(re.search(rf"(^|[\s{{,.]){re.escape(key)}\s*[=.]", code))


def _names(names: Any) -> str:
    return ", ".join(sorted(map(str, names))) or "none"
