"""Fault isolation: an exception outside the flight code disables a single service.

Link services, telemetry builders, links, the recorder and the views each run in a `Guard`, the only place that
catches their exceptions. The service is disabled and restarted after a back-off that doubles with each fault. After
`MAX_RESTARTS` restarts without `STABLE` seconds between two faults it stays disabled for the rest of the flight. A
vital service is restarted without limit, with a constant back-off.
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
"""s; time from the first fault to the restart"""
MAX_RESTARTS = 5
"""-; maximum restarts of a service before it stays disabled"""
STABLE = 60.0
"""s; time without a fault after which the restart count is reset"""
MAX_FRAMES = 20
"""-; number of innermost frames of a traceback that are logged"""

MAX_TRACEBACK = 16_384
"""characters; maximum length of a traceback, from its end"""
MAX_ERROR = 200
"""characters; maximum length of an exception in one line"""

P = ParamSpec("P")
T = TypeVar("T")


class FaultCode(Enum):
    """Consequence of a fault."""

    RESTART = "restart"
    DISABLED = "disabled"


class ServiceFault(NamedTuple):
    """Exception raised by a service."""

    code: FaultCode
    service: str
    """-; name of the service"""
    faults: int
    """-; faults of this service since the start"""
    error: str
    """-; type and text of the exception, one line"""
    retry: float
    """s; time until the restart, infinite if there is none"""
    traceback: str
    """-; empty if identical to that of the previous fault of the service"""

    def text(self) -> str:
        """Return a description in one line."""
        if self.code is FaultCode.DISABLED:
            return f"{self.service} disabled after {self.faults} faults: {self.error}"
        return f"{self.service} restarts in {self.retry:g} s: {self.error}"

    def record(self) -> str:
        """Return the log record: a line of JSON, followed by the traceback."""
        retry = self.retry if math.isfinite(self.retry) else None
        head = {"code": self.code.value, "service": self.service, "faults": self.faults, "retry_s": retry}
        return f"{json.dumps(head)}\n{self.traceback}"


def fault_events(fault: ServiceFault, time_us: int) -> list[Event]:
    """Return the events of a fault at ``time_us``.

    The first is an ERROR for the operator, the second a DEBUG with the traceback for the log only.
    """
    events = [Event(time_us, Severity.ERROR, fault.service, fault.text())]
    if fault.traceback:
        events.append(Event(time_us, Severity.DEBUG, fault.service, fault.record()))
    return events


class Guard:
    """Execution of the calls of one service; created by `Isolation.guard`."""

    def __init__(
        self, isolation: Isolation, service: str, restart: Callable[[], None] | None, backoff: float, vital: bool
    ) -> None:
        self.enabled = True
        """True if calls are executed"""
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
        """Return the result of a call; None after an exception or if disabled."""
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
    """Guards of one program, and the faults that they caught."""

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
        """Return a guard for a new service.

        Args:
            service: name in messages.
            restart: resets the service to its initial state; without it the service continues unchanged.
            backoff: s; time to the first restart, 0 for a restart at the next `advance`.
            vital: True if it is restarted without limit.
        """
        return Guard(self, service, restart, backoff, vital)

    def add(self, guard: Guard, fault: ServiceFault) -> None:
        """Store a fault until it is reported."""
        self._faults.append(fault)
        if fault.code is FaultCode.RESTART:
            self._disabled.append(guard)

    def advance(self, now: float) -> None:
        """Restart the services with an elapsed back-off.

        ``now`` (s) is the wall-clock time; it never decreases.
        """
        self.now = now
        if self._disabled:
            due = [guard for guard in self._disabled if now >= guard.due]
            self._disabled = [guard for guard in self._disabled if now < guard.due]
            for guard in due:
                guard.restart()

    def take_faults(self) -> list[ServiceFault]:
        """Return the faults since the last call."""
        faults, self._faults = self._faults, []
        return faults


def _plain(text: str) -> str:
    """Return the text with characters that can be encoded.

    An exception may quote invalid ones.
    """
    return text.encode("utf-8", errors="backslashreplace").decode()
