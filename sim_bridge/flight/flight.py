"""A whole flight in one process: world and autopilot joined tick by tick, as over the bridge."""

from __future__ import annotations

from collections import deque
from collections.abc import Sequence

from avionics.autopilot import Autopilot
from avionics.link.codec import quantised_command
from avionics.messages import Command
from sim_bridge.bridge.world import NEUTRAL
from sim_bridge.flight.world import SimulatedWorld


def fly(world: SimulatedWorld, autopilot: Autopilot, script: Sequence[Command] = ()) -> None:
    """Fly until the world is finished; each command of ``script`` enters at the first tick not before its time.

    The actuators reach the world as the wire would deliver them, so that the flight is bit for bit the one that two
    processes fly.
    """
    waiting = deque(sorted(script, key=lambda command: command.time_us))
    command = NEUTRAL
    while not world.finished:
        frame = world.step(command)
        due = []
        while waiting and waiting[0].time_us <= frame.time_us:
            due.append(waiting.popleft())
        command = quantised_command(autopilot.step(frame, due))
