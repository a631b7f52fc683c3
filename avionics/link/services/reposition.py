"""Commands of circles, altitude and airspeed.

The commands are NAV_LOITER_UNLIM, DO_REPOSITION, DO_ORBIT, DO_CHANGE_ALTITUDE and DO_CHANGE_SPEED.
"""

from __future__ import annotations

import math
from collections.abc import Callable

from avionics import topics
from avionics.link.dialect import mavlink
from avionics.link.mission_codec import GROUND_SPEED, decode_altitude, decode_item, read_speed, wire_scale
from avionics.link.services.command_result import CommandResult, Request, refused
from avionics.link.services.modes import ShownMode, mode_command
from avionics.link.vehicle import VehicleView
from avionics.link.wire_item import ItemRefused, WireItem
from avionics.messages import Command, CommandKind, Mode

_ACCEPTED = mavlink.MAV_RESULT_ACCEPTED
_DENIED = mavlink.MAV_RESULT_DENIED
_NO_PLACE = 2**31 - 1
"""degE7; COMMAND_INT without a position"""
_REPOSITION = mavlink.MAV_CMD_DO_REPOSITION
COUNTERCLOCKWISE = 1.0
"""yaw of a DO_REPOSITION in ArduPlane: the direction of the circle"""


class RepositionRequests:
    """Handlers of the commands that lead to LOITER."""

    def __init__(self, vehicle: VehicleView, shown: ShownMode) -> None:
        self._vehicle = vehicle
        self._shown = shown

    def answers(self) -> dict[int, Callable[[Request], CommandResult]]:
        """Return the handlers by MAV_CMD."""
        return {
            mavlink.MAV_CMD_NAV_LOITER_UNLIM: self._circle,
            _REPOSITION: self._reposition,
            mavlink.MAV_CMD_DO_ORBIT: self._orbit,
            mavlink.MAV_CMD_DO_CHANGE_ALTITUDE: self._change_altitude,
            mavlink.MAV_CMD_DO_CHANGE_SPEED: self._change_speed,
            mavlink.MAV_CMD_GUIDED_CHANGE_SPEED: self._change_speed,
        }

    def _submit(self, request: Request, command: Command, note: str = "") -> CommandResult:
        """Return acceptance with ``note``, or a denial with the reason of the flight core."""
        reason = self._vehicle.refusal(command)
        if reason:
            return refused(reason)
        self._shown.accepted(math.nan)
        return CommandResult(_ACCEPTED, (command,), note)

    def _command(self, kind: CommandKind, request: Request, name: str = "", value: float = 0.0) -> Command:
        return Command(self._vehicle.time_us, kind, name, value, None, request.sender.name)

    def _reposition(self, request: Request) -> CommandResult:
        """Circle at a position; without one change the altitude.

        QGroundControl uses the latter for PX4.
        """
        speed, altitude = request.params[0], request.params[6]
        note = "reposition: the ground speed is ignored" if speed > 0.0 else ""
        if _position(request) is not None or not math.isfinite(altitude) or altitude == 0.0:
            return self._circle(request, note)
        return self._to_altitude(request, altitude, request.frame, Mode.LOITER.name, note)

    def _circle(self, request: Request, note: str = "") -> CommandResult:
        """Circle at the present position, or at the position of the command."""
        position = _position(request)
        if position is None:
            return self._submit(request, mode_command(self._vehicle, Mode.LOITER, request.sender), note)
        radius = request.params[2] if math.isfinite(request.params[2]) else 0.0
        if request.command == _REPOSITION and request.params[3] == COUNTERCLOCKWISE:
            radius = -radius
        return self._circle_at(request, (*position, request.params[6]), radius, note)

    def _orbit(self, request: Request) -> CommandResult:
        """Circle with a radius about the position of the command or of the vehicle."""
        radius, speed = request.params[:2]
        note = "orbit: the speed is ignored" if speed > 0.0 else ""
        position = _position(request)
        if position is None:
            here = self._vehicle.latest(topics.POSITION)
            if here is None or not here.valid:
                return CommandResult(_DENIED, (), "orbit: no GPS position")
            position = (math.degrees(here.latitude), math.degrees(here.longitude))
        return self._circle_at(
            request, (*position, request.params[6]), radius if math.isfinite(radius) else 0.0, note
        )

    def _circle_at(
        self, request: Request, place: tuple[float, float, float], radius: float, note: str = ""
    ) -> CommandResult:
        """Return the result of LOITER_AT for latitude, longitude (deg) and altitude (m).

        A NaN altitude is the present one.
        """
        latitude, longitude, altitude = place
        frame, height = request.frame, self._vehicle.latest(topics.ALTITUDE)
        if not math.isfinite(altitude) and height is not None:
            frame, altitude = mavlink.MAV_FRAME_GLOBAL_RELATIVE_ALT, height.altitude
        circle = (0.0, 0.0, radius, 0.0)
        wanted = WireItem(frame, mavlink.MAV_CMD_NAV_LOITER_UNLIM, circle, latitude, longitude, altitude)
        try:
            item = decode_item(wanted, self._vehicle.home)
        except ItemRefused as refusal:
            return CommandResult(_DENIED, (), str(refusal))
        return self._submit(request, self._command(CommandKind.LOITER_AT, request)._replace(payload=item), note)

    def _change_altitude(self, request: Request) -> CommandResult:
        """Process DO_CHANGE_ALTITUDE with altitude and MAV_FRAME in LOITER or OFFBOARD."""
        altitude, frame = request.params[:2]
        if not 0.0 <= frame < 256.0:
            return CommandResult(_DENIED, (), "change altitude: no such frame")
        return self._to_altitude(request, altitude, int(frame), "", "")

    def _change_speed(self, request: Request) -> CommandResult:
        """Process DO_CHANGE_SPEED: airspeed until the mode changes.

        Throttle and acceleration are ignored.
        """
        speed = read_speed(request.params)
        if speed is None:
            return CommandResult(_DENIED, (), "change speed: only an airspeed or ground speed in m/s can be set")
        command = self._command(CommandKind.CHANGE_SPEED, request, "", speed)
        reason = self._vehicle.refusal(command)
        ground = request.params[0] == GROUND_SPEED and speed > 0.0
        note = "change speed: ground speed taken as airspeed" if ground else ""
        return refused(reason) if reason else CommandResult(_ACCEPTED, (command,), note)

    def _to_altitude(self, request: Request, altitude: float, frame: int, mode: str, note: str) -> CommandResult:
        try:
            above_home = decode_altitude(frame, altitude, self._vehicle.home)
        except ItemRefused as refusal:
            return CommandResult(_DENIED, (), str(refusal))
        command = self._command(CommandKind.CHANGE_ALTITUDE, request, mode, above_home)
        reason = self._vehicle.refusal(command)
        return refused(reason) if reason else CommandResult(_ACCEPTED, (command,), note)


def _position(request: Request) -> tuple[float, float] | None:
    """Return latitude and longitude (deg) of a command, None if it has none."""
    latitude, longitude = request.params[4:6]
    if request.is_int:
        if max(abs(latitude), abs(longitude)) >= _NO_PLACE:
            return None
        latitude, longitude = latitude / wire_scale(request.frame), longitude / wire_scale(request.frame)
    if not math.isfinite(latitude + longitude) or (latitude, longitude) == (0.0, 0.0):
        return None
    return latitude, longitude
