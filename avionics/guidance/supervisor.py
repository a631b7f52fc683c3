"""One step of what watches over the flight: failsafes, the age of setpoints, then stages."""

from __future__ import annotations

from avionics.guidance import failsafes, offboard, stages
from avionics.guidance.modes import Conditions, Gains, Outcome, State


def step(gains: Gains, state: State, dt: float, conditions: Conditions) -> Outcome:
    """One step of stages and failsafes; ``dt`` in s."""
    state, failed = failsafes.step(gains, state, dt, conditions)
    state, expired = offboard.watch(state, conditions)
    state, moved = stages.step(gains, state, dt, conditions)
    return state, failed + expired + moved
