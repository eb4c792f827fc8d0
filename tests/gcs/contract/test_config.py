"""The station file: what is refused, where the line points, and that a resolved file is the same station."""

from pathlib import Path

import pytest

from gcs.contract import config
from gcs.contract.messages import InputError

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
        ("lat_deg = -35.35,", "lat_deg = 95.0,", 10, "<= 90"),
        ("azimuth_deg = 0.003", "azimuth_rad = 0.003", 11, "azimuth_deg, elevation_deg, range_m"),
        ('"demo"', '"De mo"', 2, "range.name"),
        ('"optical"', '"glass"', 14, "none, optical, radar"),
        ('["bias", "clock"]', '["drift"]', 13, "bias, clock"),
        ("[vehicle]", "[vehicel]", 4, "vehicle"),
        ('name = "radar-1"', 'name = "theo-north"', 16, "taken"),
        ('kind = "radar"\n', "", 15, "`kind`"),
        ("system_id = 1", "system_id = = 1", 6, "not TOML"),
        ("system_id = 1", "system_id = 300", 6, "<= 255"),
        ("sigma = { range_m = 1.0", "sigma = { range_m = -1.0", 11, "> 0"),
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
