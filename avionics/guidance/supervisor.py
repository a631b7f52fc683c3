"""One step of what watches over the flight: failsafes, then stages."""

from __future__ import annotations

from avionics.guidance import failsafes, stages
from avionics.guidance.modes import Conditions, Gains, Outcome, State


def step(gains: Gains, state: State, dt: float, seen: Conditions) -> Outcome:
    """One step of stages and failsafes; ``dt`` in s."""
    state, failed = failsafes.step(gains, state, dt, seen)
    state, moved = stages.step(gains, state, dt, seen)
    return state, failed + moved
