"""Notification when numba starts and ends a compilation."""

from __future__ import annotations

from collections.abc import Callable
from contextlib import AbstractContextManager
from typing import Any, cast

from numba.core.event import Listener, install_listener


class _Listener(Listener):
    def __init__(self, started: Callable[[str], None], ended: Callable[[], None]) -> None:
        self._started, self._ended, self._depth = started, ended, 0

    def on_start(self, event: Any) -> None:
        self._depth += 1
        self._started(event.data["dispatcher"].py_func.__name__)

    def on_end(self, event: Any) -> None:
        self._depth -= 1
        if self._depth == 0:
            self._ended()


def on_compilation(
    started: Callable[[str], None], ended: Callable[[], None] = lambda: None
) -> AbstractContextManager[object]:
    """Call ``started`` with the name of each kernel that is compiled inside the ``with`` block, before it is.

    A kernel's callees are compiled within it; ``ended`` is called after the outermost kernel.
    """
    return cast(AbstractContextManager[object], install_listener("numba:compile", _Listener(started, ended)))
