"""Interface of the flight code to its hardware.

Implementations are a simulator, a serial board or a test.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import NamedTuple, Protocol

from avionics.messages import ActuatorCommand, SensorFrame
from wingbeat.message import Severity

IDLE_EVERY = 0.004
"""s; minimum wall-clock interval of `Surroundings.idle` while data without a sensor frame arrives"""


class BoardSilent(RuntimeError):
    """Timeout of the sensors; the text names the source."""


class Board(Protocol):
    """Sensor input and actuator output, one frame per tick."""

    def read(self) -> SensorFrame | None:
        """Wait for the next sensor frame; None after the end of the simulation.

        Raises:
            BoardSilent: no frame within the bounded wait.
        """

    def write(self, command: ActuatorCommand) -> None:
        """Send the actuator command; in lockstep this releases the next frame."""

    def close(self) -> None:
        """Close the hardware."""


def discard_report(severity: Severity, text: str) -> None:
    """Discard the report."""


def wait_idly() -> None:
    """Return at once."""


class Surroundings(NamedTuple):
    """Callbacks of a board during a read; both must return at once."""

    report: Callable[[Severity, str], None] = discard_report
    """report to the operator: device disconnected, reconnected, messages lost"""
    idle: Callable[[], None] = wait_idly
    """called while no frame arrives, so that ground links are served: about twenty times a second on a silent line,
    every `IDLE_EVERY` s on one with other data"""
