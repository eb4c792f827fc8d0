"""The plots: few points, none of them refused lost, and what was flown."""

import msgspec
import numpy as np
import pytest

from gcs.contract.messages import Health, SystematicError
from tests.web.flight import START_NS, messages
from tests.web.memory.made import claim
from tests.web.memory.test_flight import flown
from web.plots import curves
from web.plots.curves import CLIP, MOST, thinned

S = 1_000_000_000
ALL = (0, START_NS + 10**6 * S)


@pytest.mark.parametrize("choice", curves.CHOICES)
def test_no_plot_has_more_points_than_it_may(choice):
    flight = flown(120.0)
    made = curves.plots(choice, flight, *ALL)
    assert made or choice == curves.ERRORS  # this flight's station estimates none
    for plot in made:
        assert 2 <= len(plot.x_s) <= MOST + len(flight.residuals.sensors()) + 1
        assert all(len(curve.y) == len(plot.x_s) for curve in plot.curves)
        assert (np.diff(plot.x_s) > 0).all()


@pytest.mark.parametrize("choice", curves.CHOICES)
def test_before_the_first_data_there_is_no_plot(choice):
    flight = flown(1.0)
    flight.clear()
    assert curves.plots(choice, flight, *ALL) == []


def test_thinning_keeps_what_is_wanted():
    wanted = np.zeros(5000, bool)
    wanted[::40] = True
    kept = thinned(5000, wanted)
    assert len(kept) <= MOST
    assert set(np.flatnonzero(wanted)) <= set(kept)
    assert (np.diff(kept) > 0).all()


def test_residuals_are_in_sigmas_refused_apart_and_clipped():
    flight = flown(1.0)
    flight.clear()
    flight.residuals.add(claim(1 * S, "theo-north", {"range": (2.0, 1.0, 0.5), "azimuth": (1.0, 1.0, 0.1)}))
    flight.residuals.add(claim(2 * S, "theo-north", {"range": (99.0, 1.0, 0.5, "patch")}))
    plot = curves.residuals(flight, "theo-north", ["range", "azimuth"], 0, 9 * S)
    by_label = {curve.label: curve.y for curve in plot.curves}
    np.testing.assert_array_equal(by_label["range"], [2.0, np.nan])
    np.testing.assert_array_equal(by_label["azimuth"], [0.0, np.nan])
    np.testing.assert_array_equal(by_label["refused"], [np.nan, CLIP])


def test_the_ins_has_a_plot_for_position_and_none_for_what_it_does_not_send():
    titles = [plot.title for plot in curves.plots(curves.RESIDUALS, flown(10.0), *ALL)]
    assert titles == ["theo-north", "theo-south", "radar-west", "ins e"]


def test_height_is_that_of_the_states_at_their_times():
    flight = flown(10.0)
    height = curves.plots(curves.TRACK, flight, *ALL)[0]
    fused = next(curve for curve in height.curves if curve.label == "fused")
    rows = flight.newest.view[::2]  # so many are drawn
    at = np.interp(rows["t_ns"] / 1e9 - START_NS / 1e9, height.x_s, fused.y)
    np.testing.assert_allclose(at, rows["position_enu_m"][:, 2], atol=1e-3)


def test_errors_have_a_band_of_one_sigma_and_clocks_are_in_milliseconds():
    flight = flown(2.0)
    health = next(m for m, _ in messages(1.0) if isinstance(m, Health))
    clock = SystematicError(value=0.02, sigma=0.005, unit="s", known=True)
    for k in range(3):
        radar = msgspec.structs.replace(health.sensors["radar-west"], errors={"clock": clock})
        flight.take(Health(t_ns=START_NS + k * S, sensors={"radar-west": radar}), "")
    (plot,) = curves.plots(curves.ERRORS, flight, *ALL)
    high, low, value = plot.curves
    assert plot.title == "clock, ms"
    np.testing.assert_allclose((low.y[0], value.y[0], high.y[0]), (15.0, 20.0, 25.0))


@pytest.mark.parametrize(
    ("y", "log", "ends"),
    [
        ([np.nan, 12.0, 67.0], False, (10.0, 70.0)),
        ([0.03, np.nan, 5.0], True, (0.01, 10.0)),
        ([np.nan], False, (0.1, 1.0)),
    ],
)
def test_the_axis_reaches_round_numbers_whatever_is_missing(y, log, ends):
    curve = curves.Curve("c", (0, 0, 0), curves.DOTS, np.array(y))
    np.testing.assert_allclose(curves.reach(curves.Plot("p", np.arange(len(y)), [curve], log=log)), ends)
