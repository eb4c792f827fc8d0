"""Where to begin: places and fixes by geometry, lines through outliers, first states."""

import numpy as np
import pytest

from filters.models import state, theodolite
from filters.models.motion import CORE
from filters.models.rows import AZIMUTH, ELEVATION, RANGE, E
from filters.smoother import proposals
from filters.smoother.buffer import Rows
from tests.filters.smoother.apart.test_challengers import later
from tests.filters.smoother.kit import small
from tests.filters.smoother.test_bank import INS, RADAR, A, B

pytestmark = pytest.mark.decision

HERE = np.array([700.0, -400.0, 150.0])


def tilted(sensor):
    a, b = np.radians([30.0, 2.0])
    turn = np.array([[np.cos(a), np.sin(a), 0], [-np.sin(a), np.cos(a), 0], [0, 0, 1]])
    lean = np.array([[1, 0, 0], [0, np.cos(b), np.sin(b)], [0, -np.sin(b), np.cos(b)]])
    return sensor._replace(rotation=lean @ turn)


def seen(sensors, *, p=HERE, t=0.0, only=None):
    """(model, rows) of all sensors looking at ``p``, without noise; ``only`` some channels."""
    model, said = state.build(sensors), []
    for s, sensor in enumerate(sensors):
        values = {E + a: p[a] for a in range(3)} if sensor.kind == "ins" else small.polar(sensor, p)
        said += [
            (t, s, c, v)
            for c, v in values.items()
            if np.isfinite(sensor.sigma[c]) and (not only or c in only)
        ]
    return model, small.as_rows(said, model)


def place(model, rows, height=np.nan, begin=0):
    theodolite.places(rows, model.offset, model.rotation, model.is_ins, height, begin)
    return rows


def test_an_instrument_says_the_place_of_all_its_rows():
    sensors = [tilted(small.theodolite(place=(50.0, 20.0, -5.0))), small.radar(place=(0, 900, 0))]
    rows = place(*seen(sensors))
    assert np.allclose(rows.place, HERE, atol=1e-8)


def test_lines_of_sight_and_an_ins_say_none():
    rows = place(*seen([small.theodolite(az=1e-4, el=1e-4), small.ins()]))
    assert np.isnan(rows.place).all()


def test_rows_of_another_time_do_not_help():
    model = state.build([small.theodolite()])
    values = small.polar(small.theodolite(), HERE)
    rows = small.as_rows([(0.0, 0, RANGE, values[RANGE]), (0.1, 0, AZIMUTH, values[AZIMUTH])], model)
    assert np.isnan(place(model, rows).place).all()


def test_places_before_begin_stay():
    model, rows = seen([small.theodolite()])
    rows.place[:] = 7.0
    place(model, rows, begin=3)
    assert (rows.place == 7.0).all()


def test_a_known_height_stands_in_for_the_elevation():
    sensor = small.radar(place=(50.0, 20.0, -5.0), r=5.0, az=1e-3)
    model, rows = seen([sensor])
    assert np.allclose(place(model, rows, HERE[2]).place, HERE, atol=1e-8)


def test_no_place_without_elevation_and_height():
    model, rows = seen([small.radar(r=5.0, az=1e-3)])
    assert np.isnan(place(model, rows).place).all()


# ---- fixes


def fixes(model, rows, height=np.nan):
    return proposals.fixes(model, place(model, rows, height))


def test_an_ins_and_an_instrument_fix_what_they_say():
    found = fixes(*seen([small.ins(), small.theodolite(place=(10.0, 0.0, 0.0))]))
    assert found[:, 0].tolist() == [0, 1]
    assert np.allclose(found[:, 2:], HERE, atol=1e-8)


@pytest.mark.parametrize("missing", range(3))
def test_an_incomplete_ins_fixes_nothing(missing):
    only = {E, E + 1, E + 2} - {E + missing}
    assert len(fixes(*seen([small.ins()], only=only))) == 0


def passive(name, at):
    return tilted(small.theodolite(name, at, az=1e-4, el=1e-4))


def test_two_lines_of_sight_cross_at_the_target():
    found = fixes(*seen([passive("a", (0, 0, 0)), passive("b", (900, 300, 10)), passive("c", (0, 900, 0))]))
    assert found[:, 0].tolist() == [1, 2]  # the first one has nobody before it
    assert np.allclose(found[:, 2:], HERE, atol=1e-6)


def test_of_several_lines_the_two_that_cross_most_nearly_at_a_right_angle_count():
    """The third one is 1 mrad wrong: by the sight from beside it the place would be a kilometre off."""
    sensors = [passive("a", (0, 0, 0)), passive("beside c", (0, 890, 0)), passive("c", (0, 900, 0))]
    model, rows = seen(sensors)
    rows.value[(rows.sensor == 2) & (rows.channel == AZIMUTH)] += 1e-3
    assert np.linalg.norm(fixes(model, rows)[-1, 2:] - HERE) < 5.0


def test_an_instrument_may_give_its_two_angles_at_two_instants():
    """A sweep for each: the lines cross once both stations have swept twice."""
    sensors = [passive("a", (0, 0, 0)), passive("b", (900, 300, 10))]
    model = state.build(sensors)
    sweeps = [
        (0.00, 0, AZIMUTH),
        (0.01, 0, ELEVATION),
        (0.02, 1, AZIMUTH),
        (0.03, 1, ELEVATION),
        (0.04, 0, AZIMUTH),
    ]
    rows = small.as_rows([(t, s, c, small.polar(sensors[s], HERE)[c]) for t, s, c in sweeps], model)
    found = fixes(model, rows)
    assert np.allclose(found[:, 1], [0.03, 0.04])
    assert np.allclose(found[:, 2:], HERE, atol=1e-6)


def test_lines_that_miss_cross_in_the_middle():
    model, rows = seen([passive("a", (0, 0, 0)), passive("b", (1400, 0, 0))])
    rows.value[rows.channel == ELEVATION] += [1e-3, -1e-3]
    [found] = fixes(model, rows)
    assert np.linalg.norm(found[2:] - HERE) < 1.0


def test_parallel_lines_and_lines_that_meet_behind_do_not_cross():
    far = HERE + np.array([0.0, 1e6, 0.0])
    assert len(fixes(*seen([passive("a", (0, 0, 0)), passive("b", (100, 0, 0))], p=far))) == 0
    model, rows = seen([passive("a", (0, 0, 0)), passive("b", (900, 300, 0))])
    rows.value[rows.channel == AZIMUTH] += np.pi
    rows.value[rows.channel == ELEVATION] *= -1.0
    assert len(fixes(model, rows)) == 0


@pytest.mark.parametrize(("gap_s", "crosses"), [(0.05, True), (0.2, False)])
def test_lines_of_sight_cross_only_when_together(gap_s, crosses):
    sensors = [passive("a", (0, 0, 0)), passive("b", (900, 300, 10))]
    model = state.build(sensors)
    said = [(gap_s * s, s, c, small.polar(sensors[s], HERE)[c]) for s in (0, 1) for c in (AZIMUTH, ELEVATION)]
    assert (len(fixes(model, small.as_rows(said, model))) == 1) == crosses


# ---- lines through fixes


@pytest.mark.parametrize("seed", range(5))
def test_the_line_stands_30_percent_outliers(seed):
    rng = np.random.default_rng(seed)
    t = np.linspace(0.0, 2.0, 40)
    at, speed = np.array([100.0, -50.0, 30.0]), np.array([20.0, 5.0, -3.0])
    p = at + t[:, None] * speed + rng.normal(size=(40, 3))
    bad = rng.permutation(40)[:12]
    p[bad] += rng.normal(scale=1e4, size=(12, 3))
    found, velocity = proposals._line(t, p)
    assert np.abs(found - at).max() < 4.0
    assert np.abs(velocity - speed).max() < 5.0


def test_the_line_is_exact_without_noise():
    t = np.array([0.0, 0.1, 0.35, 0.9])
    found, velocity = proposals._line(t, 5.0 + t[:, None] * [1.0, -2.0, 3.0])
    assert np.allclose(found, 5.0)
    assert np.allclose(velocity, [1.0, -2.0, 3.0])


def test_one_fix_stands_still():
    found, velocity = proposals._line(np.array([0.3]), np.array([[1.0, 2.0, 3.0]]))
    assert found.tolist() == [1.0, 2.0, 3.0]
    assert velocity.tolist() == [0.0, 0.0, 0.0]


def test_fixes_all_at_one_time_give_their_middle():
    found, velocity = proposals._line(np.zeros(3), np.array([[0.0, 0, 0], [1, 1, 1], [50, 50, 50]]))
    assert found.tolist() == [1.0, 1.0, 1.0]
    assert not velocity.any()


# ---- first states


def flight(sensors, seconds=1.0, **path):
    model = state.build(sensors)
    rows = small.fly(sensors, seconds, **path)
    said = [(r["t_ns"] * 1e-9, r["sensor"], r["channel"], r["value"]) for r in rows]
    return model, place(model, small.as_rows(said, model))


def test_every_sensor_with_a_fix_has_its_first_state():
    model, rows = flight([small.ins(), small.theodolite("a", (0, -300, 0)), passive("b", (500, 0, 0))])
    found = proposals.candidates(model, rows, np.nan, np.nan)
    p, v = small.truth(np.zeros(1))
    assert [s for s, *_ in found] == [0, 1, 2]  # the passive one by its crossing with the other
    for s, x, P in found:
        assert np.linalg.norm(x[:3] - p[0]) < 10.0
        assert np.linalg.norm(x[3:6] - v[0]) < (3.0 if s == 0 else 20.0)  # it turns
        assert not x[6:].any()
        assert np.array_equal(P, P.T)
        assert np.allclose(np.diag(P)[CORE:], np.diag(state.prior_covariance(model))[CORE:])
        assert np.sqrt(P[0, 0]) == proposals.PLACE_SIGMA_M or s == 2


def test_no_first_state_is_faster_than_a_target_can_be():
    """An elevation beyond the zenith puts the target on the other side: 56 km/s between two scans."""
    model, rows = flight([small.theodolite()])
    rows.place[:, 0] += 56e3 * rows.t * 1e-9
    [(_, x, _)] = proposals.candidates(model, rows, np.nan, np.nan)
    assert np.linalg.norm(x[3:6]) == pytest.approx(proposals.FASTEST * proposals.FASTEST_MPS)


def test_a_known_height_is_the_states():
    model, rows = flight([small.theodolite()])
    _, x, P = proposals.candidates(model, rows, 180.0, 4.0)[0]
    assert x[2] == 180.0
    assert P[2, 2] == 16.0


def test_where_only_lines_of_sight_say_it_the_place_is_known_to_a_share():
    sensors = [passive("a", (0, 0, 0)), passive("b", (900, 300, 10))]
    model, rows = flight(sensors)
    s, x, P = proposals.candidates(model, rows, np.nan, np.nan)[0]
    p, _ = small.truth(np.zeros(1))
    assert np.linalg.norm(x[:3] - p[0]) < 5.0
    assert np.sqrt(P[0, 0]) == pytest.approx(proposals.NEAR * np.linalg.norm(x[:3] - sensors[s].offset_m))


def test_a_first_velocity_is_as_unsure_as_the_places_it_is_from():
    """Else a target four metres away would be anywhere after ten milliseconds."""
    sensors = [passive("a", (0, 0, 0)), passive("b", (4, 0, 0))]
    model, rows = flight(sensors, 0.5, p0=(2.0, -26.0, 1.0), v0=(0.1, 0.0, 0.0), turn=0.0)
    _, x, P = proposals.candidates(model, rows, np.nan, np.nan)[0]
    own = rows.t[(rows.sensor == 0) & np.isfinite(rows.place[:, 0])]
    assert np.sqrt(P[3, 3]) == pytest.approx(np.sqrt(2.0 * P[0, 0]) / (1e-9 * np.ptp(own)))
    assert np.linalg.norm(x[3:6] - [0.1, 0.0, 0.0]) < 0.5
    _, _, P = proposals.candidates(model, Rows(*(column[:4] for column in rows)), np.nan, np.nan)[0]
    assert np.sqrt(P[3, 3]) == proposals.SPEED_SIGMA_MPS  # of one place nobody knows


def test_nothing_said_nothing_begun():
    model, rows = flight([passive("a", (0, 0, 0))])
    assert proposals.candidates(model, rows, np.nan, np.nan) == []


# ---- challengers


def test_a_manoeuvre_begins_before_it_is_seen():
    one, rows = later([INS, A, B, RADAR])
    seen = rows.t[-1] - 200_000_000
    one.best.own.weight[:] = rows.t < seen
    begin = proposals.onset(one.best, rows)
    assert rows.t[begin] == rows.t[rows.t >= rows.t[rows.t >= seen][0] - proposals.LEAD_NS][0]


@pytest.mark.parametrize("about", [{"estimate": ("bias",)}, {"slow": 4.0}], ids=str)
def test_a_restart_keeps_what_is_known_of_an_instruments_errors(about):
    sensors = [A._replace(**about), B, RADAR]
    one, _rows = later(sensors)
    at = one.space.model.bias_at[0, RANGE]
    one.best.follow(np.array([[-1.0, 0.0, 0.0], [1.0, 1.0, 1.0]]))
    one.best.anchor.x[at], one.best.anchor.P[at, at] = 7.0, 0.04
    x, P = np.zeros(len(one.best.anchor.x)), state.prior_covariance(one.space.model)
    proposals.keep_errors(one.best, x, P)
    assert x[at] == 7.0
    assert P[at, at] == pytest.approx(4 * 0.04)
    one.best.anchor.P[at, at] = 1e6
    proposals.keep_errors(one.best, x, P)
    assert P[at, at] == pytest.approx(one.space.model.prior[at])
    one.best.follow(np.array([[1.0, 0.0, 0.0], [1.0, 1.0, 1.0]]))  # an error that may be larger than stated
    proposals.keep_errors(one.best, x, P)
    assert P[at, at] == pytest.approx(one.space.model.prior[at] * (np.e if "slow" in about else 1.0))
