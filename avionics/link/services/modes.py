"""Modes: what AVAILABLE_MODES and CURRENT_MODE say, SET_MODE, and the mode a command asks for."""

from __future__ import annotations

import math
from enum import Enum
from typing import Any

from avionics import topics
from avionics.guidance.mission import ItemKind
from avionics.guidance.setpoint import Setpoint
from avionics.link.dialect import mavlink
from avionics.link.services.service import Output, Reply, Sender
from avionics.link.services.setpoints import SetpointService
from avionics.link.services.statustext import refusal_text
from avionics.link.services.verdict import refusal_result
from avionics.link.vehicle import NO_FRAMES, Identity, ModeNumbers, VehicleView, px4_mode
from avionics.messages import Command, CommandKind, Mode, Stage

ON_GROUND = (Stage.ON_GROUND, Stage.WAIT_LAUNCH, Stage.LANDED)
CURRENT_MODE_INTERVAL = 2.0
"""s; between two CURRENT_MODE messages when the mode stays"""


def available_modes(identity: Identity, index: int = 0) -> list[Any]:
    """AVAILABLE_MODES of all modes, or of the one with this index counted from 1; empty when there is none."""
    modes = identity.modes
    return [
        mavlink.MAVLink_available_modes_message(
            len(modes), number, entry.standard_mode, entry.custom_mode, 0, entry.name.encode()
        )
        for number, entry in enumerate(modes, start=1)
        if index in (0, number)
    ]


def current_mode(numbers: ModeNumbers) -> Any:
    """CURRENT_MODE."""
    return mavlink.MAVLink_current_mode_message(numbers.standard_mode, numbers.custom_mode, 0)


def custom_mode(identity: Identity, main: float, sub: float) -> float:
    """Parameters 2 and 3 of DO_SET_MODE as one custom mode; NaN for a mode that there is not."""
    if not (math.isfinite(main) and math.isfinite(sub)) or not (0 <= main < 2**32 and 0 <= sub < 256):
        return math.nan
    raw, packed = int(main), px4_mode(int(main) & 0xFF, int(sub))
    return next((float(each) for each in (raw, packed) if identity.by_custom_mode(each) is not None), math.nan)


def requested_mode(identity: Identity, main: float, sub: float) -> Mode | None:
    """The mode that parameters 2 and 3 of DO_SET_MODE ask for: main and sub mode, or a raw custom mode."""
    number = custom_mode(identity, main, sub)
    return None if math.isnan(number) else identity.by_custom_mode(int(number))


class _Takeoff(Enum):
    NONE = 0
    COMMANDED = 1
    ACTIVE = 2


class ShownMode:
    """The mode reported to clients: the vehicle's, or the hold mode that a client set on the ground.

    On the ground the vehicle waits for commands in any mode. The hold mode is reported until the mode changes or it
    flies.
    """

    def __init__(self, vehicle: VehicleView, identity: Identity) -> None:
        self._vehicle = vehicle
        self._identity = identity
        self._standby: tuple[Mode, ModeNumbers] | None = None
        """mode in which the vehicle waits on the ground, and the hold mode that was set"""
        self._takeoff = _Takeoff.NONE

    @property
    def numbers(self) -> ModeNumbers:
        """As it is written on the wire."""
        mode = self._vehicle.mode
        if self._takeoff is not _Takeoff.NONE and self._climbs_out(mode):
            return self._identity.takeoff
        if self._standby is not None and (mode != self._standby[0] or not self.on_ground):
            self._standby = None
        return self._identity.numbers(mode) if self._standby is None else self._standby[1]

    def waits(self, custom_mode: float) -> bool:
        """Whether a hold mode is set on the ground, which takes no command: the vehicle waits there in any mode."""
        return custom_mode in self._identity.standby_modes and self.on_ground

    def accepted(self, custom_mode: float) -> None:
        """A client set this mode, and gets it."""
        self._standby, self._takeoff = None, _Takeoff.NONE
        if self.waits(custom_mode):
            shown = next(each for each in self._identity.modes if each.custom_mode == custom_mode)
            self._standby = (self._vehicle.mode, shown)

    def takes_off(self) -> None:
        """A NAV_TAKEOFF was accepted: the takeoff mode is reported until its item ends or the mode changes."""
        self._standby, self._takeoff = None, _Takeoff.COMMANDED

    @property
    def on_ground(self) -> bool:
        """Whether the vehicle is on the ground or in the hand."""
        navigation = self._vehicle.latest(topics.NAVIGATION)
        return navigation is not None and navigation.stage in ON_GROUND

    def _climbs_out(self, mode: Mode) -> bool:
        """Whether the commanded takeoff is flown; the flight core begins it a tick after the command."""
        navigation, mission = self._vehicle.latest(topics.NAVIGATION), self._vehicle.mission
        item = len(mission) if navigation is None else navigation.item
        flown = mode == Mode.AUTO and item < len(mission) and mission[item].kind is ItemKind.TAKEOFF
        if flown:
            self._takeoff = _Takeoff.ACTIVE
        elif self._takeoff is _Takeoff.ACTIVE:
            self._takeoff = _Takeoff.NONE
        return flown


def mode_command(vehicle: VehicleView, mode: Mode, sender: Sender, entry: Setpoint | None = None) -> Command:
    """SET_MODE for the flight core; ``entry`` is `SetpointService.entry`."""
    return Command(vehicle.time_us, CommandKind.SET_MODE, mode.name, float(mode), entry, sender.name)


class ModeService:
    """The old SET_MODE message, and CURRENT_MODE."""

    takes = frozenset({"SET_MODE"})

    def __init__(
        self, vehicle: VehicleView, identity: Identity, shown: ShownMode, setpoints: SetpointService
    ) -> None:
        self._vehicle = vehicle
        self._setpoints = setpoints
        self._identity = identity
        self._shown = shown
        self._due = -float("inf")
        self._said: ModeNumbers | None = None

    def receive(self, message: Any, sender: Sender, now: float) -> list[Output]:
        """SET_MODE, answered with an acknowledgement of DO_SET_MODE."""
        custom = bool(message.base_mode & mavlink.MAV_MODE_FLAG_CUSTOM_MODE_ENABLED)
        mode = requested_mode(self._identity, message.custom_mode, 0) if custom else None
        if mode is None:
            return [Reply(_ack(mavlink.MAV_RESULT_DENIED, sender), sender), *refusal_text("no such mode", sender)]
        command = mode_command(self._vehicle, mode, sender, self._setpoints.entry(mode))
        reason, waits = self._vehicle.refusal(command), self._shown.waits(message.custom_mode)
        if reason == NO_FRAMES or (reason and not waits):
            return [Reply(_ack(refusal_result(reason), sender), sender), *refusal_text(reason, sender)]
        self._shown.accepted(message.custom_mode)
        accepted = Reply(_ack(mavlink.MAV_RESULT_ACCEPTED, sender), sender)
        return [accepted] if waits else [command, accepted]

    def step(self, now: float) -> list[Output]:
        """CURRENT_MODE, at once when the mode changes."""
        numbers = self._shown.numbers
        if now < self._due and numbers is self._said:
            return []
        self._due = now + CURRENT_MODE_INTERVAL
        self._said = numbers
        return [Reply(current_mode(numbers))]


def _ack(result: int, sender: Sender) -> Any:
    return mavlink.MAVLink_command_ack_message(
        mavlink.MAV_CMD_DO_SET_MODE, result, 0, 0, sender.system, sender.component
    )
