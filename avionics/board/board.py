"""What the flight code needs of its hardware; a simulator, a serial board or a test injects one."""

from __future__ import annotations

from collections.abc import Callable
from typing import NamedTuple, Protocol

from avionics.messages import ActuatorCommand, SensorFrame
from wingbeat.message import Severity

IDLE_EVERY = 0.004
"""s; of wall-clock time between two calls of `Surroundings.idle` while something comes that is no sensor frame"""


class BoardSilent(RuntimeError):
    """The sensors stopped answering within the bounded wait; the text says who did not answer."""


class Board(Protocol):
    """Sensors in, actuators out, one frame a tick."""

    def read(self) -> SensorFrame | None:
        """Wait for the next sensor frame; None when the world said that it is over.

        Raises:
            BoardSilent: nothing came within the bounded wait.
        """

    def write(self, command: ActuatorCommand) -> None:
        """Send the actuators; in lockstep this releases the next frame."""

    def close(self) -> None:
        """Release the hardware."""


def discard_report(severity: Severity, text: str) -> None:
    """Nobody is told."""


def wait_idly() -> None:
    """Nothing else is to do."""


class Surroundings(NamedTuple):
    """What a board calls while it is read; both return at once."""

    report: Callable[[Severity, str], None] = discard_report
    """something to tell people: the device is gone, is back, loses messages"""
    idle: Callable[[], None] = wait_idly
    """called while no frame comes, so that ground links do not fall silent with it: some twenty times a second on a
    silent line, every `IDLE_EVERY` s on one that brings anything but frames"""
