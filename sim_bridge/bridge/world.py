"""What the bridge needs of a simulated world."""

from __future__ import annotations

from typing import Protocol

from avionics.messages import ActuatorCommand, SensorFrame
from sim_bridge.messages import TruthState

NEUTRAL = ActuatorCommand(0, 0.0, 0.0, 0.0, 0.0, 0.0, 0)
"""Command before the first one of the flight computer; also the first one of a flight in one process."""


class SimulationSilent(RuntimeError):
    """Exception: the world sends no more sensor frames, because of a fault."""


class World(Protocol):
    """Vehicle in its environment that advances one sensor tick at a time.

    Sensor values should be quantized as on the wire (`avionics.link.sensor_codec.quantized`), so that a flight in one
    process and a flight over the bridge are identical.
    """

    @property
    def tick_us(self) -> int:
        """us; between two sensor frames."""

    @property
    def origin(self) -> tuple[float, float, float]:
        """Latitude in rad, longitude in rad and altitude above mean sea level in m of the launch place."""

    @property
    def finished(self) -> bool:
        """Whether the simulation is finished; `step` is not called again."""

    def step(self, command: ActuatorCommand) -> SensorFrame:
        """Advance one tick with constant ``command``, and read the sensors at its end.

        Raises:
            SimulationSilent: it sends no more sensor frames.
        """

    def record(self) -> None:
        """Publish the truth at the end of the last step.

        It is separate from `step`, so that the sensor readings are available earlier. The next step calls it if the
        caller did not.
        """

    def truth(self) -> TruthState:
        """Return the vehicle's true state at the end of the last step."""
