"""Time: play, pause, steps, speed and a slider, over a replay or what the page has seen of a live flight."""

import math
import time
from collections.abc import Callable

import viser
from viser._messages import GuiSliderMark

from gcs.contract.supervision import guarded
from web.look.handles import by_hand
from web.memory.flight import STEP_NS, SeenFlight
from web.memory.timeline import LookBack, Rewind
from web.panel import events

SPEEDS = {
    "0.1×": 0.1,
    "0.5×": 0.5,
    "1×": 1.0,
    "2×": 2.0,
    "5×": 5.0,
    "10×": 10.0,
    "50×": 50.0,
    "max": math.inf,
}
TOUCHED_S = 0.5  # a hand that has just moved the slider is not fought with
HINT = "■ a patch begins, ∅ after a gap, ↺ the filter began again; page up and down go to them"
BACK, PLAY, PAUSE, FORTH = "‹ step", "play", "pause", "step ›"
BEFORE, AFTER, NOW = "« event", "event »", "now"


class Player:
    """The handles of time, one viewer's."""

    def __init__(
        self, gui: viser.GuiApi, time_: LookBack | Rewind, flight: SeenFlight, level: Callable[[], str]
    ):
        self.time, self._flight, self._level = time_, flight, level
        self._marks: tuple[tuple[float, str], ...] = ()
        self._touched_s = 0.0
        with gui.add_folder("Time"):
            self._slider = gui.add_slider("flight s", 0.0, 1.0, 0.1, 0.0, hint=HINT)
            self._strip = gui.add_html("")
            self._steps = gui.add_button_group("step", (BACK, PLAY, FORTH))
            self._jumps = gui.add_button_group(
                "jump", (BEFORE, AFTER, NOW) if time_.live else (BEFORE, AFTER)
            )
            if not time_.live:
                speed = min(SPEEDS, key=lambda name: abs(min(SPEEDS[name], 1e3) - min(time_.speed, 1e3)))
                self._speed = gui.add_dropdown("speed", tuple(SPEEDS), initial_value=speed)
                by_hand(self._speed, lambda name: time_.set_speed(SPEEDS[name]))
        for group in (self._steps, self._jumps):
            group.on_click(guarded("view", lambda event: self.press(event.target.value)))
        by_hand(self._slider, self._touch)

    def mode(self) -> str:
        """One word or two for the badge."""
        if self.time.live:
            behind_s = (self.time.end_ns - self.time.now_ns) / 1e9
            return "LIVE" if self.time.playing else f"BACK {behind_s:.0f} s"
        if self._ended():
            return "END"
        if not self.time.playing:
            return "PAUSED"
        return "REPLAY max" if math.isinf(self.time.speed) else f"REPLAY {self.time.speed:g}×"

    def press(self, what: str) -> None:
        """Do what a button or a key says."""
        now_ns = self.time.now_ns
        if what in (PLAY, PAUSE):
            self._toggle()
        elif what == NOW:
            self.time.play()
        elif what in (BACK, FORTH):
            self.time.pause()
            self.time.seek(now_ns + (STEP_NS if what == FORTH else -STEP_NS))
        else:
            step = 1 if what == AFTER else -1
            flight = self._flight
            there_ns = events.neighbour(flight.moments, flight.marks, self._level(), now_ns, step)
            if there_ns is not None:
                self.time.seek(there_ns)

    def update(self) -> None:
        label = PAUSE if self.time.playing and not self._ended() else PLAY
        if self._steps.options[1] != label:
            self._steps.options = (BACK, label, FORTH)
        self._strip.content = events.strip(
            self._flight.moments, self.time.start_ns, self.time.end_ns, self.time.now_ns
        )
        length_s = max(1.0, (self.time.end_ns - self.time.start_ns) // 1e8 / 10)
        if self._slider.max != length_s:
            self._slider.max = length_s
        marks = events.on_slider(self._flight.marks, self.time.start_ns, self.time.end_ns)
        if marks != self._marks:
            self._marks = marks
            # Without marks of our own the slider shows its ends. No public name sets what a slider has.
            self._slider._marks = tuple(GuiSliderMark(*mark) for mark in marks) or None
        if time.monotonic() - self._touched_s > TOUCHED_S:
            now_s = (self.time.now_ns - self.time.start_ns) // 1e8 / 10
            self._slider.value = min(max(now_s, 0.0), length_s)  # type: ignore[misc]  # viser has it settable

    def _ended(self) -> bool:
        return not self.time.live and self.time.now_ns >= self.time.end_ns

    def _toggle(self) -> None:
        if self._ended():
            self.time.seek(self.time.start_ns)
            self.time.play()
        elif self.time.playing:
            self.time.pause()
        else:
            self.time.play()

    def _touch(self, there_s: float) -> None:
        self._touched_s = time.monotonic()
        self.time.seek(self.time.start_ns + round(there_s * 1e9))
