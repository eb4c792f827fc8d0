"""What the operator demands of the flight, and whether it is so."""

from collections.abc import Callable
from functools import partial
from typing import NamedTuple

import viser

from gcs.contract.messages import Health, State
from web.look import html
from web.look.handles import Follower, by_hand


class OperatorLimits(NamedTuple):
    """Zero: no such limit."""

    protection_h_m: float = 0.0
    protection_v_m: float = 0.0
    refused_share: float = 0.20  # of one sensor's values of the last 10 s
    silent_s: float = 2.0  # age of a sensor's newest measurement

    @property
    def demanded(self) -> bool:
        """Whether the position itself has a limit: nobody can say go without one."""
        return self.protection_h_m > 0.0 or self.protection_v_m > 0.0


def alarms(limits: OperatorLimits, state: State | None, health: Health | None) -> list[str]:
    """What is not as demanded, in plain words, the position first."""
    if state is None:
        return ["there is no position"]
    found = []
    if state.quality < 0:
        found.append("the filter has failed: do not use the position")
    if state.ambiguous:
        found.append("two positions fit the measurements: this may be the wrong one")
    for name, limit_m, held_m in (
        ("position", limits.protection_h_m, state.protection_h_m),
        ("height", limits.protection_v_m, state.protection_v_m),
    ):
        if limit_m > 0.0 and held_m is None:
            found.append(f"{name}: nothing bounds the error, {limit_m:g} m is demanded")
        elif limit_m > 0.0 and held_m is not None and held_m > limit_m:
            found.append(f"{name} holds within {held_m:.1f} m, {limit_m:g} m is demanded")
    for name, sensor in health.sensors.items() if health else ():
        age_s = state.age_s.get(name, sensor.age_s)
        if age_s is not None and 0.0 < limits.silent_s < age_s:
            found.append(f"{name} has said nothing for {age_s:.0f} s")
        elif 0.0 < limits.refused_share < sensor.outlier_share:
            found.append(f"{name}: {sensor.outlier_share:.0%} of the last 10 s refused")
    return found


class LimitsForm:
    """One viewer's fields for the limits of all: ``put`` takes a limit, ``sync`` shows what others set."""

    def __init__(self, gui: viser.GuiApi, limits: OperatorLimits, put: Callable[[str, float], None]):
        fields = {
            "protection_h_m": gui.add_number("position within m", limits.protection_h_m, min=0.0, step=0.5),
            "protection_v_m": gui.add_number("height within m", limits.protection_v_m, min=0.0, step=0.5),
            "refused_share": gui.add_number(
                "refused share", limits.refused_share, min=0.0, max=1.0, step=0.01
            ),
            "silent_s": gui.add_number("silent for s", limits.silent_s, min=0.0, step=0.5),
        }
        gui.add_html(
            html.block('<span class="quiet">0: no such limit. The limits hold for all viewers.</span>')
        )
        self._followers = {name: Follower(handle) for name, handle in fields.items()}
        for name, handle in fields.items():
            by_hand(handle, partial(self._put, put, name))

    def _put(self, put: Callable[[str, float], None], name: str, value: float) -> None:
        put(name, value)
        self._followers[name].follow(value)  # one taken back before the next `sync` would stay otherwise

    def sync(self, limits: OperatorLimits) -> None:
        for name, follower in self._followers.items():
            follower.follow(getattr(limits, name))
