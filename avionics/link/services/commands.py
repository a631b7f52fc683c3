"""Command service: COMMAND_LONG, COMMAND_INT and the old SET_MODE.

Each is answered by one COMMAND_ACK; a denial includes its reason.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import Any

from avionics.guidance.mission import ItemKind, MissionItem, landing_sequence
from avionics.link.dialect import mavlink
from avionics.link.excitation_codec import DECODERS as EXCITE_COMMANDS
from avionics.link.excitation_codec import decode_excitation
from avionics.link.mission_codec import decode_item
from avionics.link.services.calibration import OWN as CALIBRATE
from avionics.link.services.calibration import PREFLIGHT, CalibrationRequests
from avionics.link.services.command_result import CommandResult, Request, refused
from avionics.link.services.mission import MissionService
from avionics.link.services.modes import ShownMode, custom_mode, mode_command, requested_mode
from avionics.link.services.reposition import RepositionRequests
from avionics.link.services.requests import Requests
from avionics.link.services.service import Output, Reply, Sender
from avionics.link.services.setpoints import SetpointService
from avionics.link.services.statustext import refusal_text
from avionics.link.services.storage import StorageRequests
from avionics.link.vehicle import NO_FRAMES, Identity, Storage, VehicleView
from avionics.link.wire_item import ItemRefused, WireItem
from avionics.messages import Command, CommandKind, Mode

_ACCEPTED = mavlink.MAV_RESULT_ACCEPTED
_DENIED = mavlink.MAV_RESULT_DENIED
_UNSUPPORTED = mavlink.MAV_RESULT_UNSUPPORTED
_LATER = mavlink.MAV_RESULT_TEMPORARILY_REJECTED
TURNING_ALTITUDE = "NAV_RETURN_FLOOR"
"""parameter: m above home, below which the flight path stays straight with wings level"""


Answer = Callable[[Request], CommandResult]


class CommandService:
    """Dispatch of commands by a table from MAV_CMD to a method."""

    takes = frozenset({"COMMAND_LONG", "COMMAND_INT", "SET_MODE"})

    def __init__(
        self,
        vehicle: VehicleView,
        identity: Identity,
        requests: Requests,
        missions: MissionService,
        shown: ShownMode,
        setpoints: SetpointService,
        storage: Storage | None = None,
    ) -> None:
        self._vehicle = vehicle
        self._identity = identity
        self._requests = requests
        self._missions = missions
        self._shown = shown
        self._setpoints = setpoints
        self._calibrations = CalibrationRequests(vehicle)
        self._answers = self._build_answers(StorageRequests(vehicle, storage))

    def _build_answers(self, storage: StorageRequests) -> dict[int, Answer]:
        """Return the table of command handlers."""
        return {
            mavlink.MAV_CMD_COMPONENT_ARM_DISARM: self._arm,
            mavlink.MAV_CMD_DO_SET_MODE: self._set_mode,
            mavlink.MAV_CMD_DO_SET_STANDARD_MODE: self._set_standard_mode,
            mavlink.MAV_CMD_NAV_TAKEOFF: self._takeoff,
            mavlink.MAV_CMD_NAV_LAND: lambda request: self._mode(request, Mode.LAND),
            mavlink.MAV_CMD_NAV_RETURN_TO_LAUNCH: lambda request: self._mode(request, Mode.RETURN),
            mavlink.MAV_CMD_MISSION_START: self._start_mission,
            mavlink.MAV_CMD_DO_LAND_START: self._start_landing,
            mavlink.MAV_CMD_DO_SET_MISSION_CURRENT: self._set_current,
            **RepositionRequests(self._vehicle, self._shown).answers(),
            mavlink.MAV_CMD_DO_FLIGHTTERMINATION: self._terminate,
            **dict.fromkeys(EXCITE_COMMANDS, self._excite),
            PREFLIGHT: self._calibrations.answer,
            CALIBRATE: self._calibrations.answer,
            mavlink.MAV_CMD_PREFLIGHT_STORAGE: storage.answer,
            mavlink.MAV_CMD_REQUEST_MESSAGE: self._request_message,
            mavlink.MAV_CMD_REQUEST_PROTOCOL_VERSION: self._fixed(mavlink.MAVLINK_MSG_ID_PROTOCOL_VERSION),
            mavlink.MAV_CMD_REQUEST_AUTOPILOT_CAPABILITIES: self._fixed(mavlink.MAVLINK_MSG_ID_AUTOPILOT_VERSION),
            mavlink.MAV_CMD_GET_HOME_POSITION: self._fixed(mavlink.MAVLINK_MSG_ID_HOME_POSITION),
            mavlink.MAV_CMD_SET_MESSAGE_INTERVAL: self._set_interval,
            mavlink.MAV_CMD_GET_MESSAGE_INTERVAL: self._get_interval,
        }

    def receive(self, message: Any, sender: Sender, now: float) -> list[Output]:
        """Process a command; the acknowledgement precedes the requested messages."""
        request = _read(message, sender)
        answer = self._answers.get(request.command)
        command_result = CommandResult(_UNSUPPORTED) if answer is None else answer(request)
        ack = mavlink.MAVLink_command_ack_message(
            request.command, command_result.result, 0, 0, sender.system, sender.component
        )
        return [Reply(ack, sender), *refusal_text(command_result.reason, sender), *command_result.outputs]

    def step(self, now: float) -> list[Output]:
        """Return the progress and the result of a calibration."""
        return self._calibrations.step(now)

    def _forward(self, *commands: Command) -> CommandResult:
        """Accept if the flight core accepts the first of ``commands``.

        The other commands depend on it.
        """
        reason = self._vehicle.refusal(commands[0])
        return refused(reason) if reason else CommandResult(_ACCEPTED, commands)

    def _command(self, kind: CommandKind, request: Request, value: float = 0.0, payload: Any = None) -> Command:
        return Command(self._vehicle.time_us, kind, "", value, payload, request.sender.name)

    def _arm(self, request: Request) -> CommandResult:
        if request.params[0] not in (0.0, 1.0):
            return CommandResult(_DENIED, (), "arm: the first parameter must be 0 or 1")
        kind = CommandKind.ARM if request.params[0] else CommandKind.DISARM
        return self._forward(self._command(kind, request, request.params[1]))

    def _terminate(self, request: Request) -> CommandResult:
        if not request.params[0] > 0.5:  # also what is no number
            return CommandResult(_DENIED, (), "flight termination ends with arming anew")
        return self._forward(self._command(CommandKind.KILL, request))

    def _mode(self, request: Request, mode: Mode | None, requested: float = math.nan) -> CommandResult:
        """Change to ``mode``.

        ``requested`` is the custom mode of the command, NaN if it has none.
        """
        if mode is None:
            names = ", ".join(dict.fromkeys(entry.mode.name for entry in self._identity.modes))
            return CommandResult(_DENIED, (), f"no such mode; there are {names}")
        command_result = self._forward(mode_command(self._vehicle, mode, request.sender, self._setpoints.entry(mode)))
        waits = self._shown.waits(requested) and command_result.reason != NO_FRAMES
        if waits or command_result.result == _ACCEPTED:
            self._shown.accepted(requested)
        return CommandResult(_ACCEPTED) if waits else command_result

    def _set_mode(self, request: Request) -> CommandResult:
        base = request.params[0]
        if not (0 <= base <= 255 and int(base) & mavlink.MAV_MODE_FLAG_CUSTOM_MODE_ENABLED):
            return CommandResult(_DENIED, (), "set mode: only custom modes are understood")
        _, main, sub = request.params[:3]
        requested = custom_mode(self._identity, main, sub)
        if requested == self._identity.takeoff.custom_mode:
            return self._takeoff(request._replace(params=(math.nan,) * 7))
        return self._mode(request, requested_mode(self._identity, main, sub), requested)

    def _set_standard_mode(self, request: Request) -> CommandResult:
        wanted = request.params[0]
        if wanted == self._identity.takeoff.standard_mode:
            return self._takeoff(request._replace(params=(math.nan,) * 7))
        known = self._identity.by_standard_mode(int(wanted)) if 0 <= wanted <= 255 else None
        return self._mode(request, known)

    def _auto_from(self, request: Request, item: int) -> CommandResult:
        select = self._command(CommandKind.SET_CURRENT_ITEM, request, float(item))
        auto = mode_command(self._vehicle, Mode.AUTO, request.sender)
        reason = self._vehicle.refusal(auto) or self._vehicle.refusal(select)
        return refused(reason) if reason else CommandResult(_ACCEPTED, (select, auto))

    def _takeoff(self, request: Request) -> CommandResult:
        """Begin a takeoff and report its mode; on the ground it starts with the throw."""
        command_result = self._begin_takeoff(request)
        if command_result.result != _ACCEPTED:
            return command_result
        waits = "takeoff waits for the throw" if self._shown.on_ground else ""
        self._shown.takes_off()
        return command_result._replace(reason="; ".join(filter(None, (command_result.reason, waits))))

    def _begin_takeoff(self, request: Request) -> CommandResult:
        """Enter AUTO at the TAKEOFF item, with the requested altitude, if any."""
        mission = self._vehicle.mission
        kinds = [item.kind for item in mission]
        if not mission:
            return self._takeoff_without_mission(request)
        if ItemKind.TAKEOFF not in kinds:
            begun = self._auto_from(request, 0)
            return begun._replace(reason=begun.reason or "the mission has no takeoff: its first item begins")
        number = kinds.index(ItemKind.TAKEOFF)
        begun = self._auto_from(request, number)
        if begun.result != _ACCEPTED or math.isnan(request.params[6]) or request.params[6] == 0.0:
            return begun
        try:
            requested = self._takeoff_altitude(request)
        except ItemRefused as why:
            return CommandResult(_DENIED, (), f"takeoff: {why}")
        altitude = max(requested, self._lowest_takeoff(mission[number])) if requested > 0.0 else requested
        raised = f"takeoff: to {altitude:g} m, {requested:g} m is too low to turn" if altitude > requested else ""
        if altitude == mission[number].altitude:
            return begun._replace(reason=raised)
        changed = (*mission[:number], mission[number]._replace(altitude=altitude), *mission[number + 1 :])
        put = self._forward(self._command(CommandKind.SET_MISSION, request, payload=changed))
        if put.result != _ACCEPTED:
            return put
        return CommandResult(_ACCEPTED, (*put.outputs, *begun.outputs), raised)

    def _takeoff_without_mission(self, request: Request) -> CommandResult:
        """Set a mission of a takeoff to the altitude of the command and a circle at home."""
        if self._vehicle.home is None:
            return CommandResult(_LATER, (), "takeoff: no GPS position")
        floor = self._turning_altitude()
        try:
            requested = self._takeoff_altitude(request) if math.isfinite(request.params[6]) else floor
        except ItemRefused as why:
            return CommandResult(_DENIED, (), f"takeoff: {why}")
        altitude = max(requested, floor)
        items = (MissionItem(ItemKind.TAKEOFF, altitude=altitude), MissionItem(ItemKind.LOITER, altitude=altitude))
        put = self._forward(self._command(CommandKind.SET_MISSION, request, payload=items))
        if put.result != _ACCEPTED:
            return put
        select = self._command(CommandKind.SET_CURRENT_ITEM, request, 0.0)
        auto = mode_command(self._vehicle, Mode.AUTO, request.sender)
        return CommandResult(
            _ACCEPTED, (*put.outputs, select, auto), f"takeoff: to {altitude:g} m, then LOITER at home"
        )

    def _takeoff_altitude(self, request: Request) -> float:
        """Return the altitude of a takeoff (m above home).

        Raises:
            ItemRefused: the altitude cannot be decoded.
        """
        frame = request.frame if request.is_int else self._identity.takeoff_frame
        wanted = WireItem(frame, mavlink.MAV_CMD_NAV_TAKEOFF, (0.0,) * 4, 0.0, 0.0, request.params[6])
        return decode_item(wanted, self._vehicle.home).altitude

    def _lowest_takeoff(self, planned: MissionItem) -> float:
        """Return the minimum takeoff altitude (m above home).

        It is the minimum altitude of turns, or the planned altitude if lower. MAVSDK sends 2 m by default.
        """
        return min(planned.altitude, self._turning_altitude())

    def _turning_altitude(self) -> float:
        return next((each.value for each in self._vehicle.parameters if each.name == TURNING_ALTITUDE), 0.0)

    def _start_mission(self, request: Request) -> CommandResult:
        if not self._vehicle.mission:
            return CommandResult(_DENIED, (), "there is no mission to start")
        first = request.params[0] if request.params[0] > 0.0 else 0.0
        reason = self._missions.current_refusal(_whole(first))
        return (
            CommandResult(_DENIED, (), reason)
            if reason
            else self._auto_from(request, self._missions.item(int(first)))
        )

    def _start_landing(self, request: Request) -> CommandResult:
        """Enter AUTO at the DO_LAND_START of the mission, as in ArduPlane."""
        start = landing_sequence(self._vehicle.mission)
        if start is None:
            return CommandResult(_DENIED, (), "the mission has no DO_LAND_START that leads to a landing")
        return self._auto_from(request, start)

    def _set_current(self, request: Request) -> CommandResult:
        number = _whole(request.params[0])
        reason = self._missions.current_refusal(number)
        if reason:
            return CommandResult(_DENIED, (), reason)
        item = float(self._missions.item(number))
        return self._forward(self._command(CommandKind.SET_CURRENT_ITEM, request, item))

    def _excite(self, request: Request) -> CommandResult:
        params = request.params
        item = WireItem(0, request.command, (params[0], params[1], params[2], params[3]), *params[4:7])
        try:
            excitation = decode_excitation(item)
        except ItemRefused as why:
            return CommandResult(_DENIED, (), str(why))
        return self._forward(self._command(CommandKind.EXCITE, request, payload=excitation))

    def _request_message(self, request: Request) -> CommandResult:
        return self._send(request, self._requests.build(request.params[0], request.params[1], request.sender.link))

    def _fixed(self, message_id: int) -> Answer:
        return lambda request: self._send(request, self._requests.build(message_id, 0.0, request.sender.link))

    def _send(self, request: Request, messages: list[Any] | None) -> CommandResult:
        if messages is None:
            return CommandResult(_UNSUPPORTED)
        if not messages:
            return CommandResult(_LATER)
        return CommandResult(_ACCEPTED, tuple(Reply(message, request.sender) for message in messages))

    def _set_interval(self, request: Request) -> CommandResult:
        message_id, interval_us = request.params[:2]
        known = self._requests.set_interval(request.sender.link, message_id, interval_us)
        return CommandResult(_ACCEPTED if known else _UNSUPPORTED)

    def _get_interval(self, request: Request) -> CommandResult:
        return self._send(request, self._requests.interval(request.sender.link, request.params[0]))


def _whole(value: float) -> int:
    """Return ``value`` as an integer, -1 if it is not one."""
    return int(value) if value == value and abs(value) < 1e6 and value == int(value) else -1


def _read(message: Any, sender: Sender) -> Request:
    if message.get_type() == "SET_MODE":
        mode = (float(message.base_mode), float(message.custom_mode), *(0.0,) * 5)
        return Request(mavlink.MAV_CMD_DO_SET_MODE, mode, sender)
    first = (message.param1, message.param2, message.param3, message.param4)
    if message.get_type() == "COMMAND_INT":
        params = (*first, float(message.x), float(message.y), message.z)
        return Request(message.command, params, sender, message.frame, is_int=True)
    return Request(message.command, (*first, message.param5, message.param6, message.param7), sender)
