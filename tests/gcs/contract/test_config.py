"""The station file: what is refused, where the line points, and that a resolved file is the same station."""

from pathlib import Path

import msgspec
import numpy as np
import pytest

from filters.models import theodolite
from filters.models.rows import Sensor
from filters.models.settings import Settings
from gcs.contract import config, limits
from gcs.contract.messages import InputError
from gcs.station.intake import settings_of

STATION = """\
[range]
name = "demo"
origin = { lat_deg = -35.3632, lon_deg = 149.1652, alt_m = 584.0 }
[vehicle]
name = "uav1"
system_id = 1
[[sensor]]
name = "theo-north"
kind = "theodolite"
position = { lat_deg = -35.35, lon_deg = 149.16, alt_m = 640.0 }
sigma = { range_m = 1.0, azimuth_deg = 0.003, elevation_deg = 0.003 }
latency_s = 0.0
estimate = ["bias", "clock"]
refraction = "optical"
[[sensor]]
name = "radar-1"
kind = "radar"
position = { lat_deg = -35.36, lon_deg = 149.17, alt_m = 600.0 }
"""


@pytest.fixture
def write(tmp_path):
    def write(text: str) -> Path:
        path = tmp_path / "station.toml"
        path.write_text(text, encoding="utf-8")
        return path

    return write


def test_reads_the_contract(write):
    station = config.load(write(STATION))
    assert station.range.origin.alt_m == 584.0
    assert station.sensor[0].estimate == ["bias", "clock"]
    assert station.sensor[0].sigma_by_channel == {"range": 1.0, "azimuth": 0.003, "elevation": 0.003}
    assert set(station.sensor[1].sigma_by_channel) == {"range", "azimuth", "elevation", "range_rate"}


def test_resolved_file_is_the_same_station(write):
    station = config.load(write(STATION), ["ins.height_m=2.5"])
    assert config.load(write(config.dump(station))) == station


@pytest.mark.parametrize(
    ("old", "new", "line", "said"),
    [
        ("latency_s", "latncy_s", 12, "valid names are estimate, kind, latency_s"),
        ("lat_deg = -35.35,", "lat_deg = 95.0,", 10, "95.0 cannot be; valid is a number from -90 to 90"),
        ("azimuth_deg = 0.003", "azimuth_rad = 0.003", 11, "azimuth_deg, elevation_deg, range_m"),
        ('"demo"', '"De mo"', 2, "range.name"),
        ('"optical"', '"glass"', 14, "none, optical, radar"),
        ('["bias", "clock"]', '["drift"]', 13, "bias, clock"),
        ("[vehicle]", "[vehicel]", 4, "vehicle"),
        ('name = "radar-1"', 'name = "theo-north"', 16, "taken"),
        ('kind = "radar"\n', "", 15, "`kind`"),
        ("system_id = 1", "system_id = = 1", 6, "not TOML"),
        ("system_id = 1", "system_id = 300", 6, "valid is a whole number from 1 to 255"),
        ("sigma = { range_m = 1.0", "sigma = { range_m = -1.0", 11, "valid is a number from 1e-06 to 1000"),
        ("range_m = 1.0, azimuth", "range_m = 1e-300, azimuth", 11, "valid is a number from 1e-06 to 1000"),
        ("latency_s = 0.0", "latency_s = { range_m = 99 }", 12, "latency_s.range_m: 99 cannot be"),
        ("latency_s = 0.0", 'latency_s = "abc"', 12, "a number from -10 to 10, or a table of azimuth_deg"),
        ("latency_s = 0.0", "tilt_deg = { east = 90 }", 12, "tilt_deg.east: 90 cannot be"),
        (
            "latency_s = 0.0",
            "prior = { slow = -0.1 }",
            12,
            "prior.slow: -0.1 cannot be; valid is a number from 0",
        ),
        ("latency_s = 0.0", "prior = { slow = 10.1 }", 12, "valid is a number from 0 to 10"),
        ("latency_s = 0.0", "prior = { slow_s = 1.0 }", 12, "elevation_deg, range_m, slow"),
        ("latency_s = 0.0", "# latency_s = 0\nlatency_s = 99", 13, "99 cannot be"),
        ('name = "uav1"', "height_m = { mean = 10.0 }", 5, "sigma"),
        ('name = "uav1"', "height_m = { mean = 10.0, sigma = nan }", 5, "sigma: nan cannot be"),
        ("[vehicle]", "[filter]\ncell_s = 0\n[vehicle]", 5, "'cell_s'; valid names are gust_psd, ins_bias"),
        ("[vehicle]", "[filter]\nlag_scans = -1\n[vehicle]", 5, "lag_scans: -1 cannot be; valid is a number"),
        ("[vehicle]", '[filter]\njerk_psd = "abc"\n[vehicle]', 5, "from 0.001 to 100000"),
        ("[vehicle]", "[filter]\nlongest_lag_s = 0.5\n[vehicle]", 4, "must not be below shortest_lag_s"),
        ("[vehicle]", "[view]\nport = 99999\n[vehicle]", 5, "from 1 to 65535"),
    ],
)
def test_refusal_names_file_line_and_remedy(write, old, new, line, said):
    assert old in STATION
    path = write(STATION.replace(old, new, 1))
    with pytest.raises(InputError) as refused:
        config.load(path)
    text = str(refused.value)
    assert text.startswith(f"{path}:{line}: ")
    assert said in text
    assert "\n" not in text


def test_missing_file_and_bad_override(tmp_path, write):
    with pytest.raises(InputError, match="no such station file"):
        config.load(tmp_path / "nowhere.toml")
    path = write(STATION)
    assert config.load(path, ["sensor.radar-1.latency_s=0.25"]).sensor[1].latency_s == 0.25
    with pytest.raises(InputError, match="radar-1, theo-north"):
        config.load(path, ["sensor.theo-west.latency_s=0.25"])
    with pytest.raises(InputError, match="KEY=VALUE"):
        config.load(path, ["height"])
    with pytest.raises(InputError, match="height_m"):
        config.load(path, ["ins.hight_m=2"])


@pytest.mark.parametrize(
    "override", ["filter.lag_scans=abc", "filter.gust_psd=-1", "filter.cell_s=0", "filter=3"]
)
def test_a_setting_given_with_an_option_is_refused_by_that(write, override):
    with pytest.raises(InputError, match=r"^--config " + override + ": .*valid") as refused:
        config.load(write(STATION), [override])
    assert "\n" not in str(refused.value)


def test_latency_of_every_channel(write):
    text = STATION.replace("latency_s = 0.0", "latency_s = { range_m = 0.06, elevation_deg = 0.01 }")
    station = config.load(write(text))
    late = {"range": 0.06, "azimuth": 0.0, "elevation": 0.01, "range_rate": 0.0}
    assert station.sensor[0].latency_by_channel == late
    assert set(station.sensor[1].latency_by_channel.values()) == {0.0}
    assert config.load(write(config.dump(station))) == station


def test_slow_errors_of_an_instrument(write):
    """As large as the noise where the file is silent; 0 is none."""
    text = STATION.replace("latency_s = 0.0", "prior = { slow = 0 }")
    station = config.load(write(text), ["sensor.radar-1.prior.slow=2.5"])
    assert [sensor.prior.slow for sensor in station.sensor] == [0.0, 2.5]
    assert [sensor.prior.slow for sensor in config.load(write(STATION)).sensor] == [1.0, 1.0]
    assert config.load(write(config.dump(station))) == station


def test_every_setting_says_where_it_comes_from(write):
    path = write(STATION)
    found = {s.name: s for s in config.resolved(path, ["filter.lag_scans=4"])}
    assert found["filter.lag_scans"][1:] == (4.0, "--config")
    assert found["filter.jerk_psd"][1:] == (10.0, "default")
    assert found["sensor.theo-north.sigma.azimuth_deg"][1:] == (0.003, f"{path}:11")
    assert found["sensor.radar-1.sigma.range_m"][1:] == (5.0, "default of its kind")
    assert found["sensor.radar-1.kind"][1:] == ("radar", f"{path}:17")
    assert found["range.origin.alt_m"].source == f"{path}:3"


def test_the_filter_section_is_what_the_estimator_takes():
    """One default in two places: the contract may not import the mathematics, which has its own."""
    own = dict(zip(Settings._fields, Settings(), strict=True))
    not_here = {"height_m", "height_sigma_m"}  # [vehicle] height_m, which is ellipsoidal
    assert msgspec.structs.asdict(config.FilterSection()) == {
        k: v for k, v in own.items() if k not in not_here
    }
    assert settings_of(config.Station()) == pytest.approx(Settings(), nan_ok=True)


def test_priors_and_refraction_are_those_of_the_mathematics():
    prior = config.SensorPrior()
    zero = prior.range_m, np.radians(prior.azimuth_deg), np.radians(prior.elevation_deg)
    assert zero == pytest.approx(theodolite.ZERO_SIGMA)
    assert prior.clock_s == theodolite.CLOCK_SIGMA_S
    assert prior.slow == Sensor._field_defaults["slow"]
    kind = msgspec.inspect.type_info(config.SensorSection).fields
    (refraction,) = (field.type for field in kind if field.name == "refraction")
    assert set(refraction.type.values) == set(theodolite.REFRACTION)


def test_noise_has_the_limits_of_the_wire():
    """What a feed's row may state is what the station file may."""
    for field in msgspec.inspect.type_info(config.SensorSigma).fields:
        number = next(k for k in field.type.type.types if isinstance(k, msgspec.inspect.FloatType))
        assert (number.ge, number.le) == limits.SIGMA[field.name]
