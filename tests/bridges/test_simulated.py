"""Simulated feeds: geometry against ECEF by hand, errors against what was injected, the sample as shipped."""

import csv
import json
import math
import subprocess
import sys
import threading
from pathlib import Path

import numpy as np
import pytest

from bridges import feed, simulated
from bridges.tlog import flight as tlog_flight
from bridges.tlog import tlog
from filters.simulation import simulate
from gcs.contract import config
from gcs.contract.frames import Frame, polar_to_enu
from gcs.contract.messages import InputError, PolarMeasurement
from tests.bridges.fake import FakeBus

SAMPLE = Path(__file__).parents[2] / "logs" / "sample"
SEED = 7
LASER = {"range_m": 1.0, "azimuth_deg": 0.003, "elevation_deg": 0.003}
NORTH = simulated.SimulatedInstrument("north", "theodolite", -35.27, 149.16, 640.0, LASER)
RADAR = simulated.SimulatedInstrument(
    "radar", "radar", -35.37, 149.10, 600.0, LASER | {"range_rate_mps": 0.5}
)


@pytest.fixture(scope="module")
def truth():
    """A circle of about 300 m, 25 Hz, 60 s."""
    t_s = np.arange(0, 60, 0.04)
    rows = np.zeros(len(t_s), simulated.TRUTH)
    rows["t_ns"] = simulate.T0_NS + np.round(t_s * 1e9).astype(np.int64)
    rows["lat_deg"] = -35.36 + 0.0027 * np.sin(t_s / 10)
    rows["lon_deg"] = 149.17 + 0.0033 * np.cos(t_s / 10)
    rows["alt_m"] = 700 + 20 * np.sin(t_s / 7)
    return rows


def ecef(lat_deg, lon_deg, alt_m):
    """WGS84, Groves 2013 eq. 2.112."""
    lat, lon, e2 = np.radians(lat_deg), np.radians(lon_deg), 6.69437999014e-3
    normal = 6378137.0 / np.sqrt(1 - e2 * np.sin(lat) ** 2)
    flat = (normal + alt_m) * np.cos(lat)
    return np.stack([flat * np.cos(lon), flat * np.sin(lon), (normal * (1 - e2) + alt_m) * np.sin(lat)], -1)


def test_geometry_on_the_round_earth(truth):
    seen = simulated.observe(truth, NORTH, np.random.default_rng(1), share=0.0)
    t_s = (truth["t_ns"] - truth["t_ns"][0]) * 1e-9
    at_s = (seen.t_ns - truth["t_ns"][0]) * 1e-9
    places = ecef(truth["lat_deg"], truth["lon_deg"], truth["alt_m"])
    line = np.stack([np.interp(at_s, t_s, axis) for axis in places.T], -1) - ecef(*NORTH[2:5])
    lat, lon = np.radians(NORTH[2:4])
    up = np.array([np.cos(lat) * np.cos(lon), np.cos(lat) * np.sin(lon), np.sin(lat)])
    east = np.array([-np.sin(lon), np.cos(lon), 0.0])
    range_m = np.linalg.norm(line, axis=1)
    assert range_m.min() > 9_000
    np.testing.assert_allclose(seen.clean[:, 0], range_m, atol=0.02)
    azimuth = np.arctan2(line @ east, line @ np.cross(up, east)) % (2 * np.pi)
    np.testing.assert_allclose(seen.clean[:, 1], azimuth, atol=2e-6)
    np.testing.assert_allclose(seen.clean[:, 2], np.arcsin(line @ up / range_m), atol=2e-6)


def test_range_rate_is_the_slope_of_range(truth):
    seen = simulated.observe(truth, RADAR, np.random.default_rng(1), share=0.0)
    slope = np.gradient(seen.clean[:, 0], seen.t_ns * 1e-9)
    np.testing.assert_allclose(seen.clean[2:-2, 3], slope[2:-2], atol=0.05)


def read_labels(path):
    with path.open() as file:
        return list(csv.DictReader(file))


def make(folder, *more, truth=SAMPLE / "truth.csv"):
    """As the command writes it."""
    asked = [
        "bridge",
        "simulated",
        truth,
        "--station",
        SAMPLE / "station.toml",
        "--seed",
        SEED,
        "--out",
        folder,
    ]
    command = [sys.executable, "-m", "gcs", *map(str, asked), *more]
    return subprocess.run(command, cwd=SAMPLE.parents[1], capture_output=True, text=True)


@pytest.fixture(scope="module")
def made(tmp_path_factory):
    folder = tmp_path_factory.mktemp("made")
    assert make(folder).returncode == 0
    return folder


def test_sample_can_be_made_again_bit_for_bit(made):
    names = sorted(path.name for path in made.iterdir())
    assert len(names) == 7
    for name in names:
        assert (made / name).read_bytes() == (SAMPLE / name).read_bytes(), name


@pytest.mark.parametrize("name", ["theo-north", "theo-east", "radar-1"])
def test_errors_are_those_injected(made, name):
    rows, bad = feed.read(made / f"{name}.csv", name)
    labels, injected = (
        read_labels(made / f"{name}.labels.csv"),
        json.loads((made / "injected.json").read_text()),
    )
    assert not bad
    assert len(labels) == len(rows)
    sigma = next(i for i in simulated.instruments_of(SAMPLE / "station.toml") if i.name == name).sigma
    shares = []
    for channel, one_sigma in sigma.items():
        clean = np.array([float(line[channel]) for line in labels])
        label = np.array([line[f"{channel.rsplit('_', 1)[0]}_label"] for line in labels])
        off = (rows[channel] - clean - injected[name][channel]) / one_sigma
        if channel == "azimuth_deg":
            off = (off + 180 / one_sigma) % (360 / one_sigma) - 180 / one_sigma
        good = label == "none"
        assert abs(off[good].mean()) < 4 / math.sqrt(good.sum())
        assert off[good].std() == pytest.approx(1, abs=0.06)
        assert np.abs(off[~good]).min() > 2  # 6 sigma and up, less the noise
        shares.append(np.mean(~good))
    assert np.mean(shares) == pytest.approx(simulated.OUTLIER_SHARE, abs=0.008)


@pytest.mark.parametrize("name", ["theo-north", "theo-east", "radar-1"])
def test_stamps_are_off_by_the_clock_offset(made, name):
    """The offset is what makes the true range at the stamp fit the labels best."""
    truth = simulated.read_truth(SAMPLE / "truth.csv")
    instrument = next(i for i in simulated.instruments_of(SAMPLE / "station.toml") if i.name == name)
    rows, _ = feed.read(made / f"{name}.csv", name)
    clean_m = np.array([float(line["range_m"]) for line in read_labels(made / f"{name}.labels.csv")])
    range_m = np.linalg.norm(
        ecef(truth["lat_deg"], truth["lon_deg"], truth["alt_m"]) - ecef(*instrument[2:5]), axis=1
    )
    t_s, stamp_s = ((t - truth["t_ns"][0]) * 1e-9 for t in (truth["t_ns"], rows["t_ns"]))
    offsets = np.arange(-0.1, 0.1, 0.001)
    misfit = [np.std(np.interp(stamp_s - c, t_s, range_m) - clean_m) for c in offsets]
    injected = json.loads((made / "injected.json").read_text())[name]["clock_offset_s"]
    assert offsets[np.argmin(misfit)] == pytest.approx(injected, abs=0.002)
    assert min(misfit) < 0.05


def test_clean_feeds_have_noise_only(tmp_path):
    folder = tmp_path / "clean"
    assert make(folder, "--clean").returncode == 0
    injected = json.loads((folder / "injected.json").read_text())
    assert not any(any(injected[name].values()) for name in ("theo-north", "theo-east", "radar-1"))
    text = (folder / "theo-north.labels.csv").read_text()
    assert "isolated" not in text
    assert "patch" not in text


def test_sample_log_agrees_with_its_truth():
    truth = simulated.read_truth(SAMPLE / "truth.csv")
    ins = tlog_flight.ins(tlog.read(SAMPLE / "flight.tlog"))
    ins = ins[np.isfinite(ins["lat_deg"])]
    ins = ins[(ins["t_ns"] > truth["t_ns"][0]) & (ins["t_ns"] < truth["t_ns"][-1])]
    assert len(ins) > 1400
    t_s, at_s = ((t - truth["t_ns"][0]) * 1e-9 for t in (truth["t_ns"], ins["t_ns"]))
    there = ecef(ins["lat_deg"], ins["lon_deg"], ins["alt_msl_m"] + ins["geoid_separation_m"])
    places = ecef(truth["lat_deg"], truth["lon_deg"], truth["alt_m"])
    apart = there - np.stack([np.interp(at_s, t_s, axis) for axis in places.T], -1)
    assert np.sqrt((apart**2).sum(axis=1).mean()) < 2.0


def test_passive_theodolite_has_no_range(truth, tmp_path):
    passive = NORTH._replace(sigma={"azimuth_deg": 0.003, "elevation_deg": 0.003})
    simulated.write(tmp_path, "passive", simulated.observe(truth, passive, np.random.default_rng(1), 0.04))
    rows, bad = feed.read(tmp_path / "passive.csv", "passive")
    assert (tmp_path / "passive.csv").read_text().startswith("t,azimuth_deg,elevation_deg\n")
    assert np.isnan(rows["range_m"]).all()
    assert not bad


def test_another_instrument_changes_no_other(truth):
    alone = simulated.observe_all(truth, [NORTH], 3)
    both = simulated.observe_all(truth, [NORTH, RADAR], 3)
    np.testing.assert_array_equal(alone["north"].values, both["north"].values)


def test_live_stream_is_the_file_in_time_order(truth, tmp_path):
    bus = FakeBus()
    simulated.run(bus, truth, [NORTH, RADAR], 3, threading.Event(), speed=math.inf)
    assert bus.alive == ["north", "radar"]
    times = [message.t_ns for _, _, message in bus.sent]
    assert times == sorted(times)
    for name, seen in simulated.observe_all(truth, [NORTH, RADAR], 3).items():
        simulated.write(tmp_path, name, seen)
        rows, _ = feed.read(tmp_path / f"{name}.csv", name)
        live = [message for _, source, message in bus.sent if source == name]
        assert live == list(feed.measurements(rows))
        assert isinstance(live[0], PolarMeasurement)


def test_truth_in_boot_time_needs_the_log(tmp_path):
    path = tmp_path / "truth.csv"
    path.write_text("TimeUS,lat_deg,lon_deg,alt_m,roll_deg\n28024619,-35.36,149.16,584.09,0\n")
    with pytest.raises(feed.FeedError, match="--tlog"):
        simulated.read_truth(path)
    (row,) = simulated.read_truth(path, boot_to_utc_ns=simulate.T0_NS)
    assert row.tolist() == (simulate.T0_NS + 28_024_619_000, -35.36, 149.16, 584.09)


def test_a_feed_is_no_truth():
    with pytest.raises(feed.FeedError, match=r"theo-north.csv:1: a truth file has"):
        simulated.read_truth(SAMPLE / "theo-north.csv")


def test_command_refuses_in_one_line(tmp_path):
    refused = make(tmp_path / "out", truth=tmp_path / "nowhere.csv")
    assert refused.returncode == 2
    (line,) = refused.stderr.splitlines()
    assert "nowhere.csv" in line


def test_a_folder_that_cannot_be_written_is_named(tmp_path, truth):
    (tmp_path / "file").touch()
    with pytest.raises(InputError, match=r"file: .*name a folder"):
        simulated.write_all(tmp_path / "file", truth, [NORTH], 3, 0.04)


def test_a_leaning_mount_is_simulated_as_the_station_reads_it(truth, tmp_path):
    """Without noise, what the instrument reads lies on the truth once its mount is taken into account."""
    text = (SAMPLE / "station.toml").read_text(encoding="utf-8")
    lean = "tilt_deg = { east = 1.5, north = -0.7 }\norientation_deg = 40.0\n"
    path = tmp_path / "station.toml"
    path.write_text(text.replace('refraction = "optical"', lean, 1), encoding="utf-8")
    sensor, instrument = config.load(path).sensor[0], simulated.instruments_of(path)[0]
    exact = instrument._replace(sigma=dict.fromkeys(LASER, 0.0))
    seen = simulated.observe(truth, exact, np.random.default_rng(1), share=0.0)
    frame = Frame(-35.36, 149.17, 700.0)
    t_s, at_s = ((t - truth["t_ns"][0]) * 1e-9 for t in (truth["t_ns"], seen.t_ns))
    there = frame.to_enu(truth["lat_deg"], truth["lon_deg"], truth["alt_m"])
    expected = np.stack([np.interp(at_s, t_s, axis) for axis in there.T], -1)
    np.testing.assert_allclose(
        polar_to_enu(*seen.values.T[:3], *frame.place_sensor(sensor)), expected, atol=0.05
    )
