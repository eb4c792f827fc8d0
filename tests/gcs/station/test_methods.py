"""The filters of the literature through the session: the same files, the same one verdict for each value."""

import csv
from pathlib import Path

import numpy as np
import pytest

from filters.methods import METHODS
from gcs.commands.options import Method
from gcs.contract import config
from gcs.contract.messages import InputError
from gcs.outputs.record import Record
from gcs.station.session import Session
from gcs.station.sources import replay

SAMPLE = Path(__file__).resolve().parents[3] / "logs" / "sample"
SECONDS = 4.0


@pytest.mark.parametrize("method", ["wolf", "imm", "filterpy-ukf"])
def test_some_seconds_of_the_sample(method, tmp_path):
    station = config.load(SAMPLE / "station.toml")
    feeds = {name: SAMPLE / f"{name}.csv" for name in ("theo-north", "radar-1")}
    flight = replay.load(SAMPLE / "flight.tlog", station, feeds)
    session = Session(station, flight.frame, [Record(tmp_path, station, flight.frame)], method)
    whole = replay.batch(flight, session.intake)
    first = whole.valid_ns[whole.valid_ns > 0].min()
    inside = (whole.valid_ns >= first) & (whole.valid_ns < first + SECONDS * 1e9)
    session.enter(replay.Batch(*(column[inside] for column in whole)))
    summary = session.finish(flight.about)
    assert summary["settings"]["method"] == method
    with (tmp_path / "track.csv").open(encoding="utf-8", newline="") as file:
        track = list(csv.DictReader(file))
    assert len(track) > 50
    assert {row["protection_h_m"] for row in track} == {""}
    with (tmp_path / "verdicts.csv").open(encoding="utf-8", newline="") as file:
        verdicts = list(csv.DictReader(file))
    judged = {"used", "deweighted"} if method != "filterpy-ukf" else {"used"}
    assert {row["verdict"] for row in verdicts} - {"invalid"} <= judged
    assert len(verdicts) > 500
    truth = np.genfromtxt(SAMPLE / "truth.csv", delimiter=",", names=True)
    enu = flight.frame.to_enu(truth["lat_deg"], truth["lon_deg"], truth["alt_m"])
    at = [np.interp(int(track[-1]["t_ns"]), truth["t_ns"], enu[:, k]) for k in range(3)]
    seen = [float(track[-1][axis]) for axis in ("e_m", "n_m", "u_m")]
    assert np.linalg.norm(np.subtract(seen, at)) < 10.0


def test_a_correction_for_a_filter_that_takes_none_is_refused():
    station = config.load(SAMPLE / "station.toml")
    flight = replay.load(SAMPLE / "flight.tlog", station, {})
    with pytest.raises(InputError, match="leave out --correction"):
        Session(station, flight.frame, [], "filterpy-ukf", lambda *states: states[2])


def test_help_and_readme_name_every_method():
    root = Path(__file__).resolve().parents[3]
    said = Method.__metadata__[0].help
    readme = (root / "README.md").read_text(encoding="utf-8")
    assert [name for name in METHODS if name not in said] == []
    assert f"--method {'|'.join(sorted(METHODS))}" == "--method " + "|".join(
        sorted(readme.split("`--method ")[1].split("`")[0].split("|"))
    )
