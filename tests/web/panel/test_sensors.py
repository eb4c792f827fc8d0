"""The table of sensors: every condition by its name, every old number struck through."""

import msgspec
import pytest

from gcs.contract.messages import Health, SystematicError
from tests.web.flight import SCENE, messages
from web.panel import sensors
from web.panel.limits import OperatorLimits

HEALTH = next(m for m, _ in messages(3.0) if isinstance(m, Health))


def table(health: Health | None, age_s: float = 0.0) -> str:
    return sensors.rows(SCENE, health, None, OperatorLimits(), age_s)


def test_a_sensor_says_rate_share_and_delay():
    for text in ("theo-south", "20.0", "8.3%", "120"):
        assert text in table(HEALTH)
    assert "no sensor has reported" in table(None)


@pytest.mark.parametrize(
    ("change", "word"), [({"alive": False}, "gone"), ({"age_s": 9.0}, "silent"), ({"age_s": None}, "waiting")]
)
def test_a_lost_sensor_is_called_so(change, word):
    radar = msgspec.structs.replace(HEALTH.sensors["radar-west"], **change)
    assert word in table(msgspec.structs.replace(HEALTH, sensors={"radar-west": radar}))
    assert word not in table(HEALTH)


def test_a_station_that_falls_behind_says_so():
    assert "wait 4.2 s" in table(msgspec.structs.replace(HEALTH, queue_age_s=4.2))
    assert "wait" not in table(HEALTH)


def test_old_health_is_struck_through_and_its_age_told():
    assert 'class="old"' not in table(HEALTH)
    assert "these numbers are 8 s old" in table(HEALTH, 8.0)
    assert 'class="old"' in table(HEALTH, 8.0)


def test_the_errors_tell_value_sigma_and_whether_they_are_shown():
    zero = SystematicError(value=-0.0081, sigma=0.0012, unit="deg", known=True)
    clock = SystematicError(value=0.02, sigma=0.054, unit="s", known=False)

    def said(**errors: SystematicError) -> str:
        radar = msgspec.structs.replace(HEALTH.sensors["radar-west"], errors=errors)
        return sensors.errors(SCENE, msgspec.structs.replace(HEALTH, sensors={"radar-west": radar}))

    assert "azimuth -0.0081 ± 0.0012 °" in said(azimuth=zero)
    assert "calibrated" in said(azimuth=zero)
    assert "clock 20 ± 54 ms" in said(azimuth=zero, clock=clock)
    assert "1 of 2 shown by the flight" in said(azimuth=zero, clock=clock)
    assert "no errors are estimated" in said()


def test_a_share_turns_amber_before_its_limit():
    limits = OperatorLimits(refused_share=0.2)
    shades = [sensors.share_colour(share, limits) for share in (0.04, 0.1, 0.3)]
    assert shades[0] is None
    assert len(set(shades)) == 3
    assert sensors.share_colour(0.9, OperatorLimits(refused_share=0.0)) is None
