"""What the bridge needs of a simulated world."""

from __future__ import annotations

from typing import Protocol

from avionics.messages import ActuatorCommand, SensorFrame
from sim_bridge.messages import TruthState

NEUTRAL = ActuatorCommand(0, 0.0, 0.0, 0.0, 0.0, 0.0, 0)
"""The command before the flight computer has said anything; a flight in one process begins with it too."""


class SimulationSilent(RuntimeError):
    """The world sends no more sensor frames, as it was told."""


class World(Protocol):
    """A vehicle in its environment that advances one sensor tick at a time.

    The numbers that it hands out should be those of the wire (`avionics.link.sensor_codec.quantized`), so that a
    flight in one process and a flight over the bridge see the same.
    """

    @property
    def tick_us(self) -> int:
        """us; between two sensor frames."""

    @property
    def origin(self) -> tuple[float, float, float]:
        """Latitude in rad, longitude in rad and altitude above mean sea level in m of the launch place."""

    @property
    def finished(self) -> bool:
        """The simulation is over: `step` is not called again."""

    def step(self, command: ActuatorCommand) -> SensorFrame:
        """Advance one tick with ``command`` held, and read the sensors at its end.

        Raises:
            SimulationSilent: from now on it sends no more sensor frames.
        """

    def record(self) -> None:
        """Publish what is true at the end of the last step: nobody has to wait for that before the sensors are read.

        A step that comes without it does so first.
        """

    def truth(self) -> TruthState:
        """The vehicle's true state at the end of the last step."""
