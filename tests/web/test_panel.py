"""What the panel says, and what it must never hide."""

import msgspec
import pytest

from gcs.contract.messages import Event, Health, State, Wind
from tests.web.flight import SCENE, START_NS, messages
from web import panel
from web.colours import GOOD

FLOWN = [message for message, source in messages(3.0) if source == ""]
STATE = next(m for m in FLOWN if isinstance(m, State))
HEALTH = next(m for m in FLOWN if isinstance(m, Health))


@pytest.mark.parametrize(
    ("state", "age_s", "mode", "text"),
    [
        (None, 1e6, "LIVE", "WAITING FOR DATA"),
        (STATE, 0.1, "LIVE", "LIVE"),
        (STATE, 3.21, "LIVE", "DATA 3.2 s OLD"),
        (STATE, 3.21, "REPLAY 1×", "DATA 3.2 s OLD"),
        (STATE, 60.0, "PAUSED", "PAUSED"),
        (msgspec.structs.replace(STATE, quality=-1), 0.1, "LIVE", "STATE FAILED"),
    ],
)
def test_the_badge_says_what_to_believe(state, age_s, mode, text):
    assert panel.badge(state, age_s, mode)[0] == text


def test_the_clock_is_utc_with_tenths():
    assert panel.clock(1_790_000_000_250_000_000) == "14:13:20.2"  # date -u -d @1790000000


def test_every_write_differs_so_that_silence_shows():
    assert panel.status(SCENE, STATE, None, "LIVE", GOOD, 1) != panel.status(
        SCENE, STATE, None, "LIVE", GOOD, 2
    )


def test_the_wind_says_where_from_and_whether_it_is_known():
    wind = Wind(
        t_ns=STATE.t_ns, speed_mps=8.04, from_deg=310.2, e_mps=6.1, n_mps=-5.2,
        covariance=(0.1, 0.0, 0.1), known=True, airspeed_scale=1.02,
    )  # fmt: skip
    said = panel.status(SCENE, STATE, wind, "LIVE", GOOD, 1)
    assert "8.0 m/s" in said
    assert "from <b>310°" in said
    assert "not yet known" not in said
    assert "not yet known" in panel.air(msgspec.structs.replace(wind, known=False), STATE.t_ns)
    assert "12 s old" in panel.air(wind, STATE.t_ns + 12_000_000_000)
    assert "wind" not in panel.status(SCENE, STATE, None, "LIVE", GOOD, 1)


def test_doubt_is_told_in_plain_words():
    assert panel.doubt(STATE) == ""
    held = msgspec.structs.replace(STATE, protection_h_m=3.24, protection_v_m=5.06, ambiguous=True)
    said = panel.status(SCENE, held, None, "LIVE", GOOD, 1)
    assert "within <b>3.2 m</b>, height within <b>5.1 m</b>, even if one sensor lies" in said
    assert "two positions fit" in said
    assert "two positions fit" not in panel.doubt(msgspec.structs.replace(held, ambiguous=False))


def test_a_sensor_says_rate_share_and_delay():
    html = panel.sensors(SCENE, HEALTH, STATE)
    for text in ("theo-south", "20.0", "8.3%", "120"):
        assert text in html


@pytest.mark.parametrize(
    ("change", "word"), [({"alive": False}, "gone"), ({"age_s": 9.0}, "silent"), ({"age_s": None}, "waiting")]
)
def test_a_lost_sensor_is_called_so(change, word):
    radar = msgspec.structs.replace(HEALTH.sensors["radar-west"], **change)
    health = msgspec.structs.replace(HEALTH, sensors={"radar-west": radar})
    assert word in panel.sensors(SCENE, health, None)
    assert word not in panel.sensors(SCENE, HEALTH, None)


def test_a_station_that_falls_behind_says_so():
    behind = msgspec.structs.replace(HEALTH, queue_age_s=4.2)
    assert "wait 4.2 s" in panel.sensors(SCENE, behind, None)
    assert "wait" not in panel.sensors(SCENE, HEALTH, None)


def test_skipped_messages_are_told():
    assert "skipped 12 messages" in panel.events([], 12)


def test_names_from_outside_are_text_not_html():
    event = Event(t_ns=START_NS, level="info", text="<script>alert(1)</script>")
    assert "<script>" not in panel.events([event], 0)
