"""Heartbeat-loss monitor with rate-limited notices."""

from __future__ import annotations

from collections.abc import Callable

from groundstation.link.frames import Arrival
from groundstation.link.vehicle_state import VehicleState

NOTICED = 5.0
"""s; a vehicle says at least its heartbeat once a second: five of them in a row are missing"""
AGAIN = 60.0
"""s; of silence, between two lines about it"""


class HeartbeatMonitor:
    """Listens to the frames of one vehicle, and says when there are none."""

    def __init__(self, state: Callable[[], VehicleState], now: float) -> None:
        """``state`` tells whose frames count; ``now`` (s) is the clock that arrivals are stamped with."""
        self.total = 0.0
        """s; of all silences that were noticed and have ended"""
        self._state = state
        self._received_at = now
        self._due = now + NOTICED
        self._news: list[str] = []

    def handle_frame(self, arrival: Arrival) -> None:
        """Take one frame of anybody's."""
        if arrival.frame.system != self._state().system:
            return
        silence = arrival.at - self._received_at
        if silence >= NOTICED:
            self.total += silence
            self._news.append(f"telemetry resumed after {silence:.0f} s")
        self._received_at, self._due = arrival.at, arrival.at + NOTICED

    def silence(self, now: float) -> float:
        """s; of silence so far, the one that lasts included."""
        lasting = now - self._received_at
        return self.total + (lasting if lasting >= NOTICED else 0.0)

    def news(self, now: float) -> list[str]:
        """Lines for people that were not told yet."""
        told, self._news = self._news, []
        if now >= self._due:
            silence = now - self._received_at
            self._due = self._received_at + AGAIN * (silence // AGAIN + 1)
            told.append(f"no telemetry for {silence:.0f} s")
        return told
