"""What a foreign autopilot's server needs of a simulated world."""

from __future__ import annotations

from collections.abc import Callable
from typing import NamedTuple, Protocol

from avionics.messages import ActuatorCommand, SensorFrame
from sim_bridge.messages import TruthState, TruthWing
from sim_bridge.observation import Observation
from wingbeat.topic import Publish


class ForeignWorld(Protocol):
    """A vehicle in the launcher's hand, advanced by whatever steps the autopilot asks for."""

    @property
    def time_us(self) -> int:
        """us; at the end of the last step."""

    @property
    def origin(self) -> tuple[float, float, float]:
        """Latitude in rad, longitude in rad and altitude above mean sea level in m of the launch place."""

    @property
    def finished(self) -> bool:
        """The simulation is over: `advance` is not called again."""

    @property
    def launched(self) -> bool:
        """The vehicle has left the launcher's hand, or is leaving it."""

    def release(self) -> None:
        """Tell the launcher that he may throw."""

    def advance(self, command: ActuatorCommand, duration: float) -> Observation:
        """Advance ``duration`` s with ``command`` held; what is there to be sensed at its end.

        Raises:
            SimulationSilent: from now on it sends no more sensor frames.
        """

    def record(self) -> None:
        """Publish what is true at the end of the last step."""

    def sample(self, observation: Observation) -> SensorFrame:
        """Read the sensors, one tick of theirs after the last time."""

    def truth(self) -> TruthState:
        """The vehicle's true state at the end of the last step."""

    def truth_wing(self) -> TruthWing:
        """Wings and drives at the end of the last step."""


class Stage(NamedTuple):
    """One flight from the launcher's hand on."""

    world: ForeignWorld
    publish: Publish
    """where sensors, commands and events are recorded"""


NextStage = Callable[[], Stage]
"""a new vehicle in the hand, and a new recording, for an autopilot that starts over"""

Tell = Callable[[str], None]
"""says one line to the person at the terminal"""


class Interface(NamedTuple):
    """What both kinds of server are told."""

    url: str
    """where to listen"""
    speed: float | None = None
    """times real time; None for as fast as the autopilot answers"""


class AutopilotSilent(RuntimeError):
    """The autopilot did not come, or stopped answering; the text says who, and when it was last heard."""
