"""Mode service: AVAILABLE_MODES, CURRENT_MODE and requested modes."""

from __future__ import annotations

import math
from enum import Enum
from typing import Any

from avionics import topics
from avionics.guidance.mission import ItemKind
from avionics.guidance.setpoint import Setpoint
from avionics.link.dialect import mavlink
from avionics.link.services.service import Output, Reply, Sender
from avionics.link.vehicle import Identity, ModeNumbers, VehicleView, px4_mode
from avionics.messages import Command, CommandKind, Mode, Stage

ON_GROUND = (Stage.ON_GROUND, Stage.WAIT_LAUNCH, Stage.LANDED)
CURRENT_MODE_INTERVAL = 2.0
"""s; interval of CURRENT_MODE without a change"""


def available_modes(identity: Identity, index: int = 0) -> list[Any]:
    """Return AVAILABLE_MODES of all modes, or of one.

    ``index`` counts from 1; the result is empty if it does not exist.
    """
    modes = identity.modes
    return [
        mavlink.MAVLink_available_modes_message(
            len(modes), number, entry.standard_mode, entry.custom_mode, 0, entry.name.encode()
        )
        for number, entry in enumerate(modes, start=1)
        if index in (0, number)
    ]


def current_mode(numbers: ModeNumbers) -> Any:
    """Return CURRENT_MODE."""
    return mavlink.MAVLink_current_mode_message(numbers.standard_mode, numbers.custom_mode, 0)


def custom_mode(identity: Identity, main: float, sub: float) -> float:
    """Return parameters 2 and 3 of DO_SET_MODE as a custom mode; NaN if unknown."""
    if not (math.isfinite(main) and math.isfinite(sub)) or not (0 <= main < 2**32 and 0 <= sub < 256):
        return math.nan
    raw, packed = int(main), px4_mode(int(main) & 0xFF, int(sub))
    return next((float(each) for each in (raw, packed) if identity.by_custom_mode(each) is not None), math.nan)


def requested_mode(identity: Identity, main: float, sub: float) -> Mode | None:
    """Return the mode of parameters 2 and 3 of DO_SET_MODE.

    These are main and sub mode, or a raw custom mode.
    """
    number = custom_mode(identity, main, sub)
    return None if math.isnan(number) else identity.by_custom_mode(int(number))


class _Takeoff(Enum):
    NONE = 0
    COMMANDED = 1
    ACTIVE = 2


class ShownMode:
    """Mode reported to clients.

    It is the mode of the vehicle, or the hold mode that a client set on the ground. On the ground the vehicle waits
    for commands in any mode. The hold mode is reported until the mode changes or the vehicle flies.
    """

    def __init__(self, vehicle: VehicleView, identity: Identity) -> None:
        self._vehicle = vehicle
        self._identity = identity
        self._standby: tuple[Mode, ModeNumbers] | None = None
        """mode of the vehicle on the ground, and the selected hold mode"""
        self._takeoff = _Takeoff.NONE

    @property
    def numbers(self) -> ModeNumbers:
        """Return the numbers of the mode on the wire."""
        mode = self._vehicle.mode
        if self._takeoff is not _Takeoff.NONE and self._climbs_out(mode):
            return self._identity.takeoff
        if self._standby is not None and (mode != self._standby[0] or not self.on_ground):
            self._standby = None
        return self._identity.numbers(mode) if self._standby is None else self._standby[1]

    def waits(self, custom_mode: float) -> bool:
        """Return whether a hold mode is selected on the ground, which requires no command.

        On the ground the vehicle waits in any mode. The result is False if it is armed in AUTO: a throw would then
        start the mission in spite of the hold mode.
        """
        flies_mission = self._vehicle.armed and self._vehicle.mode == Mode.AUTO
        return custom_mode in self._identity.standby_modes and self.on_ground and not flies_mission

    def accepted(self, custom_mode: float) -> None:
        """Store the mode that a client selected."""
        self._standby, self._takeoff = None, _Takeoff.NONE
        if self.waits(custom_mode):
            shown = next(each for each in self._identity.modes if each.custom_mode == custom_mode)
            self._standby = (self._vehicle.mode, shown)

    def takes_off(self) -> None:
        """Report the takeoff mode until its item ends or the mode changes."""
        self._standby, self._takeoff = None, _Takeoff.COMMANDED

    @property
    def on_ground(self) -> bool:
        """Return whether the vehicle is on the ground or in the hand."""
        navigation = self._vehicle.latest(topics.NAVIGATION)
        return navigation is not None and navigation.stage in ON_GROUND

    def _climbs_out(self, mode: Mode) -> bool:
        """Return whether the commanded takeoff is active.

        The flight core begins it one tick after the command.
        """
        navigation, mission = self._vehicle.latest(topics.NAVIGATION), self._vehicle.mission
        item = len(mission) if navigation is None else navigation.item
        flown = mode == Mode.AUTO and item < len(mission) and mission[item].kind is ItemKind.TAKEOFF
        if flown:
            self._takeoff = _Takeoff.ACTIVE
        elif self._takeoff is _Takeoff.ACTIVE:
            self._takeoff = _Takeoff.NONE
        return flown


def mode_command(vehicle: VehicleView, mode: Mode, sender: Sender, entry: Setpoint | None = None) -> Command:
    """Return SET_MODE for the flight core; ``entry`` is `SetpointService.entry`."""
    return Command(vehicle.time_us, CommandKind.SET_MODE, mode.name, float(mode), entry, sender.name)


class ModeService:
    """Service for CURRENT_MODE."""

    takes: frozenset[str] = frozenset()

    def __init__(self, shown: ShownMode) -> None:
        self._shown = shown
        self._due = -float("inf")
        self._sent: ModeNumbers | None = None

    def receive(self, message: Any, sender: Sender, now: float) -> list[Output]:
        """Ignore the message."""
        return []

    def step(self, now: float) -> list[Output]:
        """Send CURRENT_MODE when due, and at once after a change of the mode."""
        numbers = self._shown.numbers
        if now < self._due and numbers is self._sent:
            return []
        self._due = now + CURRENT_MODE_INTERVAL
        self._sent = numbers
        return [Reply(current_mode(numbers))]
