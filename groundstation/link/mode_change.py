"""Transactions of flight modes: change with confirmation, available names."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any, NamedTuple

from avionics.link.dialect import mavlink
from groundstation.link.commands import CommandExchange
from groundstation.link.exchange import ATTEMPTS, RETRY, Outgoing, Progress, Target
from groundstation.link.vehicle_state import is_autopilot


class ModeChange(NamedTuple):
    """DO_SET_MODE until a HEARTBEAT shows the mode; an acknowledgement is not sufficient."""

    request: CommandExchange
    custom_mode: int
    """-; as in HEARTBEAT"""
    confirmed: bool = False
    accepted_at: float | None = None
    timed_out: bool = False

    @property
    def failure(self) -> str:
        """Reason of the failure, one line."""
        if self.timed_out:
            return "the vehicle accepted the mode but did not change to it" + self._because()
        return self.request.failure

    def _because(self) -> str:
        return f": {self.request.reason}" if self.request.reason else ""

    @property
    def finished(self) -> bool:
        """Whether the heartbeat shows the mode, or the change failed."""
        return self.confirmed or bool(self.failure)

    def progress(self) -> Progress:
        """Two parts: acknowledgement and heartbeat."""
        return Progress(int(self.request.finished) + int(self.confirmed), 2, self.request.progress().note)

    def step(self, now: float, message: Any | None) -> tuple[ModeChange, Outgoing]:
        """See `Exchange.step`."""
        if (
            message is not None
            and message.get_type() == "HEARTBEAT"
            and is_autopilot(message)
            and self.request.timer.attempts
        ):
            return self._replace(confirmed=message.custom_mode == self.custom_mode), ()
        request, outgoing = self.request.step(now, message)
        accepted_at = self.accepted_at
        if request.accepted and accepted_at is None:
            accepted_at = now
        late = accepted_at is not None and now - accepted_at > ATTEMPTS * RETRY
        return self._replace(request=request, accepted_at=accepted_at, timed_out=late), outgoing


def change_mode(target: Target, custom_mode: int, main_and_sub: bool) -> ModeChange:
    """Build the exchange; ``main_and_sub`` for custom modes in PX4's layout (main << 16 | sub << 24)."""
    numbers = (custom_mode >> 16 & 0xFF, custom_mode >> 24 & 0xFF) if main_and_sub else (custom_mode, 0)
    flags = float(mavlink.MAV_MODE_FLAG_CUSTOM_MODE_ENABLED)
    command = CommandExchange(target, mavlink.MAV_CMD_DO_SET_MODE, (flags, float(numbers[0]), float(numbers[1])))
    return ModeChange(command, custom_mode)


class ModeNames(NamedTuple):
    """AVAILABLE_MODES request; a vehicle without them is not a failure."""

    request: CommandExchange
    names: Mapping[int, str] = {}
    """custom mode to name"""
    total: int | None = None
    received_at: float | None = None
    failure: str = ""
    given_up: bool = False

    @property
    def finished(self) -> bool:
        """Whether all names are known, or the vehicle has none."""
        return self.given_up or (self.total is not None and len(self.names) >= self.total)

    def progress(self) -> Progress:
        """Number of modes received."""
        return Progress(len(self.names), self.total or 0)

    def step(self, now: float, message: Any | None) -> tuple[ModeNames, Outgoing]:
        """See `Exchange.step`."""
        if message is not None and message.get_type() == "AVAILABLE_MODES":
            name = str(message.mode_name).partition("\0")[0].strip()
            names = {**self.names, message.custom_mode: name}
            return self._replace(names=names, total=message.number_modes, received_at=now), ()
        request, outgoing = self.request.step(now, message)
        quiet = self.received_at is not None and now - self.received_at > 2 * RETRY
        return self._replace(request=request, given_up=bool(request.failure) or quiet), outgoing


def request_mode_names(target: Target) -> ModeNames:
    """Build the exchange that requests the mode names of a vehicle."""
    wanted = (float(mavlink.MAVLINK_MSG_ID_AVAILABLE_MODES), 0.0)
    return ModeNames(CommandExchange(target, mavlink.MAV_CMD_REQUEST_MESSAGE, wanted))
