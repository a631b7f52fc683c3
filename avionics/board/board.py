"""What the flight code needs of its hardware; a simulator, a serial board or a test injects one."""

from __future__ import annotations

from typing import Protocol

from avionics.messages import ActuatorCommand, SensorFrame


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
