"""The audit says in one line what it found, and never that all is well where nobody was asked."""

from docs import audit

KNOWN = {"name": "attrs", "version": "26.1.0", "vulns": []}
SILENT = {"name": "mcap", "skip_reason": "Dependency not found on PyPI and could not be audited"}
BROKEN = {"name": "jinja2", "version": "3.0", "vulns": [{"id": "PYSEC-1", "aliases": ["CVE-2026-1"]}]}


def test_all_is_well_only_where_every_package_was_asked_about():
    assert audit.judge("test.txt", {"dependencies": [KNOWN, KNOWN]}) == (
        0, ["test.txt: nothing is known against its 2 packages"]
    )  # fmt: skip


def test_an_index_that_does_not_know_is_said_in_one_line():
    code, (line,) = audit.judge("test.txt", {"dependencies": [KNOWN, SILENT]})
    assert code == 2
    assert "NOT audited" in line
    assert "1 of 2 packages, such as mcap" in line


def test_what_is_known_comes_first():
    code, lines = audit.judge("test.txt", {"dependencies": [SILENT, BROKEN]})
    assert code == 1
    assert lines == ["test.txt: 1 known vulnerabilities", "jinja2 3.0: PYSEC-1, CVE-2026-1"]


def test_without_an_answer_nothing_was_audited(monkeypatch):
    monkeypatch.setattr(audit, "ASK", ("--no-such-option",))
    code, (line,) = audit.ask("test.txt")
    assert code == 2
    assert "cannot be asked" in line
