"""Notification when numba starts to compile."""

from __future__ import annotations

from collections.abc import Callable
from contextlib import AbstractContextManager
from typing import Any, cast

from numba.core.event import Listener, install_listener


class _StartListener(Listener):
    def __init__(self, callback: Callable[[], None]) -> None:
        self._callback = callback

    def on_start(self, event: Any) -> None:
        self._callback()

    def on_end(self, event: Any) -> None:
        pass


def on_compilation(callback: Callable[[], None]) -> AbstractContextManager[object]:
    """Call ``callback`` at the start of each compilation inside the ``with`` block."""
    return cast(AbstractContextManager[object], install_listener("numba:compile", _StartListener(callback)))
