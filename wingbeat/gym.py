"""Gymnasium environment of a flapping-wing aircraft: hold altitude and heading in manual flight.

``gymnasium.make("wingbeat.gym:wingbeat/Flapping-v0", vehicle="arizona_100cm", turbulence="light")``. Environments are
independent processes in ``gymnasium.make_vec(..., vectorization_mode="async")``.

Each episode begins in the air: the flight computer launches the vehicle and flies for ``handover`` seconds, then the
agent flies it in MANUAL mode by the four stick inputs.

Observation (15 numbers, float32), from the true state:

==== ==================== ====== =====================================================
 0   altitude error       m      target minus altitude, positive: the vehicle is too low
 1   climb rate           m/s    positive up
 2   airspeed             m/s
 3   roll                 rad    right wing down is positive
 4   pitch                rad    nose up is positive
 5   heading error        rad    target minus heading, -pi to pi
6-8  p, q, r              rad/s  body rates
 9   sine of wing phase   -
10   cosine of wing phase -
11-14 previous action     -
==== ==================== ====== =====================================================

Action (4 numbers): pitch stick (-1 nose down to 1 nose up), roll stick, yaw stick (-1 left to 1 right), throttle
(-1 glide to 1 full flapping).

Reward per step: ``1 - (altitude error / 5 m)^2 - (heading error / 0.5 rad)^2``, at least -1; -10 on ground contact,
which ends the episode. The episode is truncated after ``time_limit`` seconds.
"""

from __future__ import annotations

import math
from typing import Any

import gymnasium
import numpy as np
from numpy.typing import NDArray

from avionics import topics
from avionics.messages import Command, CommandKind, PilotInput
from sim_bridge.messages import TruthState
from wingbeat.api.simulation import Simulation
from wingbeat.errors import InputError
from wingbeat.rotations import dcm_from_quaternion, euler_from_dcm

__all__ = ["FlappingEnv"]

TICKS = 4
"""-; simulation ticks (5 ms) per step: 50 Hz"""
LONGEST_START = 60.0
"""s; longest time until the vehicle is in the air"""
LIMITS = np.array([1e3, 1e2, 1e2, 3.2, 1.6, 3.2, 1e2, 1e2, 1e2, 1, 1, 1, 1, 1, 1], np.float32)
"""as the observation; values are clipped to them"""
Observation = NDArray[np.float32]


class FlappingEnv(gymnasium.Env[Observation, Observation]):
    """Hold altitude and heading; see the module for observation, action and reward."""

    metadata: dict[str, Any] = {"render_modes": [], "render_fps": 50}

    def __init__(
        self,
        vehicle: str = "robo_raven_ii_d",
        *,
        wind: float = 0.0,
        turbulence: str = "none",
        time_limit: float = 20.0,
        handover: float = 4.0,
        **simulation: Any,
    ) -> None:
        """Create the environment.

        Args:
            vehicle: name or folder.
            wind: m/s, steady; the launch is against it.
            turbulence: Dryden gusts, as `wingbeat.fly`.
            time_limit: s; length of an episode.
            handover: s; from the launch to the start of the episode.
            simulation: further arguments of `wingbeat.Simulation` (``vibration`` is 0 unless given: observations are
                the true state).
        """
        self._settings = {"vehicle": vehicle, "wind": wind, "turbulence": turbulence, "vibration": 0.0, **simulation}
        self._time_limit, self._handover = time_limit, handover
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
        sim = Simulation(seed=int(self.np_random.integers(1, 2**31)), **self._settings)
        while not sim.world.launched and sim.time < LONGEST_START:
            sim.step()
        if not sim.world.launched:
            raise InputError(f"the vehicle was not launched within {LONGEST_START:g} s")
        sim.run(until=sim.time + self._handover)
        sim.request(Command(sim.world.time_us, CommandKind.SET_MODE, "MANUAL", source="gym"))
        self.simulation, self._begin = sim, sim.time
        self._action = np.array([0.0, 0.0, 0.0, 0.0], np.float32)
        state = sim.state
        self._altitude, self._heading = -state.down, _angles(state)[2]
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
        truncated = sim.time - self._begin >= self._time_limit
        return seen, -10.0 if crashed else reward, crashed, truncated, self._info(sim)

    def _observe(self, sim: Simulation) -> Observation:
        state = sim.state
        roll, pitch, heading = _angles(state)
        error = math.remainder(self._heading - heading, 2.0 * math.pi)
        phase = sim.last(topics.WING).phase
        values = (
            self._altitude + state.down, -state.v_down, state.airspeed, roll, pitch, error,
            state.roll_rate, state.pitch_rate, state.yaw_rate, math.sin(phase), math.cos(phase), *self._action,
        )  # fmt: skip
        return np.clip(np.array(values, np.float32), -LIMITS, LIMITS)

    def _info(self, sim: Simulation) -> dict[str, Any]:
        return {"time": sim.time, "altitude_target": self._altitude, "heading_target": self._heading}


def _angles(state: TruthState) -> tuple[float, float, float]:
    quaternion = state.quaternion_w, state.quaternion_x, state.quaternion_y, state.quaternion_z
    return euler_from_dcm(dcm_from_quaternion(quaternion))


gymnasium.register("wingbeat/Flapping-v0", entry_point="wingbeat.gym:FlappingEnv")
