"""Frames against pymap3d's own direct route, and there and back."""

import numpy as np
import pymap3d

from gcs.contract.config import Position
from gcs.contract.frames import Frame, polar_to_enu

FRAME = Frame(-35.363261, 149.165230, 584.0)
TARGET = (-35.37, 149.2, 900.0)


def test_there_and_back():
    enu = np.array([[1200.0, -3400.0, 250.0], [0.0, 0.0, 0.0]])
    lat, lon, alt = FRAME.to_geodetic(enu)
    np.testing.assert_allclose(FRAME.to_enu(lat, lon, alt), enu, atol=1e-6)


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
