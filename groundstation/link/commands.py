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
    """One COMMAND_LONG, or COMMAND_INT where it names a place, until its COMMAND_ACK (MAVLink command protocol)."""

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
    """-; last line the vehicle said meanwhile: why it refuses"""
    failure: str = ""
    percent: int = 0
    """-; how far the vehicle says that it is, while it is in progress"""
    frame: int | None = None
    """-; MAV_FRAME of a place, whose latitude and longitude (1e-7 deg) are the fifth and sixth parameter"""
    rejected_at: float | None = None
    """s; when the vehicle first said that it cannot yet"""
    awaited: str = ""
    """-; why it could not then"""

    @property
    def accepted(self) -> bool:
        """True once the vehicle said yes."""
        return self.result is not None and self.result == int(mavlink.MAV_RESULT_ACCEPTED)

    @property
    def finished(self) -> bool:
        """True once accepted, refused or given up."""
        return self.accepted or bool(self.failure)

    def progress(self) -> Progress:
        """One part, the acknowledgement; or what the vehicle says while it is in progress."""
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
        """Whether it is rejected for the moment, and the moment may pass."""
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
        """Give the vehicle a moment to say why: its STATUSTEXT may come after the acknowledgement."""
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
    """A command that calibrates, and the parameters that the vehicle then announces."""

    request: CommandExchange
    changed: tuple[Parameter, ...] = ()
    """-; announced since the request"""
    ended_at: float | None = None
    """s; when the vehicle acknowledged its end"""
    settled: bool = False
    """-; the parameters have had the time to come"""

    @property
    def failure(self) -> str:
        """Why it failed, one line; empty while it did not."""
        return self.request.failure

    @property
    def finished(self) -> bool:
        """True once refused, or once ended and settled."""
        return bool(self.failure) or self.settled

    def progress(self) -> Progress:
        """What the vehicle says."""
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
    """Name of a MAV_CMD without its prefix, or its number."""
    entry = mavlink.enums["MAV_CMD"].get(command)
    return str(entry.name).removeprefix("MAV_CMD_") if entry else f"command {command}"


def refusal(command: int, result: int, reason: str) -> str:
    """One line that says who refused what, and the vehicle's own words where it gave any."""
    entry = mavlink.enums["MAV_RESULT"].get(result)
    name = str(entry.name).removeprefix("MAV_RESULT_").lower().replace("_", " ") if entry else f"result {result}"
    return f"{command_name(command)} denied: {reason or name}"
