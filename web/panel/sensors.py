"""The table of sensors: a row each, and what is known of their systematic errors."""

from html import escape

from gcs.contract.messages import Health, Scene, SensorHealth, State, SystematicError
from web.look import colours
from web.look.colours import Colour
from web.look.html import aged, block, inked, swatch, table
from web.panel.limits import OperatorLimits

LATE_SHARE = 0.25  # of the limit: from here on amber
QUEUE_S = 1.0  # measurements that wait longer: the machine is too slow
HEALTH_S = 3.0  # health comes once a second; older numbers are not of now
SHOWN = {
    "m": ("m", 1.0, 2),
    "deg": ("°", 1.0, 4),
    "s": ("ms", 1e3, 0),
    "m/s": ("m/s", 1.0, 2),
}  # unit, factor, digits


def rows(
    scene: Scene, health: Health | None, state: State | None, limits: OperatorLimits, health_age_s: float
) -> str:
    """Every sensor's link, rate, age, delay and refused share. ``state`` is the newest one."""
    if health is None:
        return block('<span class="quiet">no sensor has reported yet</span>')
    named, old = colours.of_sensors(scene), health_age_s > HEALTH_S
    body = []
    for name, sensor in in_order(scene, health):
        age_s = state.age_s.get(name, sensor.age_s) if state else sensor.age_s
        word, colour = condition(sensor, age_s, limits)
        share = f"{sensor.outlier_share:.1%}"
        body.append(
            [
                swatch(named.get(name, colours.GROUND)) + escape(name),
                inked(word, colour),
                aged(f"{sensor.rate_hz:.1f}", old=old),
                "–" if age_s is None else f"{age_s:.1f}",
                aged(f"{sensor.latency_s * 1e3:.0f}", old=old),
                aged(inked(share, share_colour(sensor.outlier_share, limits)), old=old),
            ]
        )
    late = f"measurements wait {health.queue_age_s:.1f} s to be taken in"
    queue = inked(late, colours.BAD) if health.queue_age_s > QUEUE_S else ""
    said = inked(f"these numbers are {health_age_s:.0f} s old", colours.BAD) if old else ""
    return block(table(body, ("sensor", "link", "Hz", "age s", "delay ms", "refused")) + queue + said)


def errors(scene: Scene, health: Health | None) -> str:
    """Zero errors and clocks with sigma, a sensor each, and whether the flight has shown them."""
    if health is None:
        return ""
    lines = []
    for name, sensor in in_order(scene, health):
        if not sensor.errors:
            continue
        known = sum(error.known for error in sensor.errors.values())
        word = inked("calibrated", colours.GOOD) if known == len(sensor.errors) else ""
        word = word or inked(f"{known} of {len(sensor.errors)} shown by the flight", colours.WARNING)
        words = " · ".join(
            f'<span class="word{"" if error.known else " quiet"}">{one(which, error)}</span>'
            for which, error in sensor.errors.items()
        )
        lines.append(f"<div><b>{escape(name)}</b> {word}<br>{words}</div>")
    return block("".join(lines) or '<span class="quiet">no errors are estimated</span>')


def one(which: str, error: SystematicError) -> str:
    """``azimuth −0.0081 ± 0.0012 °``."""
    unit, factor, digits = SHOWN[error.unit]
    value, sigma = (f"{factor * number:.{digits}f}" for number in (error.value, error.sigma))
    return f"{escape(which)} {value} ± {sigma} {unit}"


def in_order(scene: Scene, health: Health) -> list[tuple[str, SensorHealth]]:
    """As the station file has them, others last."""
    named = [*colours.of_sensors(scene)]
    return sorted(health.sensors.items(), key=lambda item: [*named, item[0]].index(item[0]))


def condition(sensor: SensorHealth, age_s: float | None, limits: OperatorLimits) -> tuple[str, Colour]:
    """A sensor in one word; ``age_s`` of its newest measurement, None before the first."""
    if not sensor.alive:
        return "gone", colours.BAD
    if age_s is None:
        return "waiting", colours.WARNING
    silent = 0.0 < limits.silent_s < age_s
    return ("silent", colours.BAD) if silent else ("ok", colours.GOOD)


def share_colour(share: float, limits: OperatorLimits) -> Colour | None:
    limit = limits.refused_share
    if limit <= 0.0 or share <= LATE_SHARE * limit:
        return None
    return colours.BAD if share > limit else colours.WARNING
