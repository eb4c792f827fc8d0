"""Stamps held against values: made-up instruments around a made-up flight, whose clocks are known."""

import numpy as np
import pytest

from gcs.station.sources.courses import S, Sightings
from gcs.station.sources.stamps import check

T0_NS = 1_767_225_600 * S
SITES = {"theo-a": (1200.0, 0.0, 0.0), "theo-b": (0.0, 1300.0, 10.0), "radar": (-1000.0, -800.0, 0.0)}
SIGMA = np.array([1.0, np.radians(0.003), np.radians(0.003)])
SECONDS = 120.0


def flown(t_s):
    """(n, 3) a course with turns, 20 m/s and more."""
    return np.column_stack([500 * np.sin(t_s / 20), 400 * np.sin(t_s / 13 + 1), 150 + 50 * np.sin(t_s / 17)])


def own(ahead=lambda t_s: 0.0 * t_s, course=flown, seed=1):
    """The aircraft's own: every 0.1 s, some metres off in a slow way."""
    t_s = np.arange(0.0, SECONDS, 0.1)
    slow = 3.0 * np.column_stack([np.sin(t_s / 30 + k + seed) for k in range(3)])
    stamps = T0_NS + np.rint((t_s + ahead(t_s)) * S).astype(np.int64)
    return Sightings(stamps, course(t_s) + slow, np.array([1.0, 1.0, 2.0]), polar=False)


def sightings(name, ahead=lambda t_s: 0.0 * t_s, course=flown, share=0.15, rate_hz=20.0):
    """What an instrument saw, stamped ``ahead`` of the truth, some of it wrong in patches of a second."""
    rng = np.random.default_rng(len(name))
    t_s = np.arange(0.0, SECONDS, 1.0 / rate_hz)
    e, n, u = (course(t_s) - SITES[name]).T
    level = np.hypot(e, n)
    values = np.column_stack([np.hypot(level, u), np.arctan2(e, n), np.arctan2(u, level)])
    values += SIGMA * rng.normal(size=values.shape)
    wrong = (rng.random(int(SECONDS) + 1) < share)[t_s.astype(int)]
    values[wrong] *= 1.1
    stamps = T0_NS + np.rint((t_s + ahead(t_s)) * S).astype(np.int64)
    return Sightings(stamps, values, SIGMA, np.array(SITES[name]), np.eye(3)), t_s


def tried(ins=None, course=flown, names=tuple(SITES), share=0.15, **ahead):
    """(shares refused by name, findings)"""
    seen = {
        n: sightings(n, ahead.get(n.replace("-", "_"), lambda t: 0.0 * t), course, share)[0] for n in names
    }
    found = check({"ins": ins or own(course=course)} | seen)
    return {name: float(found.wrong[name].mean()) for name in names}, found


def test_honest_feeds_with_outliers_are_left_to_the_estimator():
    shares, found = tried()
    assert set(shares.values()) == {0.0}
    assert not found.wrong["ins"].any()
    assert found.events == []


@pytest.mark.parametrize("off_s", [2.0, -2.0, 10.0, -45.0])
@pytest.mark.parametrize("liar", ["theo_a", "radar"])
def test_a_clock_that_is_off_for_a_while_is_refused_then_and_only_then(off_s, liar):
    name = liar.replace("_", "-")
    shares, found = tried(**{liar: lambda t: np.where((t >= 40) & (t < 80), off_s, 0.0)})
    assert [n for n in SITES if shares[n]] == [name]
    t_s = sightings(name)[1]
    refused = found.wrong[name]
    during, before, after = (t_s >= 42) & (t_s < 78), t_s < 39, t_s >= 82
    assert refused[during].all()  # outliers, which fit nowhere, too
    assert not refused[before].any()
    assert not refused[after].any()
    told = [event.text for event in found.events]
    assert len(told) == 2
    assert abs(float(told[0].split()[3]) - abs(off_s)) < 0.5
    assert told[1] == f"{name} is stamped right again: taken"


def test_a_clock_that_is_off_from_the_first_row_to_the_last():
    """Those before the aircraft's first and after its last, too."""
    for off_s in (10.0, -10.0):
        shares, found = tried(theo_a=lambda t, by=off_s: np.full_like(t, by))
        assert shares == {"theo-a": 1.0, "theo-b": 0.0, "radar": 0.0}
        assert not found.wrong["ins"].any()


@pytest.mark.parametrize("rate", [0.01, -0.01])
@pytest.mark.parametrize("liar", ["theo_a", "theo_b"])
def test_a_clock_that_drifts_is_refused_from_its_beginning(rate, liar):
    shares, found = tried(share=0.04, **{liar: lambda t: rate * t})
    assert shares.pop(liar.replace("_", "-")) == 1.0
    assert set(shares.values()) == {0.0}
    assert not found.wrong["ins"].any()
    assert "by a clock that drifts" in found.events[0].text


@pytest.mark.parametrize("rate", [0.01, -0.01])
def test_a_clock_that_drifts_for_a_while_is_refused_then_and_taken_within_two_seconds(rate):
    shares, found = tried(share=0.04, theo_a=lambda t: np.where((t >= 40) & (t < 70), rate * (t - 40), 0.0))
    t_s, wrong = sightings("theo-a")[1], found.wrong["theo-a"]
    assert wrong[(t_s >= 44) & (t_s < 70)].all()
    assert not wrong[(t_s < 34) | (t_s >= 72)].any()
    assert shares["theo-b"] == shares["radar"] == 0.0


def test_the_aircraft_s_own_clock_that_drifts_is_refused_when_it_is_far_off_and_never_the_instruments():
    shares, found = tried(own(lambda t: 0.01 * t))
    t_s = np.arange(0.0, SECONDS, 0.1)
    assert found.wrong["ins"][t_s > 65].all()
    assert not found.wrong["ins"][t_s < 35].any()
    assert set(shares.values()) == {0.0}


def test_a_clock_that_jumps_back_and_forth():
    shares, _ = tried(theo_b=lambda t: np.where(t // 3 % 2 == 0, 2.0, -2.0))
    assert shares["theo-b"] > 0.98
    assert shares["theo-a"] == shares["radar"] == 0.0


@pytest.mark.parametrize("off_s", [5.0, -10.0])
def test_where_the_instruments_agree_it_is_the_aircraft_that_is_off_to_its_last_row(off_s):
    shares, found = tried(own(lambda t: np.full_like(t, off_s)))
    assert found.wrong["ins"].all()
    assert set(shares.values()) == {0.0}
    assert f"ins is stamped {abs(off_s):.1f} s" in found.events[0].text


@pytest.mark.parametrize("ahead", [10.0, -10.0, 2.0])
def test_an_aircraft_that_is_off_for_a_while_is_refused_then_and_only_then(ahead):
    """Its rows from then have the stamps of others of its own."""
    off = lambda t: np.where((t >= 40) & (t < 80), ahead, 0.0)  # noqa: E731
    shares, found = tried(own(off))
    t_s = np.arange(0.0, SECONDS, 0.1)
    sure = (t_s < 39) | ((t_s >= 40) & (t_s < 80)) | (t_s >= 81)
    np.testing.assert_array_equal(found.wrong["ins"][sure], off(t_s)[sure] != 0.0)
    assert set(shares.values()) == {0.0}


def test_one_against_one_is_nobodys_majority():
    shares, found = tried(names=("theo-a",), theo_a=lambda t: np.full_like(t, 10.0))
    assert shares == {"theo-a": 0.0}
    assert not found.wrong["ins"].any()


def test_a_hovering_aircraft_fits_at_any_time():
    still = lambda t: np.tile([100.0, 50.0, 80.0], (len(t), 1))  # noqa: E731
    shares, _ = tried(course=still, theo_a=lambda t: np.full_like(t, 10.0))
    assert set(shares.values()) == {0.0}


def test_an_instrument_that_stands_elsewhere_is_no_matter_of_clocks():
    seen, _ = sightings("theo-a")
    aside = seen._replace(offset=seen.offset + np.array([0.0, 300.0, 0.0]))
    found = check({"ins": own(), "theo-a": aside, "theo-b": sightings("theo-b")[0]})
    assert not found.wrong["theo-a"].any()


def test_without_rows_nothing_is_said_and_without_the_aircraft_the_instruments_have_votes():
    seen, _ = sightings("theo-a")
    empty = Sightings(seen.t_ns[:0], seen.values[:0], *seen[2:])
    assert not check({"theo-a": seen}).wrong["theo-a"].any()
    assert check({"ins": own(), "theo-a": empty}).wrong.keys() == {"ins"}
    late, _ = sightings("theo-a", lambda t: np.full_like(t, -3.0))
    found = check({"theo-a": late} | {name: sightings(name)[0] for name in ("theo-b", "radar")})
    assert found.wrong["theo-a"].all()
    assert not found.wrong["theo-b"].any()


def test_angles_alone_are_enough():
    seen, t_s = sightings("theo-a", lambda t: np.where(t > 60, 3.0, 0.0))
    blind = seen.values.copy()
    blind[:, 0] = np.nan
    passive = seen._replace(values=blind, sigma=np.array([np.nan, *SIGMA[1:]]))
    found = check({"ins": own(), "theo-a": passive, "theo-b": sightings("theo-b")[0]})
    assert found.wrong["theo-a"][t_s > 62].all()
    assert not found.wrong["theo-a"][t_s < 59].any()
