"""A whole flight in one process: world and autopilot joined tick by tick, as over the bridge."""

from __future__ import annotations

from collections import deque
from collections.abc import Sequence

from avionics.autopilot import Autopilot
from avionics.link.codec import quantized_command
from avionics.messages import Command
from sim_bridge.bridge.world import NEUTRAL, SimulationSilent
from sim_bridge.flight.faults import fault_commands
from sim_bridge.flight.world import SimulatedWorld


def fly(world: SimulatedWorld, autopilot: Autopilot, script: Sequence[Command] = ()) -> None:
    """Fly until the world is finished or silent; ``script`` commands are applied at the first tick not before them.

    Actuator commands are quantized as on the wire, so that the flight is bit-identical to one of two processes.
    """
    entering = [*script, *fault_commands(world.scenario.faults)]
    waiting = deque(sorted(entering, key=lambda command: command.time_us))
    command = NEUTRAL
    while not world.finished:
        try:
            frame = world.step(command)
        except SimulationSilent:
            return
        world.record()
        due = []
        while waiting and waiting[0].time_us <= frame.time_us:
            due.append(waiting.popleft())
        command = quantized_command(autopilot.step(frame, due))
