"""Calibration commands, acknowledged as in progress until they end."""

from __future__ import annotations

import math
from typing import Any, NamedTuple

from avionics import topics
from avionics.link.dialect import mavlink
from avionics.link.services.command_result import CommandResult, Request, refused
from avionics.link.services.service import Output, Reply, Sender
from avionics.link.vehicle import VehicleView
from avionics.messages import Calibration, CalibrationStatus, Command, CommandKind

PREFLIGHT: int = mavlink.MAV_CMD_PREFLIGHT_CALIBRATION
OWN: int = mavlink.MAV_CMD_WINGBEAT_CALIBRATE
TELL_EVERY = 1.0
"""s; interval of the acknowledgements in progress"""
CONFIRM = 1.0
"""s; timeout for the start in the flight core"""
PREFLIGHT_KINDS: dict[tuple[int, float], Calibration] = {
    (2, 1.0): Calibration.MAGNETOMETER,
    (5, 1.0): Calibration.ACCELEROMETER,
    (5, 2.0): Calibration.LEVEL,
    (5, 4.0): Calibration.LEVEL,
    (6, 1.0): Calibration.AIRSPEED_ZERO,
    (6, 2.0): Calibration.AIRSPEED_ZERO,
}
"""calibrations by parameter number and value of MAV_CMD_PREFLIGHT_CALIBRATION:

5 is the accelerometer (1 on all sides, 2 level, 4 in one pose), 6 the airspeed (1 as in PX4, 2 as in the definition)
"""
NOT_NEEDED = "neither the gyroscope (learned at rest) nor the barometer (zero at boot) needs a calibration"


class _Pending(NamedTuple):
    request: Request
    calibration_number: int
    """number of calibrations since boot once it has begun"""
    requested_at: float
    acknowledged_at: float


class CalibrationRequests:
    """Calibration commands of the command service."""

    def __init__(self, vehicle: VehicleView) -> None:
        self._vehicle = vehicle
        self._pending: _Pending | None = None
        self._fresh: Request | None = None

    def answer(self, request: Request) -> CommandResult:
        """Begin or cancel a calibration, or return the reason of a denial.

        A repeated request is acknowledged as in progress.
        """
        if self._pending is not None and self._pending.request == request:
            return CommandResult(mavlink.MAV_RESULT_IN_PROGRESS)
        if request.command == PREFLIGHT and not any(request.params):
            return self._cancel(request)
        kind, argument = _requested_kind(request)
        if not kind:
            return CommandResult(mavlink.MAV_RESULT_UNSUPPORTED, (), f"calibration: {NOT_NEEDED}")
        command = Command(
            self._vehicle.time_us, CommandKind.CALIBRATE, kind.name, argument, None, request.sender.name
        )
        reason = "calibration denied: one has just begun" if self._fresh else self._vehicle.refusal(command)
        if reason:
            return refused(reason)
        self._fresh = request
        return CommandResult(mavlink.MAV_RESULT_IN_PROGRESS, (command,))

    def _cancel(self, request: Request) -> CommandResult:
        command = Command(self._vehicle.time_us, CommandKind.CALIBRATE, source=request.sender.name)
        reason = self._vehicle.refusal(command)
        return refused(reason) if reason else CommandResult(mavlink.MAV_RESULT_ACCEPTED, (command,))

    def step(self, now: float) -> list[Output]:
        """Acknowledge a calibration in progress once a second, and its result at the end."""
        if self._fresh is not None:
            before = _calibration_count(self._vehicle)
            self._pending, self._fresh = _Pending(self._fresh, before + 1, now, now), None
        pending = self._pending
        if pending is None:
            return []
        status: CalibrationStatus | None = self._vehicle.latest(topics.CALIBRATION)
        if status is None or status.calibration_count < pending.calibration_number:
            if now - pending.requested_at < CONFIRM:
                return []
            return self._end(pending, mavlink.MAV_RESULT_FAILED)
        if not status.running or status.calibration_count > pending.calibration_number:
            done = status.succeeded and status.calibration_count == pending.calibration_number
            return self._end(pending, mavlink.MAV_RESULT_ACCEPTED if done else mavlink.MAV_RESULT_FAILED)
        if now - pending.acknowledged_at < TELL_EVERY:
            return []
        self._pending = pending._replace(acknowledged_at=now)
        return [_ack(pending.request, mavlink.MAV_RESULT_IN_PROGRESS, round(100.0 * status.progress))]

    def _end(self, pending: _Pending, result: int) -> list[Output]:
        self._pending = None
        return [_ack(pending.request, result, 100)]


def _calibration_count(vehicle: VehicleView) -> int:
    status: CalibrationStatus | None = vehicle.latest(topics.CALIBRATION)
    return 0 if status is None else status.calibration_count


def _requested_kind(request: Request) -> tuple[Calibration, float]:
    """Return the requested calibration and its argument; NONE if unknown."""
    if request.command == OWN:
        number, argument = request.params[:2]
        known = math.isfinite(number) and number in tuple(Calibration)
        return (Calibration(int(number)) if known else Calibration.NONE), argument
    for (place, value), kind in PREFLIGHT_KINDS.items():
        if request.params[place - 1] == value:
            return kind, 0.0
    return Calibration.NONE, 0.0


def _ack(request: Request, result: int, progress: int) -> Reply:
    sender: Sender = request.sender
    message: Any = mavlink.MAVLink_command_ack_message(
        request.command, result, progress, 0, sender.system, sender.component
    )
    return Reply(message, sender)
