"""What is shipped: one version, the sample flight, and versions that are written down."""

import importlib.metadata
import re
import tomllib
from pathlib import Path

import pytest
from packaging.requirements import Requirement
from packaging.utils import canonicalize_name

ROOT = Path(__file__).resolve().parents[1]
PROJECT = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))
EXTRAS = PROJECT["project"]["optional-dependencies"]
DIRECT = [
    Requirement(text) for part in (PROJECT["project"]["dependencies"], *EXTRAS.values()) for text in part
]


def pins(name: str) -> dict[str, str]:
    """Package → version of one lock file."""
    text = (ROOT / "requirements" / f"{name}.txt").read_text(encoding="utf-8")
    return {canonicalize_name(n): v for n, v in re.findall(r"^([\w.-]+)==(\S+)", text, re.MULTILINE)}


PINS = pins("test")
LOCKS = ("core", "check", "test", "supply")


def test_every_dependency_has_its_version_written_down():
    for wanted in DIRECT:
        assert PINS[canonicalize_name(wanted.name)] in wanted.specifier, wanted.name


def test_what_dependencies_need_is_written_down_too():
    left, seen = [(one, "") for one in DIRECT], set()
    while left:
        wanted, extra = left.pop()
        name = canonicalize_name(wanted.name)
        if name in seen or (wanted.marker and not wanted.marker.evaluate({"extra": extra})):
            continue
        seen.add(name)
        assert name in PINS, f"{name}: make lock"
        try:
            further = importlib.metadata.requires(name) or []
        except importlib.metadata.PackageNotFoundError:  # make check has no torch
            continue
        left += [(Requirement(text), extra) for text in further for extra in (*wanted.extras, "")]


@pytest.mark.parametrize("name", LOCKS)
def test_every_file_that_may_be_installed_has_its_hash(name):
    text = (ROOT / "requirements" / f"{name}.txt").read_text(encoding="utf-8")
    entries = re.split(r"^(?=[\w.-]+==)", text, flags=re.MULTILINE)[1:]
    assert entries
    assert [entry.split()[0] for entry in entries if "--hash=sha256:" not in entry] == []
    assert "://" not in text


@pytest.mark.parametrize("name", ["core", "check"])
def test_a_smaller_lock_is_part_of_the_whole_one(name):
    assert pins(name).items() <= PINS.items()


def test_make_installs_by_hash_alone():
    """Each install in the Makefile asks for hashes, or brings nothing but this project."""
    text = (ROOT / "Makefile").read_text(encoding="utf-8").replace("\\\n", " ")
    text = text.replace("$(LOCKED)", re.search(r"^LOCKED := (.*)$", text, re.MULTILINE)[1])
    text = text.replace("$(PIP)", re.search(r"^PIP := (.*)$", text, re.MULTILINE)[1])
    installs = [line for line in text.splitlines() if line.startswith("\t") and "pip install" in line]
    assert len(installs) >= 6
    for line in installs:
        assert "--require-hashes" in line or "--no-deps" in line, line


def test_the_version_stands_in_one_place():
    assert PROJECT["tool"]["setuptools"]["dynamic"]["version"] == {"attr": "gcs.__version__"}
    assert "version" not in PROJECT["project"]


def test_the_wheel_gets_all_that_the_demo_reads():
    data = {ROOT / "gcs" / name for name in PROJECT["tool"]["setuptools"]["package-data"]["gcs"]}
    assert all(path.is_file() for path in data)
    shipped = {path.name for path in data}
    station = tomllib.loads((ROOT / "gcs" / "sample" / "station.toml").read_text(encoding="utf-8"))
    assert shipped >= {"flight.tlog", "station.toml", *(f"{s['name']}.csv" for s in station["sensor"])}


def test_every_package_says_that_it_is_typed():
    packages = {
        name.partition(".")[0] for name in PROJECT["tool"]["setuptools"]["packages"]["find"]["include"]
    }
    assert [name for name in sorted(packages) if not (ROOT / name / "py.typed").is_file()] == []
