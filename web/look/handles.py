"""Handles of the page: set by the page without an echo, and heard when a viewer moves them."""

from collections.abc import Callable
from typing import Any

import viser

from gcs.contract.supervision import guarded


def set_value(handle: Any, value: Any) -> None:
    """Set a handle that does not say so already; viser's types call it read-only, its manual does not."""
    if handle.value != value:
        handle.value = value


def by_hand(handle: Any, act: Callable[[Any], None]) -> None:
    """Call ``act`` with the new value when a viewer has changed it; what we set comes from no client."""

    def changed(event: viser.GuiEvent) -> None:
        if event.client is not None:
            act(event.target.value)

    handle.on_update(guarded("view", changed))
