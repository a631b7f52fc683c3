"""Commands of a flight that nobody commands, at fixed ticks: the log does not depend on when a person acts."""

from __future__ import annotations

from avionics.guidance.mission import NO_FENCE, FlightPlan
from avionics.messages import Command, CommandKind, Mode

SCRIPT = "script"
"""-; source of these commands"""
START_US = 2_000_000
"""us; since boot, when a scripted flight is armed and switched to AUTO: the attitude is known by then"""


def scripted_start() -> tuple[Command, ...]:
    """Armed and switched to AUTO at `START_US`."""
    return (
        Command(START_US, CommandKind.ARM, source=SCRIPT),
        Command(START_US, CommandKind.SET_MODE, name=Mode.AUTO.name, source=SCRIPT),
    )


def plan_commands(plan: FlightPlan) -> tuple[Command, ...]:
    """What puts a plan's fence and rally points on board at the first tick, as logged inputs."""
    fence = Command(0, CommandKind.SET_FENCE, payload=plan.fence, source=SCRIPT)
    rally = Command(0, CommandKind.SET_RALLY, payload=plan.rally, source=SCRIPT)
    wanted = ((plan.fence != NO_FENCE, fence), (bool(plan.rally), rally))
    return tuple(command for there, command in wanted if there)
