"""Player of a recorded flight with seek and pause."""

from __future__ import annotations

from bisect import bisect_right
from typing import Any

from avionics.messages import Command
from avionics.view import FlightView
from logs.replay.flight import step
from logs.replay.recorded_flight import RecordedFlight
from wingbeat.topic import Topic

MOST = 400
"""-; limit of the ticks per call: a slow computer plays more slowly and keeps serving its links"""
OBEYS_NOBODY = "replay: commands are denied"


class ReplayView(FlightView):
    """Read-only state of a replayed flight computer for a ground link."""

    def refusal(self, command: Command) -> str:
        """Return why a command is denied: the flight is recorded."""
        return OBEYS_NOBODY


class Player:
    """Playback of a flight on the clock of the caller."""

    def __init__(self, flight: RecordedFlight, speed: float = 1.0) -> None:
        """Pause before the first tick, or at the first snapshot if the file begins in flight.

        ``speed`` in s of flight per s of the clock.
        """
        self.view = ReplayView(flight.vehicle, flight.mission, _discard)
        self.paused = False
        self._ticks, self._speed = flight.ticks, speed
        self._times = [tick.frame.time_us for tick in flight.ticks]
        boot = [(-1, self.view.autopilot.snapshot())] if flight.from_boot else []
        self._memories = [*boot, *((text.time_us, text.text) for text in flight.snapshots)]
        self._next = 0
        self._now: float | None = None
        self._ahead = 0.0
        self.seek(0.0)

    @property
    def time(self) -> float:
        """s; since boot, of the last tick played; before the first tick that of the initial snapshot, 0 at boot."""
        return (self._times[self._next - 1] if self._next else max(self._memories[0][0], 0)) * 1e-6

    @property
    def end(self) -> float:
        """s; since boot, of the last tick of the recording."""
        return self._times[-1] * 1e-6 if self._times else 0.0

    @property
    def over(self) -> bool:
        """Whether the last tick was played."""
        return self._next >= len(self._ticks)

    def advance(self, now: float) -> None:
        """Play the ticks due at ``now`` (s, of the clock)."""
        passed = 0.0 if self._now is None else now - self._now
        self._now = now
        if self.paused or self.over:
            return
        self._ahead += passed * self._speed * 1e6
        for _ in range(MOST):
            if self.over or self._due() > self._ahead:
                return
            self._ahead -= self._due()
            self._play()
        self._ahead = 0.0

    def seek(self, time: float) -> None:
        """Seek to ``time`` (s since boot) from the last snapshot before it."""
        place = bisect_right([at for at, _ in self._memories], time * 1e6) - 1
        at, memory = self._memories[max(place, 0)]
        self.view.autopilot.restore(memory)
        self._next, self._ahead = bisect_right(self._times, at), 0.0
        while not self.over and self._times[self._next] <= time * 1e6:
            self._play()

    def _due(self) -> float:
        """Return the time in us from the last tick to the next, 0 if the clock ran back."""
        before = self._times[self._next - 1] if self._next else self._times[0]
        return float(max(self._times[self._next] - before, 0))

    def _play(self) -> None:
        step(self.view.autopilot, self._ticks[self._next])
        self._next += 1


def _discard(topic: Topic[Any], message: object) -> None:
    pass
