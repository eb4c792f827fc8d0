"""``gcs report`` and ``gcs compare``: a file or a table, and one line where it cannot be."""

import hashlib
import sys
from pathlib import Path

import pytest

from gcs.commands.cli import main
from tests.gcs.report import folder

SAMPLE = Path(__file__).resolve().parents[4] / "logs" / "sample"


@pytest.fixture
def gcs(monkeypatch, capsys):
    """Runs a command; gives its exit code and what it said."""

    def gcs(*arguments) -> tuple[int, str]:
        monkeypatch.setattr(sys, "argv", ["gcs", *map(str, arguments)])
        with pytest.raises(SystemExit) as left:
            main()
        return left.value.code or 0, capsys.readouterr().err

    return gcs


@pytest.fixture
def written(tmp_path):
    return folder.write(tmp_path)


@pytest.mark.slow
def test_the_sample_flight_from_its_log_to_its_report_and_truth(gcs, sample_run, tmp_path):
    """All clocks float: the common one is off by some 30 ms, nearly all of the error; sigma says so."""
    file = tmp_path / "report.html"
    assert gcs("report", sample_run, "--tolerance-h", 2, "--out", file)[0] == 0
    page = file.read_text(encoding="utf-8")
    digest = hashlib.sha256((SAMPLE / "radar-1.csv").read_bytes()).hexdigest()
    for said in ("Not within tolerance", "No clock is taken as right", "theo-east is silent", digest):
        assert said in page, said
    code, said = gcs("compare", sample_run, SAMPLE / "truth.csv")
    assert code == 0
    (rms,) = [float(line.split()[2]) for line in said.splitlines() if line.startswith("horizontal  ")]
    assert 0.3 < rms < 1.5
    (nees,) = [line.split() for line in said.splitlines() if line.startswith("NEES")]
    assert float(nees[2]) < 5.0


def test_the_report_is_written_into_the_run_folder(gcs, written):
    code, said = gcs("report", written, "--tolerance-h", 3)
    assert code == 0
    assert "report.html" in said
    assert "Within tolerance" in (written / "report.html").read_text(encoding="utf-8")


def test_the_report_cannot(gcs, written, tmp_path):
    for arguments in (
        (tmp_path / "nowhere",), (written, "--tolerance-h", "nan"), (written, "--tolerance-v", "-1"),
        (written, "--out", tmp_path / "nowhere" / "report.html"),
    ):  # fmt: skip
        code, said = gcs("report", *arguments)
        assert (code, said.count("\n")) == (2, 1), said
        assert said.startswith("gcs: ")


def test_a_run_beside_another_one(gcs, written, tmp_path):
    (tmp_path / "other").mkdir()
    other = folder.write(tmp_path / "other", east_m=-2.0)
    code, said = gcs("compare", written, other, "--out", tmp_path / "compared.html")
    assert code == 0
    (row,) = [
        line.split() for line in said.splitlines() if line.startswith("horizontal") and "beyond" not in line
    ]
    assert float(row[1]) == pytest.approx(2.0, rel=1e-3)
    assert (tmp_path / "compared.html").is_file()


def test_a_run_beside_a_truth_file(gcs, written, tmp_path):
    lines = (written / "smoothed.csv").read_text().splitlines()
    truth = tmp_path / "truth.csv"
    truth.write_text("\n".join(",".join(line.split(",")[:4]) for line in lines) + "\n")
    code, said = gcs("compare", written, truth, "--live")
    assert code == 0
    assert "run, live minus truth.csv" in said
    later = [line.replace("17672256", "17772256") for line in truth.read_text().splitlines()]
    truth.write_text("\n".join(later) + "\n")
    code, said = gcs("compare", written, truth)
    assert (code, said.count("\n")) == (2, 1)
    assert "no time in common" in said
