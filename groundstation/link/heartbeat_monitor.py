"""Heartbeat-loss monitor with rate-limited notices."""

from __future__ import annotations

from collections.abc import Callable

from groundstation.link.frames import Arrival
from groundstation.link.vehicle_state import VehicleState

NOTICED = 5.0
"""s; silence that counts as a loss: five missing heartbeats"""
AGAIN = 60.0
"""s; of silence, between two notices"""


class HeartbeatMonitor:
    """Monitor of the frames of one vehicle with notices of their loss."""

    def __init__(self, state: Callable[[], VehicleState], now: float) -> None:
        """Monitor the vehicle of ``state``; ``now`` (s) is the clock of the arrival times."""
        self.total = 0.0
        """s; total of the losses that have ended"""
        self._state = state
        self._received_at = now
        self._due = now + NOTICED
        self._news: list[str] = []

    def handle_frame(self, arrival: Arrival) -> None:
        """Process one frame of any sender."""
        if arrival.frame.system != self._state().system:
            return
        silence = arrival.at - self._received_at
        if silence >= NOTICED:
            self.total += silence
            self._news.append(f"telemetry resumed after {silence:.0f} s")
        self._received_at, self._due = arrival.at, arrival.at + NOTICED

    def silence(self, now: float) -> float:
        """Return the total silence in s, the present one included."""
        lasting = now - self._received_at
        return self.total + (lasting if lasting >= NOTICED else 0.0)

    def news(self, now: float) -> list[str]:
        """Return the new notices."""
        told, self._news = self._news, []
        if now >= self._due:
            silence = now - self._received_at
            self._due = self._received_at + AGAIN * (silence // AGAIN + 1)
            told.append(f"no telemetry for {silence:.0f} s")
        return told
