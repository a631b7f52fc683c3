"""A short flight with all that can enter one from outside, recorded: to be replayed."""

from __future__ import annotations

from pathlib import Path
from typing import Any

from avionics.autopilot import Autopilot
from avionics.messages import ChannelOverride, Command, CommandKind, PilotInput, SensorFrame
from avionics.missions import load_mission
from avionics.missions.script import scripted_start
from avionics.vehicles import load_vehicle
from logs.container import Container
from logs.copying import Part, copy
from logs.index import read_index
from logs.recorder import McapRecorder
from logs.recording_notes import note_inputs
from sim_bridge.flight.flight import fly
from sim_bridge.flight.world import Scenario, SimulatedWorld
from sim_bridge.vehicles import load_vehicle as load_world_vehicle

RAVEN = "robo_raven_ii_d"
LASTING = 18.0
"""s; the launch, and two snapshots"""


class Ground:
    """An autopilot to which the ground sends sticks, channels and a parameter on the way."""

    def __init__(self, autopilot: Autopilot) -> None:
        self._autopilot = autopilot
        self.frames: list[SensorFrame] = []

    def step(self, frame: SensorFrame, commands: Any) -> Any:
        self.frames.append(frame)
        tick, inputs = len(self.frames), list(commands)
        if tick % 40 == 0:
            inputs.append(PilotInput(0, 0.1, -0.2, 0.0, 0.0))
        if tick % 50 == 0:
            inputs.append(ChannelOverride(0, (65535,) * 18))
        if tick == 2000:
            inputs.append(Command(0, CommandKind.SET_PARAMETER, "PITCH_P", 0.31, source="test"))
        return self._autopilot.step(frame, inputs)


def later_part(path: Path, out: Path, first: int, last: int | None = None) -> Path:
    """A file with the chunks ``first`` to ``last`` of another and all documents, as a later one of a recording."""
    data = path.read_bytes()
    index = read_index(data)
    index.chunks = index.chunks[first:last]
    with out.open("xb", buffering=0) as file:
        container = Container(file)
        copy([Part(data, index)], container)
        container.finish()
    return out


def record_flight(path: Path) -> Path:
    """Fly, and record what the flight computer says."""
    vehicle, mission = load_vehicle(RAVEN), load_mission("circuit")
    with McapRecorder(path, start_epoch_ns=10**18) as recorder:
        note_inputs(recorder, vehicle, mission)
        world = SimulatedWorld(load_world_vehicle(RAVEN), Scenario(seed=3, duration=LASTING, wind_speed=1.0))
        ground = Ground(Autopilot(vehicle, mission, recorder.record))
        fly(world, ground, scripted_start())  # type: ignore[arg-type]
    return path
