"""What a foreign autopilot's server needs of a simulated world."""

from __future__ import annotations

from collections.abc import Callable
from typing import NamedTuple, Protocol

from avionics.messages import ActuatorCommand, SensorFrame
from sim_bridge.messages import TruthState, TruthWing
from sim_bridge.observation import Observation
from wingbeat.topic import Publish


class ForeignWorld(Protocol):
    """Vehicle in the launcher, advanced by the steps that the autopilot requests."""

    @property
    def time_us(self) -> int:
        """us; at the end of the last step."""

    @property
    def origin(self) -> tuple[float, float, float]:
        """Latitude in rad, longitude in rad and altitude above mean sea level in m of the launch place."""

    @property
    def finished(self) -> bool:
        """Whether the simulation is finished; `advance` is not called again."""

    @property
    def launched(self) -> bool:
        """Whether the vehicle has been released, or is being released."""

    def release(self) -> None:
        """Permit the launch."""

    def advance(self, command: ActuatorCommand, duration: float) -> Observation:
        """Advance ``duration`` s with constant ``command``; return the input of the sensors at its end.

        Raises:
            SimulationSilent: it sends no more sensor frames.
        """

    def record(self) -> None:
        """Publish the truth at the end of the last step."""

    def sample(self, observation: Observation) -> SensorFrame:
        """Read the sensors, one sensor tick after the last time."""

    def truth(self) -> TruthState:
        """Return the vehicle's true state at the end of the last step."""

    def truth_wing(self) -> TruthWing:
        """Return wings and drives at the end of the last step."""


class Stage(NamedTuple):
    """One flight, from the launcher."""

    world: ForeignWorld
    publish: Publish
    """recorder of sensors, commands and events"""


NextStage = Callable[[], Stage]
"""creates a vehicle in the launcher and a recording for an autopilot that restarts"""

Tell = Callable[[str], None]
"""prints one line on the terminal"""


class Interface(NamedTuple):
    """Options of both kinds of server."""

    url: str
    """address of the port"""
    speed: float | None = None
    """-; speed factor; None for as fast as the autopilot responds"""


class AutopilotSilent(RuntimeError):
    """Error: the autopilot did not connect, or stopped responding; the text names it and the time of its last
    message.
    """
