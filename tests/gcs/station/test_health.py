"""Health: rates, shares and events from the verdicts that go by."""

import numpy as np

from filters.models.rows import TRACK
from gcs.contract.messages import CHANNELS, VERDICTS, Event, Health
from gcs.station.health import Files, Monitor
from gcs.station.ledger import ENTRY
from gcs.station.session import Update

S = 10**9


def update(t_ns: list[int], verdict: str = "used", resets: int = 0, sensor: int = 0) -> Update:
    """One range per time, and the track up to the last."""
    judged = np.zeros(len(t_ns), ENTRY)
    judged["t_ns"], judged["sensor"], judged["measurement"] = t_ns, sensor, np.arange(len(t_ns))
    judged["channel"], judged["verdict"] = CHANNELS.index("range"), VERDICTS.index(verdict)
    track = np.zeros(1, TRACK)
    track["t_ns"], track["reset_counter"] = t_ns[-1], resets
    return Update(track, track[:0], judged, judged[:0], None)


def run(monitor: Monitor, *updates: Update) -> list[Health | Event]:
    return [message for each in updates for message in monitor.take(each)]


def test_rate_and_share_over_ten_seconds():
    monitor = Monitor(["radar"], Files())
    seconds = [update([(k * S) + j * S // 20 for j in range(20)]) for k in range(1, 25)]
    seconds.append(update([(25 * S) + j * S // 20 for j in range(20)], "isolated"))
    health = [m for m in run(monitor, *seconds) if isinstance(m, Health)][-1].sensors["radar"]
    assert abs(health.rate_hz - 20.0) < 0.3
    assert abs(health.outlier_share - 1 / 11) < 0.02  # the last of some eleven seconds
    assert (health.rows, health.outliers) == (500, 20)


def test_systematic_errors_are_told_in_degrees():
    angle = {"value": 0.001, "sigma": 0.0001, "prior_sigma": 0.01, "unit": "rad", "observable": True}
    clock = {"value": 0.02, "sigma": 0.05, "prior_sigma": 0.05, "unit": "s", "observable": False}
    found = {"sensors": {"radar": {"errors": {"azimuth": angle, "clock": clock}}}}
    told = run(Monitor(["radar"], Files()), update([S])._replace(report=lambda: found))
    errors = told[0].sensors["radar"].errors
    assert (errors["azimuth"].unit, errors["azimuth"].known) == ("deg", True)
    assert np.isclose(errors["azimuth"].value, np.degrees(0.001))
    assert np.isclose(errors["azimuth"].sigma, np.degrees(0.0001))
    assert (errors["clock"].value, errors["clock"].unit, errors["clock"].known) == (0.02, "s", False)


def test_a_changed_verdict_is_not_counted_twice():
    monitor = Monitor(["radar"], Files())
    run(monitor, update([S, 2 * S]), update([S, 2 * S], "isolated"), update([3 * S]))
    assert monitor._totals["radar"] == [3, 0]


def test_silence_return_and_reset_are_told():
    monitor = Monitor(["radar", "theo"], Files())
    told = run(
        monitor,
        update([1 * S], sensor=1),
        update([2 * S]),
        update([5 * S]),
        update([6 * S], sensor=1),
        update([7 * S], resets=1),
    )
    texts = [message.text for message in told if isinstance(message, Event)]
    assert texts == ["theo is silent", "theo is back", "filter re-initialised, 1 so far"]
