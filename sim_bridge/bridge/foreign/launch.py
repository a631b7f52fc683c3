"""When the launcher throws for an autopilot that cannot tell him: armed, with the throttle of level flight."""

from __future__ import annotations

from typing import NamedTuple

from sim_bridge.bridge.foreign.outputs import Outputs


class Gains(NamedTuple):
    """When he throws."""

    throttle: float
    """-; so much holds the vehicle up"""
    time: float = 0.5
    """s; so long it must have been asked for: two strokes, longer than an output's twitch at start-up"""


class State(NamedTuple):
    """What he remembers."""

    ready: float = 0.0
    """s; for which the vehicle has been armed with the throttle up"""


def step(gains: Gains, state: State, dt: float, outputs: Outputs) -> tuple[State, bool]:
    """One step of ``dt`` s; true when he may throw."""
    if not (outputs.armed and outputs.throttle >= gains.throttle):
        return State(), False
    ready = state.ready + dt
    return State(ready), ready >= gains.time
