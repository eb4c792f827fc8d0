"""The ledger and the intake: every value is entered once, judged, and leaves in order."""

import numpy as np
import pytest

from filters.models.rows import VERDICT
from filters.smoother.status import REASONS
from gcs.contract.config import Position, RangeSection, SensorSection, Station
from gcs.contract.frames import Frame
from gcs.contract.messages import CHANNELS, INS, POLAR, VERDICTS, Bad
from gcs.station.intake import Intake, merge
from gcs.station.ledger import NO_TIME, Ledger

FRAME = Frame(-35.363261, 149.165230, 584.0)
SITE = Position(lat_deg=-35.35, lon_deg=149.16, alt_m=640.0)
STATION = Station(
    range=RangeSection(origin=Position(lat_deg=FRAME.lat_deg, lon_deg=FRAME.lon_deg, alt_m=FRAME.alt_m)),
    sensor=[SensorSection(name="theo", kind="theodolite", position=SITE, latency_s=0.25)],
)


@pytest.fixture
def ledger():
    return Ledger(["ins", "theo"], REASONS)


@pytest.fixture
def intake(ledger):
    return Intake(STATION, FRAME, ledger)


def shots(*rows) -> np.ndarray:
    """POLAR from (t_ns, range_m, azimuth_deg, elevation_deg)."""
    out = np.zeros(len(rows), POLAR)
    out["range_rate_mps"] = np.nan
    names = ("t_ns", "range_m", "azimuth_deg", "elevation_deg")
    for name, column in zip(names, zip(*rows, strict=True), strict=True):
        out[name] = column
    return out


def test_values_become_rows_in_filter_units(intake):
    nan = float("nan")
    batch = intake.polar("theo", shots((10**18, 812.5, 90.0, nan), (10**18 + 1, nan, nan, nan)))
    rows, invalid = intake.enter(batch)
    assert rows["id"].tolist() == [0, 1]
    assert rows["value"].tolist() == [812.5, pytest.approx(np.pi / 2)]
    assert set(rows["t_ns"].tolist()) == {10**18 - 250_000_000}  # the known latency is taken off
    assert intake.ledger.entries["t_ns"].tolist() == [10**18, 10**18]  # the record keeps what the feed gave
    assert rows["sigma"].tolist() == [0.0, 0.0]  # the sensor's own
    assert len(invalid) == 0


def test_impossible_values_are_entered_and_judged(intake, ledger):
    batch = intake.polar("theo", shots((1, 1e300, 10.0, 20.0), (2, 500.0, np.inf, 95.0)))
    rows, invalid = intake.enter(batch)
    assert [CHANNELS[c] for c in rows["channel"]] == ["azimuth", "elevation", "range"]
    judged = ledger.at(invalid)
    assert [VERDICTS[v] for v in judged["verdict"]] == ["invalid"] * 3
    assert judged["final"].all()


def test_a_damaged_line_has_its_entry(intake, ledger):
    bad = Bad(source="theo", where="theo.csv:17", reason="t: 'x' is no time")
    rows, invalid = intake.enter(intake.bad("theo", [bad]))
    entry = ledger.at(invalid)[0]
    assert len(rows) == 0
    assert entry["t_ns"] == NO_TIME
    assert ledger.reason_texts(ledger.at(invalid)) == ["theo.csv:17: t: 'x' is no time"]


def test_ins_height_becomes_ellipsoidal(intake):
    """The origin itself, given as mean sea level plus the receiver's separation, is at 0, 0, 0."""
    measured = np.zeros(1, INS)
    measured["lat_deg"], measured["lon_deg"] = FRAME.lat_deg, FRAME.lon_deg
    measured["alt_msl_m"], measured["geoid_separation_m"] = FRAME.alt_m - 19.5, 19.5
    rows, _ = intake.enter(intake.ins(measured))
    np.testing.assert_allclose(rows["value"][:3], 0.0, atol=1e-6)
    assert intake.separation_source == "receiver"


def test_merge_keeps_measurements_apart_and_sorts(intake):
    first = intake.polar("theo", shots((5, 1.0, 2.0, 3.0), (9, 1.0, 2.0, 3.0)))
    second = intake.polar("theo", shots((7, 1.0, 2.0, 3.0)))
    merged = merge([first, second])
    assert merged.entries["t_ns"].tolist() == [5, 5, 5, 7, 7, 7, 9, 9, 9]
    assert len(np.unique(merged.entries["measurement"])) == 3


def test_judging_counting_and_retiring(intake, ledger):
    intake.enter(intake.polar("theo", shots((10**18, 800.0, 10.0, 20.0))))
    verdicts = np.zeros(3, VERDICT)
    verdicts["id"] = [0, 1, 2]
    verdicts["predicted"] = [700.0, np.radians(10.0), np.radians(20.0)]
    verdicts["sigma"] = [10.0, 0.1, 0.1]
    verdicts["verdict"] = [VERDICTS.index("isolated"), 0, 0]
    verdicts["reason"] = [REASONS.index("innovation"), 0, 0]
    verdicts["final"] = [True, True, False]
    judged = ledger.at(ledger.judge(verdicts))
    assert judged["predicted"][1] == pytest.approx(10.0)  # degrees, as the input
    assert ledger.reason_texts(judged) == ["innovation (10.0 sigma)", "", ""]
    assert len(ledger.retire()) == 2
    assert ledger.first == 2
    assert ledger.count_table()["theo"] == {"range": {"isolated": 1}, "azimuth": {"used": 1}}
    verdicts["final"] = True
    ledger.judge(verdicts[2:])
    assert len(ledger.retire()) == 1


def test_thousands_of_reasons(ledger):
    """A feed with every line damaged differently must not run out of reason numbers."""
    last = [ledger.reason(f"line {k}") for k in range(100_000)][-1]
    assert ledger.reasons[last] == "line 99999"


def test_screening_is_named_in_the_reason_and_changes_no_verdict(intake, ledger):
    rows, _ = intake.enter(intake.polar("theo", shots((1, 500.0, 10.0, 20.0))))
    verdicts = np.zeros(3, VERDICT)
    verdicts["id"], verdicts["reason"], verdicts["final"] = rows["id"], [1, 1, 0], True
    verdicts["verdict"] = [VERDICTS.index("isolated")] * 2 + [VERDICTS.index("used")]
    verdicts["predicted"] = verdicts["sigma"] = np.nan
    ledger.doubt(rows["id"][1:])
    ledger.judge(verdicts)
    agreed, alone = "innovation; screening agrees", "screening alone doubts it"
    assert ledger.reason_texts(ledger.at(rows["id"])) == ["innovation", agreed, alone]
    ledger.retire()
    assert ledger.count_table()["theo"]["range"] == {"isolated": 1}
    assert ledger.count_table(doubted=True)["theo"] == {
        "azimuth": {"isolated": 1},
        "elevation": {"used": 1},
    }


def test_a_line_that_stands_for_many_counts_as_many(intake, ledger):
    flood = Bad(source="theo", where="raw/theo", reason="more than 100 a second", count=9_900)
    intake.enter(intake.bad("theo", [flood]))
    retired = ledger.retire()
    assert ledger.reason_texts(retired) == ["raw/theo: 9900 like this: more than 100 a second"]
    assert ledger.count_table()["theo"] == {"line": {"invalid": 9_900}}


def test_who_writes_late_still_has_the_remarks(intake, ledger):
    """The record is written in a thread of its own, turns later."""
    told = []
    for number in range(5):
        bad = Bad(source="theo", where=f"line {number}", reason="no JSON object")
        intake.enter(intake.bad("theo", [bad]))
        told.append((ledger.retire(), ledger.parting))
    texts = [ledger.reason_texts(retired, remarks) for retired, remarks in told]
    assert texts == [[f"line {number}: no JSON object"] for number in range(5)]


def test_remarks_on_single_lines_are_forgotten_with_them(intake, ledger):
    for number in range(500):
        bad = Bad(source="theo", where=f"udp 127.0.0.1:9001 #{number}", reason="no JSON object")
        intake.enter(intake.bad("theo", [bad]))
        assert ledger.reason_texts(ledger.retire()) == [f"udp 127.0.0.1:9001 #{number}: no JSON object"]
    assert len(ledger._remarks) <= 2
    assert len(ledger.reasons) < 20
