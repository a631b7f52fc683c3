"""Environment of many vehicles, advanced together by compiled code."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, NamedTuple

import gymnasium
import numpy as np
from gymnasium.utils import seeding
from gymnasium.vector import AutoresetMode, VectorEnv
from gymnasium.vector.utils import batch_space
from numpy.typing import NDArray

from avionics.gains import FlightGains
from avionics.link.codec import FULL_DEFLECTION, quantized_command
from avionics.state import AutopilotState
from sim_bridge.aerodynamics.models import is_compiled_separately
from sim_bridge.batch import DIVERGED, ON_GROUND, Conditions, ManualGains, Start, VehicleBatch
from sim_bridge.environment import dryden
from sim_bridge.environment.wind import steady_wind
from sim_bridge.plant import Plant
from sim_bridge.sensors.suite import SimulationDiverged
from sim_bridge.vibration.flight import make_unequal
from wingbeat.api.simulation import Simulation
from wingbeat.errors import InputError
from wingbeat.gym.environment import CRASH_REWARD, LIMITS, ROUND_OFF, angles, launch, launch_seed, observe

__all__ = ["FlappingVectorEnv"]

Floats32 = NDArray[np.float32]
Flags = NDArray[np.bool_]
Infos = dict[str, Any]
ASYNC = 'vectorization_mode="async"'
NEUTRAL = np.zeros(4, np.float32)


class Episode(NamedTuple):
    """Start of an episode."""

    start: Start
    observation: Floats32
    altitude: float
    """m; target"""
    heading: float
    """rad; target"""


class FlappingVectorEnv(VectorEnv[Floats32, Floats32, Any]):
    """Hold altitude and heading with many vehicles; observation, action and reward are those of `FlappingEnv`.

    Physics, gusts and manual flight of all vehicles run in one compiled loop on all cores. For the same seed each
    vehicle has the numbers of a `FlappingEnv`. The launch is flown with the flight computer. In the episode its
    failsafes do not act. Faults and the vortex lattice are not available: use ``vectorization_mode="async"``.

    With `AutoresetMode.NEXT_STEP` a vehicle whose episode ended is launched in the following step.
    """

    def __init__(
        self,
        num_envs: int = 1,
        vehicle: str = "robo_raven_ii_d",
        *,
        wind: float = 0.0,
        turbulence: str = "none",
        time_limit: float = 20.0,
        handover: float = 4.0,
        launches: int | None = None,
        autoreset_mode: AutoresetMode = AutoresetMode.NEXT_STEP,
        threads: int = 0,
        **simulation: Any,
    ) -> None:
        """Create the environments.

        Args:
            num_envs: number of vehicles.
            vehicle: name or folder.
            wind: m/s, steady; the launch is against it.
            turbulence: Dryden gusts, as `wingbeat.fly`.
            time_limit: s; length of an episode.
            handover: s; from the launch to the start of the episode.
            launches: number of different launches, one of which begins each episode (default: each is a new one). A
                launch takes 0.6 s of computation; with this number each is flown once.
            autoreset_mode: of `gymnasium.vector.AutoresetMode`.
            threads: number of threads; 0: as many as cores.
            simulation: further arguments of `wingbeat.Simulation` (``vibration`` is 0 unless given).

        Raises:
            InputError: an argument that is not valid, or faults.
        """
        super().__init__()
        if num_envs < 1:
            raise InputError(f"num_envs must be 1 or more, not {num_envs}")
        if simulation.get("faults"):
            raise InputError(f"faults are not available in the batch; use {ASYNC}")
        self.metadata = {"render_modes": [], "render_fps": 50, "autoreset_mode": AutoresetMode(autoreset_mode)}
        self._mode = self.metadata["autoreset_mode"]
        self.num_envs = num_envs
        self.single_observation_space = gymnasium.spaces.Box(-LIMITS, LIMITS, dtype=np.float32)
        self.single_action_space = gymnasium.spaces.Box(-1.0, 1.0, (4,), np.float32)
        self.observation_space = batch_space(self.single_observation_space, num_envs)
        self.action_space = batch_space(self.single_action_space, num_envs)
        self._settings = {"vehicle": vehicle, "wind": wind, "turbulence": turbulence, "vibration": 0.0, **simulation}
        self._time_limit, self._handover, self._launches, self._threads = time_limit, handover, launches, threads
        self._generators: list[np.random.Generator | None] = [None] * num_envs
        self._episodes: dict[int, Episode] = {}
        self._batch: VehicleBatch | None = None
        self._targets, self._begin = np.zeros((num_envs, 2)), np.zeros(num_envs)
        self._observations = np.zeros((num_envs, LIMITS.size), np.float32)
        self._ended = np.zeros(num_envs, np.bool_)

    def reset(
        self, *, seed: int | Sequence[int | None] | None = None, options: dict[str, Any] | None = None
    ) -> tuple[Floats32, Infos]:
        """Launch the vehicles, or those of ``options["reset_mask"]``.

        A number as ``seed`` gives the vehicles this one and the following ones.

        Raises:
            InputError: a vehicle was not launched, or an argument is not valid or not available in the batch.
        """
        mask = np.asarray((options or {}).get("reset_mask", np.ones(self.num_envs, np.bool_)), np.bool_)
        seeds = [seed + i for i in range(self.num_envs)] if isinstance(seed, int) else seed
        if mask.shape != (self.num_envs,) or (seeds is not None and len(seeds) != self.num_envs):
            raise InputError(f"seeds and reset_mask must have {self.num_envs} values")
        for i in np.flatnonzero(mask).tolist():
            if seeds is not None and seeds[i] is not None:
                self._generators[i] = seeding.np_random(seeds[i])[0]
            self._launch(i)
        return self._observations.copy(), self._infos(mask)

    def step(self, actions: Floats32) -> tuple[Floats32, NDArray[np.float64], Flags, Flags, Infos]:
        """Fly 20 ms with the stick inputs ``actions`` (n, 4); vehicles that are launched ignore theirs."""
        batch = self._batch
        if batch is None:
            raise InputError("reset the environment before its first step")
        restarted = self._ended.copy() if self._mode == AutoresetMode.NEXT_STEP else np.zeros_like(self._ended)
        if self._mode == AutoresetMode.DISABLED and self._ended.any():
            raise InputError(f"reset the vehicles whose episode ended: {np.flatnonzero(self._ended).tolist()}")
        batch.arrays.active[:] = ~restarted
        actions = np.clip(np.asarray(actions, np.float32).reshape(self.num_envs, 4), -1.0, 1.0)
        sticks = actions.astype(np.float64)
        sticks[:, 3] = 0.5 * (sticks[:, 3] + 1.0)
        batch.step(sticks)
        stepped = ~restarted
        self._observations[stepped] = self._observe(actions)[stepped]
        crashed = (batch.arrays.outcome == ON_GROUND) & stepped
        self._raise_diverged(stepped)
        rewards = np.where(crashed, CRASH_REWARD, np.where(stepped, self._rewards(), 0.0))
        truncated = (batch.time_us * 1e-6 - self._begin >= self._time_limit - ROUND_OFF) & stepped
        self._ended = crashed | truncated
        for i in np.flatnonzero(restarted):
            self._launch(int(i))
        infos = self._infos(np.ones(self.num_envs, np.bool_))
        if self._mode == AutoresetMode.SAME_STEP and self._ended.any():
            infos = self._restart_ended(infos)
        return self._observations.copy(), rewards, crashed, truncated, infos

    def close_extras(self, **kwargs: Any) -> None:
        """End the threads."""
        if self._batch is not None:
            self._batch.close()

    def _restart_ended(self, final: Infos) -> Infos:
        """Launch the vehicles whose episode ended, and return their last observations with the new information."""
        ended = self._ended.copy()
        last = np.full(self.num_envs, None, object)
        for i in np.flatnonzero(ended):
            last[i] = self._observations[i].copy()
            self._launch(int(i))
        infos = self._infos(np.ones(self.num_envs, np.bool_))
        final = {
            name: values if name.startswith("_") else np.where(ended, values, 0.0) for name, values in final.items()
        }
        final |= {name: ended.copy() for name in final if name.startswith("_")}
        return infos | {"final_obs": last, "_final_obs": ended, "final_info": final, "_final_info": ended.copy()}

    def _launch(self, i: int) -> None:
        generator = self._generators[i]
        if generator is None:
            generator = self._generators[i] = seeding.np_random(None)[0]
        episode = self._episode(launch_seed(generator, self._launches))
        assert self._batch is not None
        self._batch.place(i, episode.start)
        self._targets[i] = episode.altitude, episode.heading
        self._begin[i] = episode.start.time_us * 1e-6
        self._observations[i], self._ended[i] = episode.observation, False

    def _episode(self, seed: int) -> Episode:
        if seed in self._episodes:
            return self._episodes[seed]
        sim = launch(seed, self._handover, self._settings)
        if self._batch is None:
            self._batch = _batch(self.num_envs, sim, self._threads)
        altitude, heading = -sim.state.down, angles(sim.state)[2]
        episode = Episode(_start(sim), observe(sim, altitude, heading, NEUTRAL), altitude, heading)
        if self._launches is not None:
            self._episodes[seed] = episode
        return episode

    def _observe(self, actions: Floats32) -> Floats32:
        assert self._batch is not None
        altitude, climb, airspeed, roll, pitch, heading, p, q, r, phase = self._batch.arrays.observed.T
        above = self._targets[:, 0] - altitude
        error = self._targets[:, 1] - heading
        error -= 2.0 * np.pi * np.round(error / (2.0 * np.pi))
        columns = above, climb, airspeed, roll, pitch, error, p, q, r, np.sin(phase), np.cos(phase)
        with np.errstate(over="ignore"):
            observed = np.column_stack((*columns, actions)).astype(np.float32)
        return np.clip(observed, -LIMITS, LIMITS)

    def _rewards(self) -> NDArray[np.float64]:
        errors = self._observations[:, (0, 5)].astype(np.float64) / (5.0, 0.5)
        rewards: NDArray[np.float64] = np.maximum(1.0 - errors[:, 0] ** 2 - errors[:, 1] ** 2, -1.0)
        return rewards

    def _infos(self, mask: Flags) -> Infos:
        assert self._batch is not None
        altitude, heading = self._targets.T
        values = {"time": self._batch.time_us * 1e-6, "altitude_target": altitude, "heading_target": heading}
        infos: Infos = {name: np.where(mask, value, 0.0) for name, value in values.items()}
        return infos | {f"_{name}": mask.copy() for name in values}

    def _raise_diverged(self, stepped: Flags) -> None:
        assert self._batch is not None
        diverged = np.flatnonzero((self._batch.arrays.outcome == DIVERGED) & stepped)
        if diverged.size:
            i = int(diverged[0])
            raise SimulationDiverged(f"vehicle {i}: the simulation diverged at {self._batch.time_us[i] * 1e-6:.3f} s")


def _batch(size: int, sim: Simulation, threads: int) -> VehicleBatch:
    """Return a batch of the vehicle of a simulation, in its conditions."""
    world, scenario = sim.world, sim.world.scenario
    vehicle, level = world.vehicle, scenario.turbulence
    model = world.plant.mechanism.model.name
    if is_compiled_separately(model):
        # Its work space belongs to a vehicle and holds part of the wake's history.
        raise InputError(f"the aerodynamic model {model} is not available in the batch; use {ASYNC}")

    def plant() -> Plant:
        made = Plant(vehicle)
        if scenario.vibration > 0.0:
            make_unequal(made, vehicle, scenario.vibration)
        return made

    conditions = Conditions(
        span=2.0 * vehicle.wing.semispan,
        turbulent=level != "none",
        strength=dryden.strength_of(level),
        wind=steady_wind(scenario.wind_speed, scenario.wind_from),
        altitude=scenario.home.altitude,
        travel=(vehicle.drive.travel, vehicle.tail_servo.travel),
        cranked=vehicle.drive.kind != "servo",
    )
    return VehicleBatch(size, plant, _manual_gains(sim.autopilot.memory.gains), conditions, threads)


def _manual_gains(gains: FlightGains) -> ManualGains:
    pitch, tail, flapping = gains.pitch, gains.tail, gains.flapping
    return ManualGains(
        throttle_rate=gains.altitude.throttle_rate,
        elevator_trim=pitch.elevator_trim,
        elevator_min=pitch.elevator_min,
        elevator_max=pitch.elevator_max,
        rudder_share=tail.rudder_share,
        yaw_share=tail.yaw_share,
        asymmetry_share=tail.asymmetry_share,
        tail_min=tail.elevator_min,
        tail_max=tail.elevator_max,
        rudder_max=tail.rudder_max,
        servo_rate=tail.servo_rate,
        motor=flapping.drive == "motor",
        throttle_cut=flapping.throttle_cut,
        throttle_points=np.array(flapping.throttle_points),
        frequency_points=np.array(flapping.frequency_points),
        amplitude_points=np.array(flapping.amplitude_points),
        frequency_rate=flapping.frequency_rate,
        start_time=flapping.start_time,
        mean_angle=flapping.mean_angle,
        glide_angle=flapping.glide_angle,
        travel_min=flapping.travel_min,
        travel_max=flapping.travel_max,
        full_deflection=FULL_DEFLECTION,
    )


def _start(sim: Simulation) -> Start:
    """Return the state of a vehicle in flight.

    Raises:
        InputError: it is not in free flight, or the flight computer does not fly it by the sticks alone.
    """
    world, memory = sim.world, sim.autopilot.memory
    _require_free_flight(sim, memory)
    command = quantized_command(sim.command)
    stroke, air = memory.flapping, world.inputs
    return Start(
        y=world.plant.y.copy(),
        gusts=(air.tick, *air.arrays.memory.tolist()),
        gust_seed=world.scenario.seed,
        command=(command.wing_left, command.wing_right, command.throttle, command.elevator, command.rudder),
        targets=tuple(air.arrays.targets.tolist()),
        memory=(
            memory.altitude_loop.throttle, memory.pitch_loop_status.elevator, memory.roll_loop_status.roll_command,
            *memory.tail, stroke.phase, stroke.frequency, stroke.envelope, stroke.amplitude,
        ),
        ticks=memory.clock.ticks,
        time_us=world.time_us,
    )  # fmt: skip


def _require_free_flight(sim: Simulation, memory: AutopilotState) -> None:
    if sim.state.on_ground:
        raise InputError("the vehicle is not in free flight at the handover; choose another handover")
    if not memory.modes.armed or memory.modes.cut or memory.excitation.phase:
        raise InputError("the flight computer has disarmed, cut the wings or excites at the handover; choose another")
