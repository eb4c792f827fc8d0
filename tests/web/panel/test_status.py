"""The head of the panel: what it must say, and what it must never hide."""

import msgspec
import pytest

from gcs.contract.messages import State, Wind
from tests.web.flight import SCENE, messages
from web.look.colours import GOOD
from web.panel import status

STATE = next(m for m, source in messages(3.0) if isinstance(m, State) and source == "")
WIND = Wind(
    t_ns=STATE.t_ns, speed_mps=8.04, from_deg=310.2, e_mps=6.1, n_mps=-5.2,
    covariance=(0.1, 0.0, 0.1), known=True, airspeed_scale=1.02,
)  # fmt: skip


@pytest.mark.parametrize(
    ("state", "age_s", "mode", "text"),
    [
        (None, 1e6, "LIVE", "WAITING FOR DATA"),
        (STATE, 0.1, "LIVE", "LIVE"),
        (STATE, 3.21, "LIVE", "DATA 3.2 s OLD"),
        (STATE, 3.21, "REPLAY 1×", "DATA 3.2 s OLD"),
        (STATE, 60.0, "PAUSED", "PAUSED"),
        (STATE, 0.1, "BACK 12 s", "BACK 12 s"),
        (msgspec.structs.replace(STATE, quality=-1), 0.1, "LIVE", "STATE FAILED"),
    ],
)
def test_the_badge_says_what_to_believe(state, age_s, mode, text):
    assert status.badge(state, age_s, mode)[0] == text


def test_every_write_differs_so_that_silence_shows():
    assert status.head(SCENE, STATE, "LIVE", GOOD, 1) != status.head(SCENE, STATE, "LIVE", GOOD, 2)


def test_a_wind_that_the_flight_has_not_shown_has_no_number():
    said = status.numbers(STATE, WIND, old=False)
    assert "8.0 m/s" in said
    assert "from <b>310°" in said
    guess = status.numbers(STATE, msgspec.structs.replace(WIND, known=False), old=False)
    assert "not known yet" in guess
    assert "8.0" not in guess
    assert "wind" not in status.numbers(STATE, None, old=False)


def test_an_old_wind_is_struck_through():
    later = msgspec.structs.replace(STATE, t_ns=WIND.t_ns + 12_000_000_000)
    said = status.numbers(later, WIND, old=False)
    assert "12 s old" in said
    assert '<span class="old">wind' in said


def test_old_numbers_are_struck_through():
    assert 'class="old"' in status.numbers(STATE, None, old=True)
    assert 'class="old"' not in status.numbers(STATE, None, old=False)


def test_doubt_is_told_in_plain_words():
    assert "nothing bounds the error" in status.trust(STATE)
    held = msgspec.structs.replace(STATE, protection_h_m=3.24, protection_v_m=5.06, ambiguous=True)
    said = status.numbers(held, None, old=False)
    assert "within <b>3.2 m</b>, height within <b>5.1 m</b>, even if one sensor lies" in said
    assert "two positions fit" in said
    assert "two positions fit" not in status.trust(msgspec.structs.replace(held, ambiguous=False))


def test_go_needs_a_limit_and_no_alarm():
    assert "within all limits" in status.go([], [], demanded=True)
    assert "within all limits" not in status.go([], [], demanded=False)
    said = status.go(["a", "b", "c", "<d>", "e"], ["radar off"], demanded=True)
    assert "within all limits" not in said
    assert "and 2 more" in said
    assert "radar off" in said


def test_without_data_the_page_says_what_to_do():
    said = status.numbers(None, None, old=False)
    assert "gcs bridge" in said
    assert "gcs doctor" in said
