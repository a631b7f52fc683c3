"""Modes: what AVAILABLE_MODES and CURRENT_MODE say, SET_MODE, and the mode a command asks for."""

from __future__ import annotations

import math
from typing import Any

from avionics import topics
from avionics.link.dialect import mavlink
from avionics.link.services.service import Output, Reply, Sender
from avionics.link.services.statustext import refusal_text
from avionics.link.services.verdict import refusal_result
from avionics.link.vehicle import Identity, VehicleView, px4_mode
from avionics.messages import Command, CommandKind, Mode, Stage

ON_GROUND = (Stage.ON_GROUND, Stage.WAIT_LAUNCH, Stage.LANDED)
CURRENT_MODE_INTERVAL = 2.0
"""s; between two CURRENT_MODE messages when the mode stays"""


def available_modes(identity: Identity, index: int = 0) -> list[Any]:
    """AVAILABLE_MODES of all modes, or of the one with this index counted from 1; empty when there is none."""
    modes = identity.modes
    return [
        mavlink.MAVLink_available_modes_message(
            len(modes), number, entry.standard_mode, entry.custom_mode, 0, entry.mode.name.encode()
        )
        for number, entry in enumerate(modes, start=1)
        if index in (0, number)
    ]


def current_mode(vehicle: VehicleView, identity: Identity) -> Any:
    """CURRENT_MODE."""
    numbers = identity.numbers(vehicle.mode)
    return mavlink.MAVLink_current_mode_message(numbers.standard_mode, numbers.custom_mode, 0)


def requested_mode(identity: Identity, main: float, sub: float) -> Mode | None:
    """The mode that parameters 2 and 3 of DO_SET_MODE ask for: main and sub mode, or a raw custom mode."""
    if not (math.isfinite(main) and math.isfinite(sub)) or not (0 <= main < 2**32 and 0 <= sub < 256):
        return None
    return identity.by_custom_mode(int(main)) or identity.by_custom_mode(px4_mode(int(main) & 0xFF, int(sub)))


def is_wait_for_takeoff(vehicle: VehicleView, identity: Identity, custom_mode: float) -> bool:
    """Whether GUIDED is asked for on the ground: the vehicle waits for commands there in any mode."""
    navigation = vehicle.latest(topics.NAVIGATION)
    return custom_mode == identity.guided and navigation is not None and navigation.stage in ON_GROUND


def mode_command(vehicle: VehicleView, mode: Mode, sender: Sender) -> Command:
    """The input that asks the flight core for a mode."""
    return Command(vehicle.time_us, CommandKind.SET_MODE, mode.name, float(mode), None, sender.name)


class ModeService:
    """The old SET_MODE message, and CURRENT_MODE."""

    handles = frozenset({"SET_MODE"})

    def __init__(self, vehicle: VehicleView, identity: Identity) -> None:
        self._vehicle = vehicle
        self._identity = identity
        self._due = -float("inf")
        self._said: Mode | None = None

    def receive(self, message: Any, sender: Sender, now: float) -> list[Output]:
        """SET_MODE, answered with an acknowledgement of DO_SET_MODE."""
        custom = bool(message.base_mode & mavlink.MAV_MODE_FLAG_CUSTOM_MODE_ENABLED)
        mode = requested_mode(self._identity, message.custom_mode, 0) if custom else None
        if mode is None:
            return [Reply(_ack(mavlink.MAV_RESULT_DENIED, sender), sender), *refusal_text("no such mode", sender)]
        if is_wait_for_takeoff(self._vehicle, self._identity, message.custom_mode):
            return [Reply(_ack(mavlink.MAV_RESULT_ACCEPTED, sender), sender)]
        command = mode_command(self._vehicle, mode, sender)
        reason = self._vehicle.refusal(command)
        if reason:
            return [Reply(_ack(refusal_result(reason), sender), sender), *refusal_text(reason, sender)]
        return [command, Reply(_ack(mavlink.MAV_RESULT_ACCEPTED, sender), sender)]

    def step(self, now: float) -> list[Output]:
        """CURRENT_MODE, at once when the mode changes."""
        mode = self._vehicle.mode
        if now < self._due and mode == self._said:
            return []
        self._due = now + CURRENT_MODE_INTERVAL
        self._said = mode
        return [Reply(current_mode(self._vehicle, self._identity))]


def _ack(result: int, sender: Sender) -> Any:
    return mavlink.MAVLink_command_ack_message(
        mavlink.MAV_CMD_DO_SET_MODE, result, 0, 0, sender.system, sender.component
    )
