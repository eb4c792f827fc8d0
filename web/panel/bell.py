"""A short sound when a limit breaks: off at first, and one viewer's own."""

from html import escape

import viser

# Browsers play nothing before the page was touched; the box that turns the bell on is such a touch.
RING = """const a = new AudioContext(), o = a.createOscillator(), g = a.createGain();
o.frequency.value = 880; g.gain.value = 0.3; o.connect(g); g.connect(a.destination);
o.start(); o.stop(a.currentTime + 0.4); o.onended = () => a.close()"""


class Bell:
    """Rings when there are more alarms than before."""

    def __init__(self, gui: viser.GuiApi):
        self._on = gui.add_checkbox("sound when a limit breaks", False, hint="in this page only")
        self._sound = gui.add_html("")
        self._alarms = self._rung = 0

    def update(self, alarms: int) -> None:
        """``alarms``: how many limits are broken now."""
        if alarms > self._alarms and self._on.value:
            self._rung += 1
            self._sound.content = ring(self._rung)
        self._alarms = alarms


def ring(number: int) -> str:
    """HTML that sounds once: viser's page runs no script but an image's error. Each needs its ``number``."""
    return f'<img src="data:,{number}" alt="" style="display: none" onerror="{escape(RING)}">'
