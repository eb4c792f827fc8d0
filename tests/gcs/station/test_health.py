"""Health: rates, shares and events from the verdicts that go by."""

import numpy as np

from filters.models.rows import TRACK
from gcs.contract.messages import CHANNELS, VERDICTS, Event, Health, PartHealth
from gcs.station.health import Files, Monitor
from gcs.station.ledger import ENTRY, NO_TIME
from gcs.station.session import Update

S = 10**9


def update(t_ns: list[int], verdict: str = "used", resets: int = 0, sensor: int = 0) -> Update:
    """One range per time, and the track up to the last."""
    judged = np.zeros(len(t_ns), ENTRY)
    judged["t_ns"], judged["sensor"], judged["measurement"] = t_ns, sensor, np.array(t_ns) // 1000
    judged["count"] = 1
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


class LiveFeeds(Files):
    """Feeds that come by themselves: what is alive, and how long nothing has come."""

    def __init__(self):
        self.here, self.quiet_s = {"radar"}, 0.0

    def alive(self, name):
        return name in self.here

    def idle_s(self):
        return self.quiet_s


def test_health_goes_on_when_a_recording_that_was_paused_is_played_on():
    feeds = LiveFeeds()
    monitor = Monitor(["radar"], feeds)
    run(monitor, *(update([k * S + S // 2, k * S + S]) for k in range(20)))
    feeds.quiet_s = 60.0
    nothing = update([20 * S])._replace(judged=np.zeros(0, ENTRY))
    assert health(run(monitor, nothing)).t_ns == 80 * S
    feeds.quiet_s = 0.0
    told = run(monitor, *(update([k * S + S // 2, k * S + S]) for k in range(20, 30)))
    healths = [m for m in told if isinstance(m, Health)]
    assert [m.t_ns // S for m in healths] == [*range(21, 31)]
    assert healths[-1].sensors["radar"].age_s == 0.0
    assert 1.5 < healths[-1].sensors["radar"].rate_hz < 2.5


def texts(told) -> list[str]:
    return [message.text for message in told if isinstance(message, Event)]


def health(told) -> Health:
    return [message for message in told if isinstance(message, Health)][-1]


def test_systematic_errors_are_told_in_degrees():
    angle = {"value": 0.001, "sigma": 0.0001, "prior_sigma": 0.01, "unit": "rad", "observable": True}
    clock = {"value": 0.02, "sigma": 0.05, "prior_sigma": 0.05, "unit": "s", "observable": False}
    found = {"sensors": {"radar": {"errors": {"azimuth": angle, "clock": clock}}}}
    told = run(Monitor(["radar"], Files()), update([S])._replace(report=lambda: found))
    errors = health(told).sensors["radar"].errors
    assert (errors["azimuth"].unit, errors["azimuth"].known) == ("deg", True)
    assert np.isclose(errors["azimuth"].value, np.degrees(0.001))
    assert np.isclose(errors["azimuth"].sigma, np.degrees(0.0001))
    assert (errors["clock"].value, errors["clock"].unit, errors["clock"].known) == (0.02, "s", False)


def test_a_changed_verdict_is_counted_once_and_as_what_it_is_now():
    monitor = Monitor(["radar"], Files())
    told = run(
        monitor,
        update([S, 2 * S]),
        update([S, 2 * S], "isolated"),
        update([3 * S, 4 * S]),
        update([S], "used"),
        update([6 * S]),
    )
    radar = health(told).sensors["radar"]
    assert (radar.rows, radar.outliers) == (5, 1)
    assert radar.outlier_share == 1 / 5


def test_a_verdict_that_changes_after_it_left_the_span_changes_the_total_only():
    monitor = Monitor(["radar"], Files())
    told = run(monitor, update([S]), update([20 * S]), update([S], "patch"), update([22 * S]))
    radar = health(told).sensors["radar"]
    assert (radar.rows, radar.outliers, radar.outlier_share) == (3, 1, 0.0)
    run(monitor, *(update([k * S]) for k in range(23, 200)))
    assert len(monitor._tallies["radar"]._known) < 100  # nothing is kept for good


def test_lines_that_were_no_measurement_count_and_give_no_age():
    monitor = Monitor(["radar"], Files())
    lines = update([2 * S], "invalid")
    lines.judged["channel"], lines.judged["count"], lines.judged["t_ns"] = -1, 99, NO_TIME
    radar = health(run(monitor, update([S]), lines, update([3 * S]))).sensors["radar"]
    assert (radar.rows, radar.outliers) == (101, 99)
    assert radar.outlier_share == 99 / 101
    far = update([10**6 * S], "invalid")
    far.track["t_ns"] = 4 * S
    radar = health(run(monitor, far)).sensors["radar"]
    assert radar.age_s == 1.0  # a stamp from the future makes nobody young


def test_the_age_in_a_state_is_that_of_the_newest_measurement_up_to_it():
    monitor = Monitor(["radar", "theo"], Files())
    run(monitor, update([S], sensor=1), update([2 * S, 3 * S, 4 * S]))
    assert monitor.ages_s(4 * S) == {"radar": 0.0, "theo": 3.0}
    assert monitor.ages_s(3 * S + S // 2) == {"radar": 0.5, "theo": 2.5}


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
    assert texts(told) == ["theo is silent", "theo is back", "filter re-initialised, 1 so far"]


def test_a_slow_radar_is_not_silent_between_its_scans():
    monitor = Monitor(["radar", "theo"], Files())
    scans = [update([4 * k * S]) for k in range(1, 6)]
    between = [update([20 * S + k * S], sensor=1) for k in range(1, 14)]
    told = run(monitor, *scans, *between)
    assert texts(told) == ["radar is silent"]
    assert next(m for m in told if isinstance(m, Event)).t_ns == 33 * S  # three scans are missing


def test_silence_of_all_is_told_although_no_data_come():
    feeds = LiveFeeds()
    monitor = Monitor(["radar"], feeds)
    empty = update([5 * S])._replace(track=np.zeros(0, TRACK), judged=np.zeros(0, ENTRY))
    told = run(monitor, update([4 * S]), update([5 * S]))
    feeds.quiet_s, feeds.here = 3.5, set()
    told += run(monitor, empty)
    assert texts(told) == ["radar: its bridge is there", "radar: its bridge is gone", "radar is silent"]
    assert health(told).sensors["radar"].age_s == 3.5
    assert not health(told).sensors["radar"].alive


def test_a_station_that_waits_for_its_first_data_says_so():
    feeds = LiveFeeds()
    empty = update([S])._replace(track=np.zeros(0, TRACK), judged=np.zeros(0, ENTRY))
    told = run(Monitor(["radar"], feeds, lambda: {"mavlink": PartHealth(failures=3)}), empty)
    assert health(told).sensors["radar"].age_s is None
    assert health(told).parts["mavlink"].failures == 3


def test_a_filter_that_has_lost_the_target_says_so():
    lost = update([S])._replace(failed=True)
    assert texts(run(Monitor(["radar"], Files()), lost)) == [
        "no state: the filter has lost the target, or has failed"
    ]


def test_what_several_sinks_ask_about_is_noted_once():
    monitor = Monitor(["radar"], Files())
    once = update([S, 2 * S])
    monitor.see(once)
    assert monitor.ages_s(2 * S) == {"radar": 0.0}  # before anything is counted
    told = monitor.take(once)
    assert monitor.take(once) is told
    radar = health(monitor.take(update([4 * S]))).sensors["radar"]
    assert radar.rows == 3


def test_a_flight_whose_clock_is_behind_the_station_s_has_health_once_a_second():
    monitor = Monitor(["radar"], LiveFeeds())
    nothing = update([S])._replace(track=np.zeros(0, TRACK), judged=np.zeros(0, ENTRY))
    assert health(run(monitor, nothing)).t_ns > 60 * S  # by the station's clock: no data yet
    last_week = [update([k * S // 10]) for k in range(10, 60)]
    times = [message.t_ns for message in run(monitor, *last_week) if isinstance(message, Health)]
    assert times == [S, 2 * S, 3 * S, 4 * S, 5 * S]
