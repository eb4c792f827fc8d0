"""The position in every form, against closed forms."""

import pytest

from gcs.contract.messages import State
from tests.web.flight import SCENE, messages
from web.panel import place

STATE = next(m for m, source in messages(3.0) if isinstance(m, State) and source == "")


def test_every_instrument_is_a_form():
    assert place.forms(SCENE)[2:] == ["theo-north", "theo-south", "radar-west"]


def test_local_and_geodetic_are_the_state_s_own():
    assert place.text(SCENE, STATE, place.LOCAL)[2] == ("Up", f"{STATE.position_enu_m[2]:.2f} m")
    assert place.text(SCENE, STATE, place.GEODETIC)[0] == ("latitude", f"{STATE.lat_deg:.7f}°")


@pytest.mark.parametrize("form", ["theo-north", "radar-west"])
def test_an_instrument_is_told_where_to_point(form):
    stand = next(one.position_enu_m for one in SCENE.instruments if one.name == form)
    away = [p - q for p, q in zip(STATE.position_enu_m, stand, strict=True)]
    values = [float(value.rstrip(" m°")) for _, value in place.text(SCENE, STATE, form)]
    assert abs(values[0] - sum(a * a for a in away) ** 0.5) < 0.1


def test_before_the_first_state_there_is_nothing_to_copy():
    assert "no position yet" in place.block(SCENE, None, place.LOCAL, old=False)
    assert "onclick" in place.block(SCENE, STATE, place.LOCAL, old=False)
