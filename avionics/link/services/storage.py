"""MAV_CMD_PREFLIGHT_STORAGE: read, write or reset the parameters.

A reset restores the values of the vehicle file.
"""

from __future__ import annotations

from collections.abc import Mapping

from avionics.link.dialect import mavlink
from avionics.link.services.command_result import CommandResult, Request, refused
from avionics.link.vehicle import Storage, VehicleView
from avionics.messages import Command, CommandKind
from wingbeat.errors import InputError

READ, WRITE, RESET = 0.0, 1.0, 2.0
"""values of the first parameter; 3 (sensors only) and 4 (everything) reset the parameters as well"""


class StorageRequests:
    """Parameter storage commands of the command service."""

    def __init__(self, vehicle: VehicleView, storage: Storage | None) -> None:
        self._vehicle = vehicle
        self._storage = storage

    def answer(self, request: Request) -> CommandResult:
        """Execute the action of the first parameter.

        It is denied while armed and without a file.
        """
        what = request.params[0]
        if self._storage is None:
            return CommandResult(mavlink.MAV_RESULT_DENIED, (), "storage: no parameter file is kept")
        if self._vehicle.armed:
            return CommandResult(mavlink.MAV_RESULT_DENIED, (), "storage: armed")
        try:
            if what == WRITE:
                self._storage.save({entry.name: entry.value for entry in self._vehicle.parameters})
                return CommandResult(mavlink.MAV_RESULT_ACCEPTED)
            if what == READ:
                return self._set(request, {**self._storage.defaults(), **self._storage.stored()})
        except (InputError, OSError) as failure:
            return CommandResult(mavlink.MAV_RESULT_FAILED, (), f"storage: {failure}")
        if what in (RESET, 4.0):
            return self._set(request, self._storage.defaults())
        return CommandResult(mavlink.MAV_RESULT_UNSUPPORTED, (), "storage: 0 reads, 1 writes, 2 resets")

    def _set(self, request: Request, values: Mapping[str, float]) -> CommandResult:
        """Return the inputs for the core that set changed values."""
        time_us, source = self._vehicle.time_us, request.sender.name
        commands = tuple(
            Command(time_us, CommandKind.SET_PARAMETER, entry.name, values[entry.name], None, source)
            for entry in self._vehicle.parameters
            if entry.name in values and values[entry.name] != entry.value
        )
        reason = self._vehicle.refusal(commands[0]) if commands else ""
        return refused(reason) if reason else CommandResult(mavlink.MAV_RESULT_ACCEPTED, commands)
