"""Stick inputs: MANUAL_CONTROL and RC_CHANNELS_OVERRIDE."""

from __future__ import annotations

from typing import Any

from avionics.link.services.service import Output, Sender
from avionics.link.vehicle import VehicleView
from avionics.messages import OVERRIDDEN, ChannelOverride, PilotInput

FULL = 1000.0
"""value of a stick at its limit"""


class ManualService:
    """Conversion of MANUAL_CONTROL and RC_CHANNELS_OVERRIDE to inputs.

    The inputs are `PilotInput` and `ChannelOverride`.
    """

    takes = frozenset({"MANUAL_CONTROL", "RC_CHANNELS_OVERRIDE"})

    def __init__(self, vehicle: VehicleView, system: int) -> None:
        self._vehicle = vehicle
        self._system = system

    def receive(self, message: Any, sender: Sender, now: float) -> list[Output]:
        """Return the sticks or the channels; the flight core interprets them."""
        if message.get_type() == "RC_CHANNELS_OVERRIDE":
            pulses = tuple(getattr(message, f"chan{number}_raw") for number in range(1, OVERRIDDEN + 1))
            return [ChannelOverride(self._vehicle.time_us, pulses)]
        return self._sticks(message)

    def _sticks(self, message: Any) -> list[Output]:
        """Return the sticks.

        The x axis of MAVLink is positive for stick forward, which is nose down.
        """
        if message.target != self._system:
            return []
        pitch, roll, yaw = _axis(-message.x), _axis(message.y), _axis(message.r)
        return [PilotInput(self._vehicle.time_us, pitch, roll, yaw, max(0.0, _axis(message.z)))]

    def step(self, now: float) -> list[Output]:
        """Return no periodic messages."""
        return []


def _axis(counts: int) -> float:
    # 32767 marks an axis that the sender does not provide.
    return 0.0 if abs(counts) >= 32767 else max(-1.0, min(1.0, counts / FULL))
