"""The sample flight, replayed once by the command, for all who look at what it leaves."""

import sys
from pathlib import Path

import pytest

from gcs.commands.cli import main

SAMPLE = Path(__file__).resolve().parents[2] / "logs" / "sample"


@pytest.fixture(scope="session")
def sample_run(tmp_path_factory) -> Path:
    """Its run folder, to be read only."""
    out = tmp_path_factory.mktemp("sample") / "run"
    feeds = [f"{name}={SAMPLE / name}.csv" for name in ("theo-north", "theo-east", "radar-1")]
    options = ("--station", SAMPLE / "station.toml", "--out", out, "--feed", *feeds)
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(sys, "argv", list(map(str, ("gcs", "replay", SAMPLE / "flight.tlog", *options))))
        with pytest.raises(SystemExit) as left:
            main()
    assert not left.value.code
    return out
