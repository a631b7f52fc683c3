"""Flight supervisor: failsafes, timeout of setpoints, stages."""

from __future__ import annotations

from avionics.guidance import failsafes, offboard, stages
from avionics.guidance.modes import Conditions, Gains, Outcome, State


def step(gains: Gains, state: State, dt: float, conditions: Conditions) -> Outcome:
    """Advance failsafes, setpoint timeout and stages by ``dt`` (s)."""
    state, failed = failsafes.step(gains, state, dt, conditions)
    state, expired = offboard.watch(state, conditions)
    state, moved = stages.step(gains, state, dt, conditions)
    return state, failed + expired + moved
