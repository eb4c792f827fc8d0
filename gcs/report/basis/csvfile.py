"""The CSV files of a run folder as arrays; a line that is torn or damaged costs that line and is counted."""

import csv
import os
from collections.abc import Iterator, Sequence
from itertools import islice
from operator import itemgetter
from pathlib import Path
from typing import NamedTuple

import numpy as np

from gcs.contract.messages import InputError

BLOCK = 50_000  # lines that are held as text at a time: some ten megabytes


class Columns(NamedTuple):
    """What could be read of a file of numbers."""

    rows: np.ndarray  # (n,) structured by the file's own names: ``…_ns`` int64, all else float64
    damaged: int  # lines that could not be read


class Block(NamedTuple):
    """Some lines of a file with texts."""

    columns: list[tuple[str, ...]]  # in the order they were asked for
    damaged: int


def numbers(path: Path, needed: Sequence[str]) -> Columns:
    """A file of numbers; an empty field is NaN. Raises InputError where a ``needed`` column is missing."""
    with _open(path) as file:
        header = _header(path, file.readline().strip().split(","), needed)
        kind = np.dtype([(name, "i8" if name.endswith("_ns") else "f8") for name in header])
        parts, damaged = [np.empty(0, kind)], 0
        while lines := list(islice(file, BLOCK)):
            part, bad = _parse(lines, kind)
            parts.append(part)
            damaged += bad
    return Columns(np.concatenate(parts), damaged)


def texts(path: Path, needed: Sequence[str]) -> Iterator[Block]:
    """The ``needed`` columns as text, block by block. Raises InputError where one of them is missing."""
    with _open(path) as file:
        reader = csv.reader(file)
        header = _header(path, next(reader, []), needed)
        pick = itemgetter(*(header.index(name) for name in needed))
        while rows := list(islice(reader, BLOCK)):
            good = [pick(row) for row in rows if len(row) == len(header)]
            yield Block(list(zip(*good, strict=True)) or [()] * len(needed), len(rows) - len(good))


def optional(path: Path, needed: Sequence[str]) -> np.ndarray | None:
    """`numbers` of a file that older runs, or runs without such data, do not have."""
    return numbers(path, needed).rows if os.path.exists(path) else None


def _open(path: Path):
    try:
        return path.open(encoding="utf-8", errors="replace", newline="")
    except OSError as error:
        raise InputError(f"{path}: {error.strerror}; name the run folder of a replay or a live run") from None


def _header(path: Path, header: list[str], needed: Sequence[str]) -> list[str]:
    missing = [name for name in needed if name not in header]
    if missing:
        raise InputError(f"{path}:1: no column {', '.join(missing)}; name a run folder that gcs wrote")
    return header


def _parse(lines: list[str], kind: np.dtype) -> tuple[np.ndarray, int]:
    """Rows of ``lines``, and how many of these are none."""
    filled = [_filled(line) for line in lines]
    try:
        return _load(filled, kind), 0
    except ValueError:
        good = [line for line in filled if line and _is_row(line, kind)]
    return _load(good, kind) if good else np.empty(0, kind), len(lines) - len(good)


def _load(lines: list[str], kind: np.dtype) -> np.ndarray:
    return np.loadtxt(lines, delimiter=",", dtype=kind, ndmin=1, comments=None)


def _is_row(line: str, kind: np.dtype) -> bool:
    try:
        return bool(_load([line], kind).size)
    except ValueError:
        return False


def _filled(line: str) -> str:
    """With ``nan`` in its empty fields."""
    line = line.strip()
    while ",," in line:
        line = line.replace(",,", ",nan,")
    return f"{line}nan" if line.endswith(",") else line
