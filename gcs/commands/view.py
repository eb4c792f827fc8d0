"""``gcs view``: the page alone, on any machine, as a plain subscriber of the bus."""

import os
import threading
from collections.abc import Callable, Iterator
from contextlib import ExitStack
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import msgspec
from cyclopts import Parameter

from gcs.commands.compose import ground_picture, open_bus, other_course, until_stopped
from gcs.commands.options import Config, Overlay, stopped
from gcs.contract import config as configuration
from gcs.contract.messages import InputError
from gcs.outputs.console import say

if TYPE_CHECKING:
    from gcs.contract.wire.bus import Bus

GIVES_WAY = 19  # as far as it goes: on the station's own machine whoever flies comes before who looks
ASKED_S = 2.0  # between questions for vehicles that nobody named


def command(
    *,
    station: Path,
    vehicle: Annotated[
        tuple[str, ...],
        Parameter(consume_multiple=True, negative="", help="which to show; all of the range by default"),
    ] = (),
    overlay: Overlay = None,
    config: Config = (),
) -> None:
    """Show the flights that stations publish: the same page as a station's own, in a process of its own.

    Every vehicle of the range that has a station, also one that comes later, or ``--vehicle uav1 uav2``.
    Beside another page on this machine: ``--config view.port=PORT``.
    """
    from web import follow  # viser is not needed by other commands

    os.nice(GIVES_WAY)
    resolved, other = configuration.load(station, config), other_course(overlay) if overlay else None
    ground = ground_picture(resolved)
    if twice := [name for name in vehicle if vehicle.count(name) > 1]:
        raise InputError(f"--vehicle {twice[0]}: named twice")
    stop = stopped()
    with ExitStack() as stack:

        def open_(name: str) -> "Bus":
            whose = msgspec.structs.replace(resolved.vehicle, name=name)
            one = msgspec.structs.replace(resolved, vehicle=whose)
            return stack.enter_context(open_bus(one, mode="client", waiting=until_stopped(stop)))

        buses = {name: open_(name) for name in vehicle}
        said = ", ".join(f"{resolved.range.name}/{name}" for name in vehicle or ("*",))
        say(f"waiting for {said}   (Ctrl-C ends)")
        found = None
        if not vehicle:
            found = Finder(open_(resolved.vehicle.name).vehicles, open_)
            stack.callback(found.close)
        follow.run(
            buses,
            resolved.view.port,
            stop,
            _opened,
            origins=resolved.view.origins,
            other=other,
            ground=ground,
            more=found.new if found else tuple,
        )


class Finder:
    """Asks for the vehicles of a range again and again, in a thread: an answer may take a while."""

    def __init__(self, ask: Callable[[], set[str]], open_: "Callable[[str], Bus]"):
        self._ask, self._open, self._stop = ask, open_, threading.Event()
        self._names: list[str] = []  # in order of their coming
        self._given = 0
        self._thread = threading.Thread(target=self._run, name="vehicles", daemon=True)
        self._thread.start()

    def new(self) -> "Iterator[tuple[str, Bus]]":
        """Those that have come since it was asked last, with a bus each."""
        for name in self._names[self._given :]:
            self._given += 1
            yield name, self._open(name)

    def close(self) -> None:
        self._stop.set()
        self._thread.join()

    def _run(self) -> None:
        while not self._stop.is_set():
            self._names += sorted(self._ask() - {*self._names})
            self._stop.wait(ASKED_S)


def _opened(url: str) -> None:
    say(f"view: {url}")
