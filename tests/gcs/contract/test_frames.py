"""Frames against pymap3d's own direct route, and there and back."""

import numpy as np
import pymap3d
import pytest

from gcs.contract.config import MountTilt, Position, SensorSection
from gcs.contract.frames import Frame, ecef_to_geodetic, geodetic_to_ecef, mount, polar_to_enu

FRAME = Frame(-35.363261, 149.165230, 584.0)
TARGET = (-35.37, 149.2, 900.0)


def test_there_and_back():
    enu = np.array([[1200.0, -3400.0, 250.0], [0.0, 0.0, 0.0]])
    lat, lon, alt = FRAME.to_geodetic(enu)
    np.testing.assert_allclose(FRAME.to_enu(lat, lon, alt), enu, atol=1e-6)


def test_everywhere_on_earth_to_some_nanometres():
    """Forward as pymap3d does it, and back again; a double tells 1 nm apart so far from the centre."""
    lat, lon = (
        grid.ravel() for grid in np.meshgrid(np.linspace(-90.0, 90.0, 181), np.linspace(-180.0, 180.0, 73))
    )
    for alt in (-5_000.0, 0.0, 12_000.0, 60_000.0):
        ecef = geodetic_to_ecef(lat, lon, alt)
        np.testing.assert_allclose(
            ecef, np.stack(pymap3d.geodetic2ecef(lat, lon, alt), axis=-1), atol=1e-8, rtol=0.0
        )
        back = geodetic_to_ecef(*ecef_to_geodetic(ecef))
        np.testing.assert_allclose(back, ecef, atol=2e-8, rtol=0.0)


def test_what_is_no_number_stays_alone():
    lat, _, alt = FRAME.to_geodetic(np.array([[0.0, 0.0, np.nan], [0.0, 0.0, 1.0]]))
    assert np.isnan(lat[0])
    assert np.isnan(alt[0])
    assert alt[1] == pytest.approx(FRAME.alt_m + 1.0)


def test_instrument_frame_is_pymap3ds_own():
    """Azimuth, elevation and range straight from geodesy, 3 km away on a curved Earth, land on the target."""
    site = Position(lat_deg=-35.35, lon_deg=149.16, alt_m=640.0)
    azimuth, elevation, slant = pymap3d.geodetic2aer(*TARGET, site.lat_deg, site.lon_deg, site.alt_m)
    seen = polar_to_enu(slant, np.radians(azimuth), np.radians(elevation), *FRAME.place(site))
    np.testing.assert_allclose(seen, FRAME.to_enu(*TARGET), atol=1e-6)


def test_velocity_is_turned_as_finite_differences_say():
    """Moving 1 m along local east at the target is FRAME's vector between the two positions."""
    moved = pymap3d.enu2geodetic(1.0, 0.5, -0.25, *TARGET)
    turned = FRAME.turn(np.array([[1.0, 0.5, -0.25]]), np.array([TARGET[0]]), np.array([TARGET[1]]))
    np.testing.assert_allclose(turned[0], FRAME.to_enu(*moved) - FRAME.to_enu(*TARGET), atol=1e-6)


def seen_by(rotation: np.ndarray, azimuth_deg: float, elevation_deg: float) -> tuple[float, float]:
    """What an instrument reads, degrees, of a direction in level ENU."""
    azimuth, elevation = np.radians([azimuth_deg, elevation_deg])
    level = np.array(
        [np.cos(elevation) * np.sin(azimuth), np.cos(elevation) * np.cos(azimuth), np.sin(elevation)]
    )
    east, north, up = rotation @ level
    return float(np.degrees(np.arctan2(east, north)) % 360.0), float(np.degrees(np.arcsin(up)))


@pytest.mark.parametrize(
    ("azimuth", "east", "north", "higher"),
    [(90.0, 2.0, 0.0, 2.0), (270.0, 2.0, 0.0, -2.0), (0.0, 0.0, 3.0, 3.0), (0.0, 2.0, 0.0, 0.0)],
)
def test_a_target_where_the_mount_leans_reads_higher(azimuth, east, north, higher):
    assert seen_by(mount(east, north, 0.0), azimuth, 10.0)[1] == pytest.approx(10.0 + higher, abs=0.02)


def test_true_azimuth_is_the_reading_plus_the_orientation():
    assert seen_by(mount(0.0, 0.0, 30.0), 75.0, 10.0) == pytest.approx((45.0, 10.0))
    np.testing.assert_array_equal(mount(0.0, 0.0, 0.0), np.eye(3))


def test_there_and_back_through_a_leaning_mount():
    """A target as the mount's own axes see it, by rotations about the axes one after the other."""
    site = Position(lat_deg=-35.35, lon_deg=149.16, alt_m=640.0)
    tilt = MountTilt(east=1.5, north=0.0)
    sensor = SensorSection(name="theo", kind="theodolite", position=site, tilt_deg=tilt, orientation_deg=20.0)
    e, n, u = pymap3d.geodetic2enu(*TARGET, site.lat_deg, site.lon_deg, site.alt_m)
    lean, turn = np.radians([1.5, 20.0])
    e, u = e * np.cos(lean) - u * np.sin(lean), u * np.cos(lean) + e * np.sin(lean)
    e, n = e * np.cos(turn) - n * np.sin(turn), n * np.cos(turn) + e * np.sin(turn)
    azimuth, elevation, slant = np.arctan2(e, n), np.arctan2(u, np.hypot(e, n)), np.linalg.norm([e, n, u])
    seen = polar_to_enu(slant, azimuth, elevation, *FRAME.place_sensor(sensor))
    np.testing.assert_allclose(seen, FRAME.to_enu(*TARGET), atol=1e-6)
