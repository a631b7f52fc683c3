"""Commands of an unattended flight at fixed ticks, for a reproducible log."""

from __future__ import annotations

from avionics.guidance.mission import NO_FENCE, FlightPlan
from avionics.messages import Command, CommandKind, Mode

SCRIPT = "script"
"""-; source of these commands"""
START_US = 2_000_000
"""us; time since boot of arming and AUTO in a scripted flight, when the attitude is aligned"""


def scripted_start() -> tuple[Command, ...]:
    """Return the commands that arm and select AUTO at `START_US`."""
    return (
        Command(START_US, CommandKind.ARM, source=SCRIPT),
        Command(START_US, CommandKind.SET_MODE, name=Mode.AUTO.name, source=SCRIPT),
    )


def plan_commands(plan: FlightPlan) -> tuple[Command, ...]:
    """Return the commands that set fence and rally points of a plan at the first tick."""
    fence = Command(0, CommandKind.SET_FENCE, payload=plan.fence, source=SCRIPT)
    rally = Command(0, CommandKind.SET_RALLY, payload=plan.rally, source=SCRIPT)
    wanted = ((plan.fence != NO_FENCE, fence), (bool(plan.rally), rally))
    return tuple(command for there, command in wanted if there)
