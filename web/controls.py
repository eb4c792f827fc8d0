"""The handles of the panel: playback, camera, what is shown. They call back; they decide nothing."""

import math
import time
from typing import Protocol

import viser

SPEEDS = {"1×": 1.0, "2×": 2.0, "5×": 5.0, "10×": 10.0, "50×": 50.0, "max": math.inf}
SETTLE_S = 0.3  # a seek starts when the slider has rested for so long


class Playable(Protocol):
    """What a replay lets the view do with it. Times are the flight's, int64 ns UTC."""

    start_ns: int
    end_ns: int
    now_ns: int
    playing: bool
    speed: float  # 1, 2, 5, …; inf is as fast as it goes

    def play(self) -> None: ...
    def pause(self) -> None: ...
    def seek(self, t_ns: int) -> None: ...
    def set_speed(self, speed: float) -> None: ...


class Player:
    """Play and pause, speed, and a slider over the flight."""

    def __init__(self, gui: viser.GuiApi, playback: Playable):
        self._playback = playback
        self._wanted_s: float | None = None
        self._touched_s = 0.0
        length_s = max(1.0, (playback.end_ns - playback.start_ns) // 1e9)
        with gui.add_folder("Replay"):
            self._button = gui.add_button("Pause" if playback.playing else "Play")
            self._slider = gui.add_slider("Time s", 0.0, length_s, 1.0, 0.0)
            speed = min(SPEEDS, key=lambda name: abs(min(SPEEDS[name], 1e3) - min(playback.speed, 1e3)))
            self._speed = gui.add_dropdown("Speed", list(SPEEDS), initial_value=speed)
        self._button.on_click(lambda _: self._press())
        self._speed.on_update(lambda event: playback.set_speed(SPEEDS[event.target.value]))
        self._slider.on_update(self._touch)

    def mode(self) -> str:
        playback = self._playback
        if self._ended():
            return "END"
        if not playback.playing:
            return "PAUSED"
        return "REPLAY max" if math.isinf(playback.speed) else f"REPLAY {playback.speed:g}×"

    def update(self) -> None:
        label = "Pause" if self._playback.playing and not self._ended() else "Play"
        if self._button.label != label:
            self._button.label = label
        resting = time.monotonic() - self._touched_s > SETTLE_S
        if self._wanted_s is not None and resting:
            self._playback.seek(self._playback.start_ns + round(self._wanted_s * 1e9))
            self._wanted_s = None
        elif self._wanted_s is None:
            now_s = (self._playback.now_ns - self._playback.start_ns) // 1e9
            self._slider.value = min(max(now_s, 0.0), self._slider.max)  # type: ignore[misc]  # viser has it settable

    def _ended(self) -> bool:
        return self._playback.now_ns >= self._playback.end_ns

    def _press(self) -> None:
        if self._ended():
            self._playback.seek(self._playback.start_ns)
            self._playback.play()
        elif self._playback.playing:
            self._playback.pause()
        else:
            self._playback.play()

    def _touch(self, event: viser.GuiEvent) -> None:
        if event.client is not None:  # our own updates come from no client
            self._wanted_s, self._touched_s = event.target.value, time.monotonic()
