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
"""s; armed time before a launch: time to select the mode and for the autopilot to start its detection"""
THRESHOLD_FRACTION = 0.6
"""-; detection threshold of an autopilot as a fraction of the launch acceleration"""
MIN_THRESHOLD = 1.2 * STANDARD_GRAVITY
"""m/s^2; newer versions of PX4 compare the magnitude of the specific force, which is 1 g before the launch"""
MAX_FRACTION = 0.9
"""-; a threshold above this fraction of the launch acceleration may not be reached"""


class Launch(Enum):
    """Trigger of the launch."""

    THROTTLE = "throttle"
    THROW = "throw"


class Gains(NamedTuple):
    """Conditions of the launch."""

    throttle: float
    """-; least throttle, that of level flight; 0 for any"""
    time: float = 0.5
    """s; least duration of this throttle: two strokes, longer than a transient of the output at start-up"""


class State(NamedTuple):
    """State of the launch logic."""

    ready: float = 0.0
    """s; for which the vehicle has been armed with sufficient throttle"""


class Push(NamedTuple):
    """Launch acceleration along the body's x axis."""

    acceleration: float
    """m/s^2"""
    duration: float
    """s"""

    @property
    def threshold(self) -> float:
        """m/s^2; threshold for an autopilot's launch detection."""
        return max(THRESHOLD_FRACTION * self.acceleration, MIN_THRESHOLD)

    @property
    def is_detectable(self) -> bool:
        """Whether the threshold is below the acceleration, with a margin."""
        return self.threshold <= MAX_FRACTION * self.acceleration


def gains_of(launch: Launch, trim_throttle: float) -> Gains:
    """Return the launch conditions of a vehicle that flies level at ``trim_throttle``."""
    return Gains(trim_throttle) if launch is Launch.THROTTLE else Gains(0.0, ARMED_TIME)


def step(gains: Gains, state: State, dt: float, outputs: Outputs) -> tuple[State, bool]:
    """Advance by ``dt`` s; return the state, and true if the launch is permitted."""
    if not (outputs.armed and outputs.throttle >= gains.throttle):
        return State(), False
    ready = state.ready + dt
    return State(ready), ready >= gains.time
