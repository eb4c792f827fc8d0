"""``docs/settings.md`` out of the schema: ``python -m gcs.contract.settings_page > docs/settings.md``."""

from collections.abc import Iterator
from typing import Any

import msgspec
from msgspec import inspect

from gcs.contract.config import Station
from gcs.contract.station_text import plain, valid

HEAD = """\
# Settings

Every setting of the station file, written from the schema in `gcs/contract/config.py` and
`gcs/contract/instrument.py` by `python -m gcs.contract.settings_page`. `--config NAME=VALUE` sets any of them
for one run; an instrument goes by its name, as in `--config sensor.theo-north.latency_s=0.06`.
`gcs doctor --station FILE` prints all of them as they are resolved, each with where it comes from.
"""
UNITS = {
    "m": "m",
    "mps": "m/s",
    "mps2": "m/s²",
    "deg": "degrees",
    "s": "s",
    "hz": "1/s",
    "jerk_psd": "m²/s⁵",
    "gust_psd": "m²/s³",
    "scans": "scans",
}
TABLE = "| setting | unit | default | valid | reason |\n|---|---|---|---|---|"


def page() -> str:
    """The whole page."""
    parts = [HEAD]
    for field in _struct(inspect.type_info(Station)).fields:
        struct, listed = _section(field.type)
        heading = f"[[{field.name}]]" if listed else f"[{field.name}]"
        parts.append(
            f"## `{heading}`\n\n{_doc(struct)}\n\n{TABLE}\n" + "\n".join(_rows(struct, "", "")) + "\n"
        )
    return "\n".join(parts)


def _rows(struct: inspect.StructType, above: str, unit: str) -> Iterator[str]:
    for field in struct.fields:
        name, reason = above + field.name, _reason(field.type)
        named = UNITS.get(field.name) or UNITS.get(field.name.rpartition("_")[2] if "_" in field.name else "")
        own = unit or named or ""  # a table with a unit in its name gives it to all that is in it
        kinds = _kinds(field.type)
        tables = [kind for kind in kinds if isinstance(kind, inspect.StructType)]
        if len(tables) < len(kinds):
            yield _row(name, own, _default(field), _valid(kinds), reason)
        elif reason:
            yield _row(name, "", "left out" if field.default is None else "", "a table", reason)
        for table in tables:
            yield from _rows(table, f"{name}.", own)


def _row(*cells: str) -> str:
    name, *rest = (cell.replace("|", "\\|") for cell in cells)
    return f"| `{name}` | " + " | ".join(rest) + " |"


def _valid(kinds: list[inspect.Type]) -> str:
    words = ["a table, below" if isinstance(kind, inspect.StructType) else valid(kind) for kind in kinds]
    return ", or ".join(words)


def _default(field: inspect.Field) -> str:
    if field.required:
        return "**needed**"
    if field.default is None:
        return "left out"
    if field.default is inspect.UNSET or field.default is msgspec.NODEFAULT:
        return "none" if field.default_factory is list else ""
    if isinstance(field.default, bool):
        return "true" if field.default else "false"
    return f"{field.default:g}" if isinstance(field.default, float) else str(field.default)


def _reason(kind: inspect.Type) -> str:
    """The description, the outermost where there are several."""
    while isinstance(kind, inspect.Metadata):
        if text := (kind.extra_json_schema or {}).get("description"):
            return str(text)
        kind = kind.type
    return ""


def _kinds(kind: inspect.Type) -> list[inspect.Type]:
    """What a value may be, without None."""
    kind = plain(kind)
    kinds = [plain(k) for k in kind.types] if isinstance(kind, inspect.UnionType) else [kind]
    return [k for k in kinds if not isinstance(k, inspect.NoneType)]


def _section(kind: inspect.Type) -> tuple[inspect.StructType, bool]:
    kind = plain(kind)
    if isinstance(kind, inspect.ListType):
        return _struct(kind.item_type), True
    return _struct(kind), False


def _struct(kind: inspect.Type) -> inspect.StructType:
    kind = plain(kind)
    assert isinstance(kind, inspect.StructType)
    return kind


def _doc(struct: Any) -> str:
    text: str = struct.cls.__doc__.strip()
    return text.replace("``", "`")


if __name__ == "__main__":
    print(page(), end="")
