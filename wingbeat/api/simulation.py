"""Step-by-step simulation with the flight computer, or the caller's own controller, in the loop."""

from __future__ import annotations

import math
from collections import deque
from collections.abc import Callable
from pathlib import Path
from typing import Any, TypeVar

import numpy as np

from avionics.autopilot import Autopilot
from avionics.link.codec import quantized_command
from avionics.messages import ActuatorCommand, Input, SensorFrame
from logs.columns import Columns
from sim_bridge.bridge.world import NEUTRAL
from sim_bridge.flight.faults import fault_commands
from sim_bridge.flight.world import SimulatedWorld
from sim_bridge.messages import TruthState, TruthWing
from wingbeat.api.flights import DEFAULT_MISSION, DEFAULT_VEHICLE, compile_physics, prepared_flight
from wingbeat.docstrings import field_texts, split_unit
from wingbeat.errors import InputError
from wingbeat.topic import Topic

__all__ = ["Simulation"]

Controller = Callable[["Simulation"], ActuatorCommand | None]
Message = TypeVar("Message")


class Simulation:
    """A vehicle in the simulated world, advanced one sensor tick (5 ms) at a time.

    Each `step` advances the world with one actuator command, reads the sensors and runs the flight computer. The
    command is that of the flight computer unless the caller gives another one.

    Example::

        sim = wingbeat.Simulation("robo_raven_ii_d", duration=60.0)
        while not sim.finished:
            command = sim.command                       # of the flight computer
            if sim.time > 30.0:
                command = command._replace(elevator=command.elevator + 0.02)
            sim.step(command)
        pitch_rate = sim["/truth/state"]["pitch_rate"]
    """

    def __init__(
        self, vehicle: str | Path = DEFAULT_VEHICLE, mission: str | Path = DEFAULT_MISSION, **conditions: Any
    ) -> None:
        """Place the vehicle in the launcher; arguments as `wingbeat.fly`, without ``log``.

        Raises:
            InputError: an argument that is not valid.
        """
        flight = prepared_flight(vehicle, mission, **conditions)
        compile_physics(flight.vehicle)
        self._messages: dict[str, tuple[Topic[Any], list[Any]]] = {}
        self.world = SimulatedWorld(flight.vehicle, flight.scenario, self._keep)
        self.autopilot = Autopilot(flight.computer, flight.plan.mission, self._keep)
        script = [*flight.commands, *fault_commands(flight.scenario.faults)]
        self._script = deque(sorted(script, key=lambda command: command.time_us))
        self._requests: list[Input] = []
        self.command: ActuatorCommand = NEUTRAL
        """actuator command of the flight computer for the next step"""
        self.frame: SensorFrame | None = None
        """last sensor readings"""

    def _keep(self, topic: Topic[Any], message: Any) -> None:
        self._messages.setdefault(topic.name, (topic, []))[1].append(message)

    @property
    def time(self) -> float:
        """s; since boot."""
        return self.world.time_us * 1e-6

    @property
    def finished(self) -> bool:
        """Whether the vehicle is at rest on the ground, or the duration is reached."""
        return self.world.finished

    @property
    def state(self) -> TruthState:
        """True position, velocity, attitude, rates of the vehicle and wind."""
        return self.world.truth()

    @property
    def wing(self) -> TruthWing:
        """True wing angles and rates, drive torques, current, power."""
        return self.world.truth_wing()

    @property
    def gust(self) -> tuple[float, float, float]:
        """Additional wind (north, east, down) in m/s that the caller sets, besides wind and turbulence."""
        return self.world.extra_wind

    @gust.setter
    def gust(self, velocity: tuple[float, float, float]) -> None:
        north, east, down = (float(value) for value in velocity)
        if not all(map(math.isfinite, (north, east, down))):
            raise InputError(f"a gust must be finite, not {velocity}")
        self.world.extra_wind = (north, east, down)

    def request(self, command: Input) -> None:
        """Send a command or stick inputs to the flight computer; it receives them in the next step."""
        self._requests.append(command)

    def last(self, topic: Topic[Message]) -> Message:
        """Return the last message of a topic.

        Raises:
            KeyError: the topic has no message so far.
        """
        message: Message = self._messages[topic.name][1][-1]
        return message

    def step(self, command: ActuatorCommand | None = None) -> SensorFrame:
        """Advance one tick with ``command`` (default: that of the flight computer) and return the sensor readings.

        Raises:
            SimulationSilent: the fault ``sim_silent`` is active.
            SimulationDiverged: the state is no longer finite.
        """
        self.frame = self.world.step(quantized_command(self.command if command is None else command))
        self.world.record()
        due: list[Input] = [*self._requests]
        self._requests.clear()
        while self._script and self._script[0].time_us <= self.frame.time_us:
            due.append(self._script.popleft())
        self.command = self.autopilot.step(self.frame, due)
        return self.frame

    def run(self, until: float = math.inf, controller: Controller | None = None) -> None:
        """Step until the time ``until`` (s) or the end; ``controller`` gives the command of each step.

        A controller is called with the simulation before each step. It returns an `ActuatorCommand`, or None for that
        of the flight computer.
        """
        while not self.finished and self.time < until:
            self.step(None if controller is None else controller(self))

    @property
    def topics(self) -> tuple[str, ...]:
        """Names of the topics with messages so far."""
        return tuple(self._messages)

    def __getitem__(self, topic: str) -> Columns:
        """Return the messages of a topic so far as columns.

        Raises:
            KeyError: the topic has no message so far.
        """
        declared, messages = self._messages[topic]
        fields = declared.message._fields
        table = {name: np.array([getattr(one, name) for one in messages]) for name in fields}
        time_ns = np.array([one.time_us * 1000 for one in messages], dtype=np.int64)
        return Columns(topic, table, _units(declared.message), time_ns, 0)

    def __repr__(self) -> str:
        here = self.state
        return (
            f"Simulation of {self.world.vehicle.name} at {self.time:.2f} s: north {here.north:.1f} m, east"
            f" {here.east:.1f} m, height {-here.down:.1f} m, airspeed {here.airspeed:.2f} m/s"
        )


def _units(message: type[Any]) -> dict[str, str]:
    texts = field_texts(message.__module__)[message.__name__]
    return {name: split_unit(texts.get(name, "-"))[0] for name in message._fields}
