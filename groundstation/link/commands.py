"""MAVLink command transactions until done, denied or timed out."""

from __future__ import annotations

from typing import Any, NamedTuple

from avionics.link.dialect import mavlink
from groundstation.link.exchange import (
    EXPLANATION,
    LONG_WAIT,
    NOT_YET,
    RETRY,
    Outgoing,
    Progress,
    Target,
    Timer,
    explained,
)
from groundstation.link.parameters import Parameter, decode_parameter

REJECTED: int = mavlink.MAV_RESULT_TEMPORARILY_REJECTED


class CommandExchange(NamedTuple):
    """COMMAND_LONG, or COMMAND_INT for a position, until its COMMAND_ACK (MAVLink command protocol)."""

    target: Target
    command: int
    """-; MAV_CMD"""
    parameters: tuple[float, ...] = ()
    """-; up to seven"""
    timer: Timer = Timer()
    in_progress: bool = False
    result: int | None = None
    """-; MAV_RESULT of the final acknowledgement"""
    reason: str = ""
    """-; last STATUSTEXT of the vehicle meanwhile, as the reason of a denial"""
    failure: str = ""
    percent: int = 0
    """-; progress reported by the vehicle"""
    frame: int | None = None
    """-; MAV_FRAME of a position, whose latitude and longitude (1e-7 deg) are the fifth and sixth parameter"""
    rejected_at: float | None = None
    """s; time of the first temporary rejection"""
    awaited: str = ""
    """-; reason of the temporary rejection"""

    @property
    def accepted(self) -> bool:
        """Whether the vehicle accepted the command."""
        return self.result is not None and self.result == int(mavlink.MAV_RESULT_ACCEPTED)

    @property
    def finished(self) -> bool:
        """Whether the command was accepted, denied or timed out."""
        return self.accepted or bool(self.failure)

    def progress(self) -> Progress:
        """One part, the acknowledgement, or the progress reported by the vehicle."""
        if self.in_progress:
            return Progress(self.percent, 100)
        if self.rejected_at is not None and not self.finished:
            return Progress(0, 1, f"{self.awaited}; retrying" if self.awaited else "")
        note = f"no response to {command_name(self.command)} yet, retrying" if self.timer.attempts > 1 else ""
        return Progress(int(self.finished), 1, "" if self.finished or self.result is not None else note)

    def step(self, now: float, message: Any | None) -> tuple[CommandExchange, Outgoing]:
        """See `Exchange.step`."""
        if message is not None:
            return self._on_message(now, message), ()
        if self.finished:
            return self, ()
        if self._not_yet(now):
            return (self, ()) if not self.timer.due(now) else self._again(now)
        if self.result is not None:
            return self._refused(now), ()
        if not self.timer.due(now, LONG_WAIT if self.in_progress else RETRY):
            return self, ()
        if self.timer.spent or self.in_progress:
            return self._replace(failure=f"no response to {command_name(self.command)}"), ()
        return self._again(now)

    def _again(self, now: float) -> tuple[CommandExchange, Outgoing]:
        awaited = self.awaited
        if self.result is not None and not awaited:
            awaited = refusal(self.command, self.result, self.reason.strip())
        asked = self._replace(timer=self.timer.again(now), result=None, awaited=awaited)
        return asked, (self._request(),)

    def _not_yet(self, now: float) -> bool:
        """Return whether the command is temporarily rejected and may be repeated."""
        return self.result == REJECTED and self.rejected_at is not None and now - self.rejected_at < NOT_YET

    def _on_message(self, now: float, message: Any) -> CommandExchange:
        kind = message.get_type()
        if kind == "STATUSTEXT" and self.timer.attempts:
            return self._replace(reason=explained(self.reason, message))
        if kind != "COMMAND_ACK" or message.command != self.command or not self.timer.attempts:
            return self
        if message.result == mavlink.MAV_RESULT_IN_PROGRESS:
            percent = message.progress if message.progress <= 100 else 0
            return self._replace(in_progress=True, timer=Timer(now, 1), percent=percent)
        since = now if message.result == REJECTED and self.rejected_at is None else self.rejected_at
        return self._replace(result=message.result, timer=Timer(now, 1), rejected_at=since)

    def _refused(self, now: float) -> CommandExchange:
        """Wait for the reason: the STATUSTEXT may follow the acknowledgement."""
        if not self.reason and not self.timer.due(now, EXPLANATION):
            return self
        return self._replace(failure=refusal(self.command, self.result or 0, self.reason.strip()))

    def _request(self) -> Any:
        values = (*self.parameters, *(0.0,) * (7 - len(self.parameters)))
        if self.frame is not None:
            *first, x, y, z = values
            return mavlink.MAVLink_command_int_message(
                self.target.system, self.target.component, self.frame, self.command, 0, 0, *first, int(x), int(y), z
            )
        return mavlink.MAVLink_command_long_message(
            self.target.system, self.target.component, self.command, self.timer.attempts, *values
        )


class CalibrationExchange(NamedTuple):
    """Calibration command, with the parameters that the vehicle announces afterwards."""

    request: CommandExchange
    changed: tuple[Parameter, ...] = ()
    """-; parameters announced since the request"""
    ended_at: float | None = None
    """s; time of the acknowledgement of the end"""
    settled: bool = False
    """-; whether the time for the parameters to arrive has passed"""

    @property
    def failure(self) -> str:
        """Reason of the failure, one line; empty without a failure."""
        return self.request.failure

    @property
    def finished(self) -> bool:
        """Whether the command was denied, or the calibration ended and the parameters arrived."""
        return bool(self.failure) or self.settled

    def progress(self) -> Progress:
        """Message of the vehicle."""
        return self.request.progress()

    def step(self, now: float, message: Any | None) -> tuple[CalibrationExchange, Outgoing]:
        """See `Exchange.step`."""
        request, outgoing = self.request.step(now, message)
        changed = self.changed
        if message is not None and message.get_type() == "PARAM_VALUE":
            changed = (*changed, decode_parameter(message, bytewise=False))
        ended_at = now if request.accepted and self.ended_at is None else self.ended_at
        settled = ended_at is not None and now - ended_at > EXPLANATION
        return CalibrationExchange(request, changed, ended_at, settled), outgoing


def command_name(command: int) -> str:
    """Return the name of a MAV_CMD without its prefix, or its number."""
    entry = mavlink.enums["MAV_CMD"].get(command)
    return str(entry.name).removeprefix("MAV_CMD_") if entry else f"command {command}"


def refusal(command: int, result: int, reason: str) -> str:
    """Return one line with the command, the result and the vehicle's reason, if any."""
    entry = mavlink.enums["MAV_RESULT"].get(result)
    name = str(entry.name).removeprefix("MAV_RESULT_").lower().replace("_", " ") if entry else f"result {result}"
    return f"{command_name(command)} denied: {reason or name}"
