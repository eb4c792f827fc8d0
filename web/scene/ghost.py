"""The aircraft as it was, in the page of one viewer who looks back."""

import numpy as np
import viser

from gcs.contract.messages import State
from web.look.html import clock
from web.memory.flight import SeenFlight
from web.scene.aircraft import Aircraft


class Ghost:
    """Takes the place of the aircraft that all share, as long as there is a state to show."""

    def __init__(self, api: viser.SceneApi, flight: SeenFlight):
        self._api, self._flight = api, flight
        self._drawn: Aircraft | None = None

    def show(self, state: State, eye: np.ndarray, *, dark: bool) -> None:
        """Show ``state``, sized for an eye (3,) there."""
        name = self._flight.scene.vehicle
        if self._drawn is None:
            self._drawn = Aircraft(self._api, self._flight.root, name)
            self._drawn.set_dark(dark=dark)
        self._drawn.say(f"{name} at {clock(state.t_ns)}")
        self._drawn.move(state, float(np.linalg.norm(eye - np.array(state.position_enu_m))))

    def clear(self) -> None:
        if self._drawn:
            self._drawn.remove()
            self._drawn = None
