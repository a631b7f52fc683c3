"""Environment of one vehicle, flown with the flight computer in the loop."""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import Any

import gymnasium
import numpy as np
from numpy.typing import NDArray

from avionics.messages import Command, CommandKind, PilotInput
from sim_bridge.batch import TICKS
from sim_bridge.messages import TruthState
from wingbeat.api.simulation import Simulation
from wingbeat.errors import InputError
from wingbeat.quaternions import dcm_from_quaternion
from wingbeat.rotations import euler_from_dcm

__all__ = ["FlappingEnv"]

LONGEST_START = 60.0
"""s; longest time until the vehicle is in the air"""
ROUND_OFF = 1e-9
"""s; in differences of times"""
CRASH_REWARD = -10.0
"""-; of the step with ground contact"""
LIMITS = np.array([1e3, 1e2, 1e2, 3.2, 1.6, 3.2, 1e2, 1e2, 1e2, 1, 1, 1, 1, 1, 1], np.float32)
"""as the observation; values are clipped to them"""
Observation = NDArray[np.float32]


def launch_seed(generator: np.random.Generator, launches: int | None) -> int:
    """Draw the seed of the next launch, of all or of the first ``launches`` seeds."""
    return int(generator.integers(1, 2**31 if launches is None else launches + 1))


def launch(seed: int, handover: float, settings: Mapping[str, Any]) -> Simulation:
    """Fly from the launcher to ``handover`` s after the launch; ``settings`` are arguments of `Simulation`.

    Raises:
        InputError: the vehicle was not launched, or an argument is not valid.
    """
    sim = Simulation(seed=seed, **settings)
    while not sim.world.launched and sim.time < LONGEST_START:
        sim.step()
    if not sim.world.launched:
        raise InputError(f"the vehicle was not launched within {LONGEST_START:g} s")
    sim.run(until=sim.time + handover)
    return sim


def stroke_phase(sim: Simulation) -> float:
    """Return the phase (rad) of the crank, or of the commanded stroke if each wing has a servo."""
    plant = sim.world.plant
    if sim.world.vehicle.drive.kind == "servo":
        return sim.autopilot.memory.flapping.phase
    return float(plant.y[plant.layout.crank_phase])


def angles(state: TruthState) -> tuple[float, float, float]:
    """Return roll, pitch and heading (rad)."""
    quaternion = state.quaternion_w, state.quaternion_x, state.quaternion_y, state.quaternion_z
    return euler_from_dcm(dcm_from_quaternion(quaternion))


def observe(sim: Simulation, altitude: float, heading: float, action: Observation) -> Observation:
    """Return the observation for the targets ``altitude`` (m) and ``heading`` (rad) after ``action``."""
    state, phase = sim.state, stroke_phase(sim)
    roll, pitch, yaw = angles(state)
    error = math.remainder(heading - yaw, 2.0 * math.pi)
    values = (
        altitude + state.down, -state.v_down, state.airspeed, roll, pitch, error,
        state.roll_rate, state.pitch_rate, state.yaw_rate, math.sin(phase), math.cos(phase), *action,
    )  # fmt: skip
    return np.clip(np.array(values, np.float32), -LIMITS, LIMITS)


class FlappingEnv(gymnasium.Env[Observation, Observation]):
    """Hold altitude and heading; see `wingbeat.gym` for observation, action and reward."""

    metadata: dict[str, Any] = {"render_modes": [], "render_fps": 50}

    def __init__(
        self,
        vehicle: str = "robo_raven_ii_d",
        *,
        wind: float = 0.0,
        turbulence: str = "none",
        time_limit: float = 20.0,
        handover: float = 4.0,
        launches: int | None = None,
        **simulation: Any,
    ) -> None:
        """Create the environment.

        Args:
            vehicle: name or folder.
            wind: m/s, steady; the launch is against it.
            turbulence: Dryden gusts, as `wingbeat.fly`.
            time_limit: s; length of an episode.
            handover: s; from the launch to the start of the episode.
            launches: number of different launches, one of which begins each episode (default: each is a new one). A
                launch costs as much as 12 s of flight; `FlappingVectorEnv` flies each of them once.
            simulation: further arguments of `wingbeat.Simulation` (``vibration`` is 0 unless given: observations are
                the true state).
        """
        self._settings = {"vehicle": vehicle, "wind": wind, "turbulence": turbulence, "vibration": 0.0, **simulation}
        self._time_limit, self._handover, self._launches = time_limit, handover, launches
        self.observation_space = gymnasium.spaces.Box(-LIMITS, LIMITS, dtype=np.float32)
        self.action_space = gymnasium.spaces.Box(-1.0, 1.0, (4,), np.float32)
        self.simulation: Simulation | None = None
        self._action = np.zeros(4, np.float32)
        self._altitude, self._heading, self._begin = 0.0, 0.0, 0.0

    def reset(
        self, *, seed: int | None = None, options: dict[str, Any] | None = None
    ) -> tuple[Observation, dict[str, Any]]:
        """Launch with new sensor noise and gusts; the same seed gives the same episode.

        Raises:
            InputError: the vehicle was not launched, or an argument is not valid.
        """
        super().reset(seed=seed, options=options)
        sim = launch(launch_seed(self.np_random, self._launches), self._handover, self._settings)
        sim.request(Command(sim.world.time_us, CommandKind.SET_MODE, "MANUAL", source="gym"))
        self.simulation, self._begin = sim, sim.time
        self._action = np.array([0.0, 0.0, 0.0, 0.0], np.float32)
        state = sim.state
        self._altitude, self._heading = -state.down, angles(state)[2]
        return self._observe(sim), self._info(sim)

    def step(self, action: Observation) -> tuple[Observation, float, bool, bool, dict[str, Any]]:
        """Fly 20 ms with the stick inputs ``action``."""
        sim = self.simulation
        if sim is None:
            raise InputError("reset the environment before its first step")
        self._action = np.clip(np.asarray(action, np.float32), -1.0, 1.0)
        pitch, roll, yaw, throttle = map(float, self._action)
        for _ in range(TICKS):
            sim.request(PilotInput(sim.world.time_us, pitch, roll, yaw, 0.5 * (throttle + 1.0)))
            sim.step()
        seen = self._observe(sim)
        crashed = bool(sim.state.on_ground)
        reward = max(1.0 - (float(seen[0]) / 5.0) ** 2 - (float(seen[5]) / 0.5) ** 2, -1.0)
        truncated = sim.time - self._begin >= self._time_limit - ROUND_OFF
        return seen, CRASH_REWARD if crashed else reward, crashed, truncated, self._info(sim)

    def _observe(self, sim: Simulation) -> Observation:
        return observe(sim, self._altitude, self._heading, self._action)

    def _info(self, sim: Simulation) -> dict[str, Any]:
        return {"time": sim.time, "altitude_target": self._altitude, "heading_target": self._heading}
