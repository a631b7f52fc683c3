"""Fault isolation: an exception outside the flight code disables one service, and the flight goes on.

Link services, telemetry builders, links, the recorder and the views run behind a `Guard` each, the one place that
catches what they raise. The service is disabled and restarted after a back-off that doubles with each fault. After
`MAX_RESTARTS` restarts without `STABLE` seconds between two faults it stays disabled for the rest of the flight,
unless it is vital: then the back-off stays as it is.
"""

from __future__ import annotations

import json
import math
import traceback
from collections.abc import Callable
from enum import Enum
from typing import NamedTuple, ParamSpec, TypeVar

from wingbeat.message import Event, Severity

BACKOFF = 1.0
"""s; from the first fault to the restart"""
MAX_RESTARTS = 5
"""-; restarts of a service until it stays disabled"""
STABLE = 60.0
"""s; without a fault, after which the restarts are counted from zero again"""
MAX_FRAMES = 20
"""-; innermost frames of a traceback that are logged"""

MAX_TRACEBACK = 16_384
"""characters; of the end of a traceback"""
MAX_ERROR = 200
"""characters; of an exception in one line"""

P = ParamSpec("P")
T = TypeVar("T")


class FaultCode(Enum):
    """What follows from a fault."""

    RESTART = "restart"
    DISABLED = "disabled"


class ServiceFault(NamedTuple):
    """An exception that a service raised."""

    code: FaultCode
    service: str
    """-; name of the service"""
    faults: int
    """-; of this service since the start"""
    error: str
    """-; type and text of the exception, one line"""
    retry: float
    """s; until the restart; infinite if there is none"""
    traceback: str
    """-; empty if it is that of the service's last fault"""

    def text(self) -> str:
        """One line for people."""
        if self.code is FaultCode.DISABLED:
            return f"{self.service} disabled after {self.faults} faults: {self.error}"
        return f"{self.service} restarts in {self.retry:g} s: {self.error}"

    def record(self) -> str:
        """For the log: a line of JSON, and the traceback below it."""
        retry = self.retry if math.isfinite(self.retry) else None
        head = {"code": self.code.value, "service": self.service, "faults": self.faults, "retry_s": retry}
        return f"{json.dumps(head)}\n{self.traceback}"


def fault_events(fault: ServiceFault, time_us: int) -> list[Event]:
    """Events of a fault at ``time_us``: an ERROR for people, and a DEBUG with the traceback for the log alone."""
    events = [Event(time_us, Severity.ERROR, fault.service, fault.text())]
    if fault.traceback:
        events.append(Event(time_us, Severity.DEBUG, fault.service, fault.record()))
    return events


class Guard:
    """Runs the calls of one service; made by `Isolation.guard`."""

    def __init__(
        self, isolation: Isolation, service: str, restart: Callable[[], None] | None, backoff: float, vital: bool
    ) -> None:
        self.enabled = True
        """whether calls are made"""
        self.service = service
        self.due = math.inf
        """s; time of the restart"""
        self._isolation = isolation
        self._restart = restart
        self._backoff = backoff
        self._vital = vital
        self._count = self._restarts = 0
        self._last_fault = -math.inf
        self._logged = ""

    def run(self, call: Callable[P, T], *args: P.args, **kwargs: P.kwargs) -> T | None:
        """The result of a call; None if it raises an exception, or the service is disabled."""
        if not self.enabled:
            return None
        try:
            return call(*args, **kwargs)
        except (KeyboardInterrupt, SystemExit, GeneratorExit):
            raise
        except BaseException as error:  # extension modules raise panics that are no Exception
            self._fail(error)
            return None

    def restart(self) -> None:
        """Enable the service again."""
        self.enabled, self.due = True, math.inf
        if self._restart is not None:
            self.run(self._restart)

    def _fail(self, error: BaseException) -> None:
        now = self._isolation.now
        if now - self._last_fault > STABLE:
            self._restarts = 0
        self._count, self._last_fault = self._count + 1, now
        retry, code = self._backoff * 2.0**self._restarts, FaultCode.RESTART
        if self._restarts >= MAX_RESTARTS and self._vital:
            retry = max(self._backoff * 2.0 ** (MAX_RESTARTS - 1), BACKOFF)
        elif self._restarts >= MAX_RESTARTS:
            retry, code = math.inf, FaultCode.DISABLED
        self._restarts = min(self._restarts + 1, MAX_RESTARTS)
        self.enabled, self.due = False, now + retry
        trace = _plain("".join(traceback.format_exception(error, limit=-MAX_FRAMES)))[-MAX_TRACEBACK:]
        unlogged, self._logged = "" if trace == self._logged else trace, trace
        summary = " ".join(_plain(f"{type(error).__name__}: {error}"[:MAX_ERROR]).split())
        self._isolation.add(self, ServiceFault(code, self.service, self._count, summary, retry, unlogged))


class Isolation:
    """The guards of one program, and the faults that they caught."""

    def __init__(self) -> None:
        self.now = 0.0
        """s; wall-clock time of the last `advance`"""
        self._disabled: list[Guard] = []
        self._faults: list[ServiceFault] = []

    def guard(
        self,
        service: str,
        restart: Callable[[], None] | None = None,
        backoff: float = BACKOFF,
        vital: bool = False,
    ) -> Guard:
        """A guard for a new service.

        Args:
            service: its name, for people.
            restart: brings it into its initial state; without it the service goes on as it is.
            backoff: s; to the first restart, 0 for one at the next `advance`.
            vital: whether it is restarted without end.
        """
        return Guard(self, service, restart, backoff, vital)

    def add(self, guard: Guard, fault: ServiceFault) -> None:
        """Keep a fault until it is reported."""
        self._faults.append(fault)
        if fault.code is FaultCode.RESTART:
            self._disabled.append(guard)

    def advance(self, now: float) -> None:
        """Restart the services whose back-off is over at wall-clock time ``now`` (s, never going back)."""
        self.now = now
        if self._disabled:
            due = [guard for guard in self._disabled if now >= guard.due]
            self._disabled = [guard for guard in self._disabled if now < guard.due]
            for guard in due:
                guard.restart()

    def take_faults(self) -> list[ServiceFault]:
        """The faults since the last call."""
        faults, self._faults = self._faults, []
        return faults


def _plain(text: str) -> str:
    """Text that can be encoded: an exception may quote what cannot."""
    return text.encode("utf-8", errors="backslashreplace").decode()
