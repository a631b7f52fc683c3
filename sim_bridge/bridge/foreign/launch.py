"""When the launcher throws for an autopilot that has no message for it, and what its launch detection measures.

Launch on throttle: armed with the throttle of level flight. Launch by throw: armed for some seconds, whatever the
throttle; the acceleration of the throw is in the IMU, and the autopilot's own detection starts the motor.
"""

from __future__ import annotations

from enum import Enum
from typing import NamedTuple

from sim_bridge.bridge.foreign.outputs import Outputs
from wingbeat.constants import STANDARD_GRAVITY

ARMED_TIME = 5.0
"""s; armed for so long before a throw: time to select the mode, and for the autopilot to start its detection"""
THRESHOLD_FRACTION = 0.6
"""-; of the throw's acceleration: the threshold of an autopilot's detection"""
MIN_THRESHOLD = 1.2 * STANDARD_GRAVITY
"""m/s^2; newer versions of PX4 compare the magnitude of the specific force, which is 1 g in the hand"""
MAX_FRACTION = 0.9
"""-; a threshold above this fraction of the throw's acceleration is not reached for certain"""


class Launch(Enum):
    """What starts the throw."""

    THROTTLE = "throttle"
    THROW = "throw"


class Gains(NamedTuple):
    """When he throws."""

    throttle: float
    """-; so much holds the vehicle up; 0 for any"""
    time: float = 0.5
    """s; so long it must have been asked for: two strokes, longer than an output's twitch at start-up"""


class State(NamedTuple):
    """What he remembers."""

    ready: float = 0.0
    """s; for which the vehicle has been armed with the throttle up"""


class Push(NamedTuple):
    """Acceleration of the throw, along the body's x axis."""

    acceleration: float
    """m/s^2"""
    duration: float
    """s"""

    @property
    def threshold(self) -> float:
        """m/s^2; for an autopilot's launch detection."""
        return max(THRESHOLD_FRACTION * self.acceleration, MIN_THRESHOLD)

    @property
    def is_detectable(self) -> bool:
        """Whether the threshold is below the acceleration, with a margin."""
        return self.threshold <= MAX_FRACTION * self.acceleration


def gains_of(launch: Launch, trim_throttle: float) -> Gains:
    """Gains of a kind of launch, of a vehicle that flies level at ``trim_throttle``."""
    return Gains(trim_throttle) if launch is Launch.THROTTLE else Gains(0.0, ARMED_TIME)


def step(gains: Gains, state: State, dt: float, outputs: Outputs) -> tuple[State, bool]:
    """One step of ``dt`` s; true when he may throw."""
    if not (outputs.armed and outputs.throttle >= gains.throttle):
        return State(), False
    ready = state.ready + dt
    return State(ready), ready >= gains.time
