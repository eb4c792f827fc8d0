"""Handles of the page: set by the page without an echo, and heard when a viewer moves them."""

from collections.abc import Callable
from typing import Any

import viser

from gcs.contract.supervision import guarded


def set_value(handle: Any, value: Any) -> None:
    """Set a handle that does not say so already; viser's types call it read-only, its manual does not."""
    if handle.value != value:
        handle.value = value


class Follower:
    """Keeps a handle at a value that others set too. Only what has changed is put there: an old value, put on
    a handle that a hand has just moved, would be taken for the hand's."""

    def __init__(self, handle: Any):
        self._handle, self._before = handle, handle.value

    def follow(self, value: Any) -> None:
        if value != self._before:
            self._before = value
            set_value(self._handle, value)


def by_hand(handle: Any, act: Callable[[Any], None]) -> None:
    """Call ``act`` with the new value when a viewer has changed it; what we set comes from no client."""

    def changed(event: viser.GuiEvent) -> None:
        if event.client is not None:
            act(event.target.value)

    handle.on_update(guarded("view", changed))
