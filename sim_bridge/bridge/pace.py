"""Simulated time against the wall clock."""

from __future__ import annotations

import time
from collections.abc import Callable


class Pacer:
    """Limiter of a simulation to ``speed`` times real time; None for no limit."""

    forgive = 0.25
    """s; delay beyond which a simulation does not catch up"""

    def __init__(
        self,
        speed: float | None,
        clock: Callable[[], float] = time.monotonic,
        sleep: Callable[[float], None] = time.sleep,
    ) -> None:
        self.speed = speed
        self._clock = clock
        self._sleep = sleep
        self._wall_at_zero: float | None = None

    def wait(self, time_us: int) -> None:
        """Wait until simulated time ``time_us`` is due."""
        if self.speed is None:
            return
        now = self._clock()
        elapsed = time_us * 1e-6 / self.speed
        if self._wall_at_zero is None:
            self._wall_at_zero = now - elapsed
        ahead = self._wall_at_zero + elapsed - now
        if ahead > 0.0:
            self._sleep(ahead)
        elif ahead < -self.forgive:
            self._wall_at_zero = now - elapsed
