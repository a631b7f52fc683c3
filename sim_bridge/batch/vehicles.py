"""State of many vehicles in arrays, and the compiled loop that advances them.

The loop is a kernel without the interpreter lock. Each thread calls it for a few vehicles at a time, with a plant of
its own as work space, so that the cores are busy to the end of a step. Threads of the standard library take the
place of numba's: these cannot be used after a fork.
"""

from __future__ import annotations

import itertools
import math
import os
from collections.abc import Callable, Iterator
from concurrent.futures import ThreadPoolExecutor
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from sim_bridge import plant_kernel as k
from sim_bridge.batch import manual
from sim_bridge.batch.manual import ManualGains
from sim_bridge.compiled import Bound, bound_values, exact_inlined, inlined, internal, nogil_kernel
from sim_bridge.environment import dryden
from sim_bridge.multibody.tree import BASE
from sim_bridge.plant import Plant
from sim_bridge.sensors.sense import LARGEST
from sim_bridge.vectors import Floats, Integers, rotation
from wingbeat import atmosphere
from wingbeat.atmosphere import SEA_LEVEL_PRESSURE, SEA_LEVEL_TEMPERATURE
from wingbeat.cores import available_cores

TICKS = 4
"""-; ticks of 5 ms that one call advances"""
SUBSTEPS = math.ceil(manual.PERIOD / k.STEP - 1e-9)
"""-; integrator steps of 1 ms in a tick"""
CHUNK = 4
"""-; vehicles in one call of the kernel"""
GUSTS = len(dryden.GustState._fields) - 1
air_at = exact_inlined(atmosphere.air_at)

OBSERVED = ("altitude", "climb_rate", "airspeed", "roll", "pitch", "heading", "p", "q", "r", "phase")
"""columns of `VehicleBatch.observed`: m, m/s, m/s, rad, rad, rad, rad/s, rad/s, rad/s, rad"""
PHASE = len(OBSERVED) - 1
FLYING, ON_GROUND, DIVERGED = 0, 1, 2
"""values of `VehicleBatch.outcome`"""


Velocity = tuple[float, float, float]


class Start(NamedTuple):
    """One vehicle in free flight at the end of a tick."""

    y: Floats
    """state of the plant, see `sim_bridge.plant_kernel`"""
    gusts: tuple[float, ...]
    """state of the gust filters, see `dryden.GustState`, with its tick"""
    gust_seed: int
    command: tuple[float, ...]
    """actuator command of the next tick, (5,): wings left, right in rad, throttle, elevator, rudder in rad"""
    targets: tuple[float, float]
    """rad; setpoints of the wing angles in the last tick, with the servo gain"""
    memory: tuple[float, ...]
    """of `manual.control`, (9,)"""
    ticks: int
    """-; of the flight computer since boot"""
    time_us: int
    """us; since boot"""


class Conditions(NamedTuple):
    """What all vehicles of a batch share."""

    span: float
    """m"""
    turbulent: bool
    strength: dryden.Strength
    wind: Velocity
    """m/s; steady, NED"""
    altitude: float
    """m; of the launch place above mean sea level"""
    travel: tuple[float, float]
    """rad; of wing and tail servos"""
    cranked: bool
    """whether the phase of the stroke is that of a crank"""


class Arrays(NamedTuple):
    """State of n vehicles; a row each."""

    y: Floats
    """(n, k)"""
    gusts: Floats
    """(n, 9)"""
    command: Floats
    """(n, 5)"""
    targets: Floats
    """(n, 2) rad"""
    memory: Floats
    """(n, 9)"""
    sticks: Floats
    """(n, 4)"""
    gust_ticks: Integers
    """(n,)"""
    ticks: Integers
    """(n,)"""
    noise: Floats
    """(n, 2, 256, 6); normal numbers of the block of the tick and the next one, each in the row of its parity"""
    observed: Floats
    """(n, 10); see `OBSERVED`"""
    outcome: Integers
    """(n,)"""
    active: NDArray[np.bool_]
    """(n,); vehicles that the next step advances"""


@inlined
def _limited(value: float, limit: float) -> float:
    return min(max(value, -limit), limit)


@nogil_kernel
def advance_vehicles(batch: Bound, bound: Bound, first: int, end: int) -> None:
    """Advance the active vehicles of ``first`` to ``end`` by `TICKS`.

    Args:
        batch: `Arrays`, `ManualGains` and `Conditions`.
        bound: parameters and work space of the plant of the thread.
        first: index of the first vehicle.
        end: index after the last.
    """
    a, gains, of = bound_values(batch)
    for i in range(first, end):
        if a.active[i]:
            _advance_vehicle(a, gains, of, bound, i)


@internal
def _advance_vehicle(a: Arrays, gains: ManualGains, of: Conditions, bound: Bound, i: int) -> None:
    p, s = bound_values(bound)
    y, r, touching, wind = a.y[i], s.r, False, of.wind
    for _ in range(TICKS):
        rotation(y[3], y[4], y[5], y[6], r)
        wind, turn = _air(a, i, of, r)
        density = air_at(of.altitude - y[2], SEA_LEVEL_PRESSURE, SEA_LEVEL_TEMPERATURE).density
        around = k.Surroundings(wind[0], wind[1], wind[2], density, k.FREE, 0.0, 0.0, 0.0, turn[0], turn[1], turn[2])
        controls = _controls(a.command[i], a.targets[i], p.servo_gain, of.travel)
        touching = k.advance(y, SUBSTEPS, controls, around, bound)
        a.ticks[i] += 1
        manual.control(gains, a.ticks[i], a.sticks[i], a.memory[i], a.command[i])
    _observe(y, r, wind, a.observed[i])
    crank = k.COORDINATES + 2 * (s.load.shape[0] - BASE)
    a.observed[i, PHASE] = y[crank] if of.cranked else a.memory[i, manual.PHASE]
    a.outcome[i] = ON_GROUND if touching else FLYING
    for j in range(k.COORDINATES):
        if not abs(y[j]) < LARGEST:
            a.outcome[i] = DIVERGED


@inlined
def _air(a: Arrays, i: int, of: Conditions, r: Floats) -> tuple[Velocity, Velocity]:
    """Velocity of the air in m/s, NED, and its angular velocity in rad/s, body axes, after one more tick of gusts."""
    if not of.turbulent:
        return of.wind, (0.0, 0.0, 0.0)
    y, m = a.y[i], a.gusts[i]
    u, v, w = y[7], y[8], y[9]
    flight = (
        r[0, 0] * u + r[0, 1] * v + r[0, 2] * w - of.wind[0],
        r[1, 0] * u + r[1, 1] * v + r[1, 2] * w - of.wind[1],
        r[2, 0] * u + r[2, 1] * v + r[2, 2] * w - of.wind[2],
    )
    a.gust_ticks[i] += 1
    tick = a.gust_ticks[i]
    n = a.noise[i, (tick // dryden.BLOCK) % 2, tick % dryden.BLOCK]
    before = (m[0], m[1], m[2], m[3], m[4], m[5], m[6], m[7], m[8])
    noise = (n[0], n[1], n[2], n[3], n[4], n[5])
    after, gust, omega = dryden.advance(before, noise, of.strength, (of.span, -y[2]), flight, manual.PERIOD)
    m[0], m[1], m[2], m[3], m[4], m[5], m[6], m[7], m[8] = after
    turn = (
        r[0, 0] * omega[0] + r[1, 0] * omega[1] + r[2, 0] * omega[2],
        r[0, 1] * omega[0] + r[1, 1] * omega[1] + r[2, 1] * omega[2],
        r[0, 2] * omega[0] + r[1, 2] * omega[1] + r[2, 2] * omega[2],
    )
    return (of.wind[0] + gust[0], of.wind[1] + gust[1], of.wind[2] + gust[2]), turn


@inlined
def _controls(command: Floats, targets: Floats, gain: Floats, travel: tuple[float, float]) -> k.Controls:
    """Return the command as the servos receive it, after those of the last tick; as `SimulatedWorld` does."""
    wings, tail = travel
    left = _limited(gain[0] * command[manual.WING_LEFT], wings)
    right = _limited(gain[1] * command[manual.WING_RIGHT], wings)
    left_before, right_before = targets[0], targets[1]
    targets[0], targets[1] = left, right
    throttle = max(_limited(command[manual.MOTOR], 1.0), 0.0)
    elevator, rudder = _limited(command[manual.TAIL_UP], tail), _limited(command[manual.TAIL_RIGHT], tail)
    return k.Controls(left_before, left, right_before, right, throttle, elevator, rudder, manual.PERIOD, 1.0, 1.0)


@inlined
def _observe(y: Floats, r: Floats, wind: Velocity, out: Floats) -> None:
    """Fill the first nine of `OBSERVED`."""
    u, v, w = y[7], y[8], y[9]
    x = u - (r[0, 0] * wind[0] + r[1, 0] * wind[1] + r[2, 0] * wind[2])
    side = v - (r[0, 1] * wind[0] + r[1, 1] * wind[1] + r[2, 1] * wind[2])
    down = w - (r[0, 2] * wind[0] + r[1, 2] * wind[1] + r[2, 2] * wind[2])
    out[0] = -y[2]
    out[1] = -(r[2, 0] * u + r[2, 1] * v + r[2, 2] * w)
    out[2] = math.sqrt(x * x + side * side + down * down)
    out[3] = math.atan2(r[2, 1], r[2, 2])
    out[4] = math.asin(_limited(-r[2, 0], 1.0))
    out[5] = math.atan2(r[1, 0], r[0, 0])
    out[6], out[7], out[8] = y[10], y[11], y[12]


class VehicleBatch:
    """Vehicles of one kind in manual flight; `place` puts one into the air, `step` advances those in the air."""

    def __init__(
        self, size: int, plant: Callable[[], Plant], gains: ManualGains, conditions: Conditions, threads: int = 0
    ) -> None:
        """Allocate ``size`` vehicles.

        Args:
            size: number of vehicles.
            plant: returns a new plant of the vehicle; each thread has one.
            gains: of the flight computer.
            conditions: of all vehicles.
            threads: number of threads; 0: as many as cores that the process may use.
        """
        threads = min(threads or available_cores(), -(-size // CHUNK))
        self._plants = [plant() for _ in range(threads)]
        self._bounds = [Bound((one.parameters, one.scratch)) for one in self._plants]
        self._turbulent = conditions.turbulent
        self._seeds, self._blocks = np.zeros(size, np.int64), np.full((size, 2), -1)
        self.time_us = np.zeros(size, np.int64)
        """(n,) us; since boot"""
        self.arrays = Arrays(
            y=np.zeros((size, self._plants[0].y.size)),
            gusts=np.zeros((size, GUSTS)),
            command=np.zeros((size, manual.COMMAND)),
            targets=np.zeros((size, 2)),
            memory=np.zeros((size, manual.MEMORY)),
            sticks=np.zeros((size, 4)),
            gust_ticks=np.zeros(size, np.int64),
            ticks=np.zeros(size, np.int64),
            noise=np.zeros((size, 2, dryden.BLOCK, dryden.DRAWS)),
            observed=np.zeros((size, len(OBSERVED))),
            outcome=np.zeros(size, np.int64),
            active=np.zeros(size, np.bool_),
        )
        self._bound = Bound((self.arrays, gains, conditions))
        self._pool: ThreadPoolExecutor | None = None
        self._process = -1

    def place(self, i: int, start: Start) -> None:
        """Put vehicle ``i`` into the air, with neutral sticks."""
        a = self.arrays
        tick, *gusts = start.gusts
        a.y[i], a.gusts[i], a.command[i], a.targets[i] = start.y, gusts, start.command, start.targets
        a.memory[i], a.sticks[i], a.ticks[i], a.gust_ticks[i] = start.memory, 0.0, start.ticks, tick
        self.time_us[i], self._seeds[i], self._blocks[i] = start.time_us, start.gust_seed, -1
        a.active[i], a.outcome[i] = True, FLYING

    def step(self, sticks: Floats) -> None:
        """Advance the active vehicles by `TICKS` with ``sticks`` (n, 4): pitch, roll, yaw and throttle from 0 to 1.

        The results are in ``arrays.observed`` and ``arrays.outcome``. Sticks that are not finite are ignored.
        """
        a = self.arrays
        valid = np.isfinite(sticks).all(axis=1)
        a.sticks[valid] = sticks[valid]
        if self._turbulent:
            self._draw()
        chunks = itertools.count(0, CHUNK)
        workers = self._workers()
        futures = [workers.submit(self._run, bound, chunks) for bound in self._bounds[1:]]
        self._run(self._bounds[0], chunks)
        for future in futures:
            future.result()
        self.time_us[a.active] += TICKS * round(manual.PERIOD * 1e6)

    def _run(self, bound: Bound, chunks: Iterator[int]) -> None:
        size = self.arrays.active.size
        for first in chunks:
            if first >= size:
                return
            end = min(first + CHUNK, size)
            advance_vehicles(self._bound, bound, first, end)

    def _draw(self) -> None:
        """Draw the noise of the coming ticks where its block is not there yet."""
        a = self.arrays
        for ahead in (1, TICKS):
            blocks = (a.gust_ticks + ahead) // dryden.BLOCK
            for i in np.flatnonzero(a.active & (self._blocks[np.arange(blocks.size), blocks % 2] != blocks)):
                block, row = int(blocks[i]), int(blocks[i] % 2)
                a.noise[i, row] = dryden.noise_block(int(self._seeds[i]), block)
                self._blocks[i, row] = block

    def _workers(self) -> ThreadPoolExecutor:
        """Return the threads of this process; a fork has none of its parent."""
        if self._pool is None or self._process != os.getpid():
            self._pool = ThreadPoolExecutor(max(1, len(self._bounds) - 1), "wingbeat-batch")
            self._process = os.getpid()
        return self._pool

    def close(self) -> None:
        """End the threads."""
        if self._pool is not None and self._process == os.getpid():
            self._pool.shutdown()
        self._pool = None
