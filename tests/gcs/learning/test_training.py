"""Flights to learn from, the judgement on a network, and its file."""

import csv
import json

import numpy as np
import pytest

from filters.correction import correction
from filters.models.rows import CHANNELS
from filters.models.settings import Settings
from filters.simulation import scenario, simulate
from gcs.contract import config
from gcs.contract.frames import Frame
from gcs.contract.messages import InputError
from gcs.learning import dataset, network, training
from gcs.learning.dataset import Flown
from gcs.station.intake import sensors_of

STATION = """
[range]
origin = { lat_deg = -35.3632, lon_deg = 149.1652, alt_m = 584.0 }
[[sensor]]
name = "theo"
kind = "theodolite"
position = { lat_deg = -35.358, lon_deg = 149.160, alt_m = 600.0 }
latency_s = 0.25
"""
VERDICTS_HEADER = ["t_ns", "sensor", "channel", "value", "predicted", "sigma", "weight", "verdict", "reason"]


@pytest.fixture
def run_folder(tmp_path):
    """A run folder with truth, written by hand, and (sensors, rows, truth) of the same flight."""
    (tmp_path / "station.toml").write_text(STATION)
    station = config.load(tmp_path / "station.toml", ())
    origin = station.range.origin
    frame = Frame(origin.lat_deg, origin.lon_deg, origin.alt_m)
    sensors = sensors_of(station, frame)
    rng = np.random.default_rng(0)
    truth = scenario.flight(12.0, 100.0, "gentle", rng)
    seen = [simulate.ins(truth, rng), simulate.instrument(truth, sensors[1], 10.0, rng)]
    rows, _ = simulate.rows(seen)
    lat, lon, alt = frame.to_geodetic(truth.p)
    with (tmp_path / "truth.csv").open("w", newline="") as file:
        lines = csv.writer(file)
        lines.writerow(["t_ns", "lat_deg", "lon_deg", "alt_m"])
        for t_s, *place in zip(truth.t_s, lat, lon, alt, strict=True):
            lines.writerow([simulate.T0_NS + round(t_s * 1e9), *(repr(float(x)) for x in place)])
    with (tmp_path / "verdicts.csv").open("w", newline="") as file:
        lines = csv.writer(file)
        lines.writerow(VERDICTS_HEADER)
        for row in rows:
            name, channel = sensors[row["sensor"]].name, CHANNELS[row["channel"]]
            late_ns = 250_000_000 if name == "theo" else 0
            value = np.degrees(row["value"]) if channel in ("azimuth", "elevation") else row["value"]
            lines.writerow([row["t_ns"] + late_ns, name, channel, repr(float(value)), "", "", 1, "used", ""])
        lines.writerow(["", "theo", "", "", "", "", 0, "invalid", "line 7: no number"])
    return tmp_path, sensors, rows, truth


def test_a_run_folder_teaches_what_its_flight_did(run_folder):
    folder, sensors, rows, truth = run_folder
    found = dataset.from_run(folder, Settings())
    direct = dataset.fly("", sensors, rows, truth, simulate.T0_NS, Settings())
    assert len(found.u) == len(direct.u) > 50
    np.testing.assert_allclose(found.u, direct.u, atol=1e-6)
    np.testing.assert_allclose((found.e * found.sigma)[:, :3], (direct.e * direct.sigma)[:, :3], atol=1e-3)


@pytest.mark.parametrize("name", ["station.toml", "verdicts.csv", "truth.csv"])
def test_an_incomplete_run_folder_is_named(run_folder, name):
    folder = run_folder[0]
    (folder / name).unlink()
    with pytest.raises(InputError, match=name):
        dataset.from_run(folder, Settings())


def test_flights_once_flown_are_not_flown_again(tmp_path, monkeypatch):
    first = dataset.gather(range(2), [], Settings(), tmp_path, lambda done, wanted: None)
    monkeypatch.setattr(dataset, "simulated", None)
    again = dataset.gather(range(2), [], Settings(), tmp_path, lambda done, wanted: None)
    assert all(np.array_equal(a.u, b.u) for a, b in zip(first, again, strict=True))
    with pytest.raises(TypeError):
        dataset.gather(range(2), [], Settings(jerk_psd=1.0), tmp_path, lambda done, wanted: None)


def flights(count, share, seed=0):
    """Flights whose error is ``share`` of the correction, and noise."""
    rng = np.random.default_rng(seed)
    out = []
    for k in range(count):
        u = rng.normal(size=(400, 9))
        out.append(Flown(f"f{k}", u, share * u + rng.normal(0.0, 0.2, u.shape), np.full((400, 9), 2.0)))
    return out


def proportional(slope):
    """A network that answers about ``slope`` · u."""
    small = 1e-3
    return np.concatenate(
        [small * np.eye(9).ravel(), np.zeros(9), slope / small * np.eye(9).ravel(), np.zeros(9)]
    )


def test_no_flight_is_in_two_parts():
    split = training.divide(flights(11, 0.0))
    names = [flown.name for part in split for flown in part]
    assert sorted(names) == sorted(f"f{k}" for k in range(11))
    assert [len(part) for part in split] == [7, 2, 2]


def test_a_network_that_helps_earns_its_place_and_one_that_harms_is_turned_off():
    plan = training.train.Plan(hidden=9)
    split = training.divide(flights(20, 0.5))
    good = training.assemble(proportional(0.5), plan, split)
    held_out = [training.effect(good, flown) for flown in split.held_out]
    assert training.earns(held_out)
    assert held_out[0]["position_m"]["off"] == pytest.approx(2.0 * np.sqrt(3 * (0.25 + 0.04)), rel=0.1)
    assert held_out[0]["position_m"]["on"] == pytest.approx(2.0 * np.sqrt(3 * 0.04), rel=0.1)
    bad = training.assemble(proportional(-0.5), plan, split)
    assert (bad.gain == 0.0).all()
    held_out = [training.effect(bad, flown) for flown in split.held_out]
    assert not training.earns(held_out)
    assert held_out[0]["position_m"]["ratio"] == 1.0


def small_network():
    return training.assemble(
        proportional(0.5), training.train.Plan(hidden=9), training.divide(flights(10, 0.5))
    )


def test_network_file_round_trip(tmp_path):
    net = training.assemble(
        proportional(0.5), training.train.Plan(hidden=9), training.divide(flights(10, 0.5))
    )
    path = tmp_path / "networks" / "one.json"
    network.save(path, net, {"seed": 0}, {"fit": ["a"]}, {"position_m": 0.9})
    for saved, was in zip(network.load(path), net, strict=True):
        np.testing.assert_allclose(saved, was, rtol=1e-6)
    assert json.loads(path.read_text())["held_out"] == {"position_m": 0.9}
    assert network.correction_of("off") is correction.off
    assert isinstance(network.correction_of(str(path)), correction.Correction)


@pytest.mark.parametrize("text", ["", "{}", '{"w1": 3}'])
def test_a_file_that_is_no_network_is_refused(tmp_path, text):
    path = tmp_path / "net.json"
    path.write_text(text)
    with pytest.raises(InputError, match=r"net\.json"):
        network.load(path)
    with pytest.raises(InputError, match=r"none\.json"):
        network.load(tmp_path / "none.json")


def test_a_network_with_a_missing_row_is_refused(tmp_path):
    net = training.assemble(
        proportional(0.5), training.train.Plan(hidden=9), training.divide(flights(10, 0.5))
    )
    network.save(tmp_path / "n.json", net._replace(w1=net.w1[:-1]), {}, {}, {})
    with pytest.raises(InputError, match="w1 has shape"):
        network.load(tmp_path / "n.json")


@pytest.mark.torch
def test_train_end_to_end(tmp_path, monkeypatch):
    pytest.importorskip("torch")
    monkeypatch.setattr(dataset, "SECONDS", 8.0)
    said = []
    plan = training.train.Plan(population=8, generations=2, epochs=2)
    good = training.run(tmp_path, 5, [], plan, Settings(), 0, tmp_path / "installed.json", said.append)
    assert good == (tmp_path / "installed.json").exists()
    assert ("not installed" in said[-1]) == (not good)
    report = json.loads((tmp_path / "report.json").read_text())
    assert [len(names) for names in report["data"].values()] == [3, 1, 1]
    network.load(tmp_path / "network.json")


def test_too_few_flights_are_refused(tmp_path):
    with pytest.raises(InputError, match="5 flights or more"):
        training.run(tmp_path, 4, [], training.train.Plan(), Settings(), 0, None, print)
