"""Inputs of the plant's next step: actuator commands, standard atmosphere, steady wind and Dryden gusts."""

from __future__ import annotations

import math
from collections.abc import Callable
from functools import cached_property
from typing import NamedTuple

import numpy as np

from avionics.messages import ActuatorCommand
from sim_bridge import observation as o
from sim_bridge import plant_kernel as k
from sim_bridge.compiled import Bound, bound_values, entry_point, exact, exact_inlined
from sim_bridge.environment import dryden
from sim_bridge.observation import Vector
from sim_bridge.plant import Plant
from sim_bridge.vectors import Floats
from wingbeat import atmosphere
from wingbeat.atmosphere import HIGHEST, LOWEST, SEA_LEVEL_PRESSURE, SEA_LEVEL_TEMPERATURE, isa

_air_at = exact_inlined(atmosphere.air_at)


class InputArrays(NamedTuple):
    """Kernel arguments."""

    y: Floats
    """state of the plant"""
    r: Floats
    """(3, 3); r_ned_from_frd at the end of the last step"""
    order: Floats
    """(21,) out; controls and surroundings of the plant's next step but for the launcher"""
    observed: Floats
    """(`observation.SIZE`,) in: velocity over ground; out: static pressure, temperature, density"""
    wind: Floats
    """(3,) m/s; NED, steady"""
    extra: Floats
    """(3,) m/s; NED, set by the caller"""
    gust: Floats
    """(6,) m/s, rad/s; velocity and angular velocity of the air, NED"""
    memory: Floats
    """(9,); `dryden.Memory`"""
    noise: Floats
    """(`dryden.BLOCK`, `dryden.DRAWS`); normal numbers of this block of ticks"""
    strength: dryden.Strength
    span: float
    """m; of the vehicle"""
    altitude: float
    """m; of the launch place above mean sea level"""
    servo_gain: Floats
    """(2,) -; see `plant_kernel.PlantParameters`"""
    travel: float
    """rad; largest angle of a wing drive"""
    tail_travel: float
    """rad; largest angle of elevator and rudder"""
    targets: Floats
    """(2,) rad; last setpoints of the left and the right wing angle, with the servo gain"""


class PlantInputs:
    """Inputs of one plant on one flight; `step` before each step of the plant."""

    def __init__(
        self, plant: Plant, turbulence: dryden.Turbulence, wind: Vector, heading: float, altitude: float
    ) -> None:
        """Place a plant in the air.

        Args:
            plant: its `order` and `observed` are filled.
            turbulence: gusts.
            wind: m/s; NED, steady.
            heading: rad; direction that the vehicle faces.
            altitude: m; of the launch place above mean sea level.
        """
        self._turbulence, self.tick = turbulence, 0
        """-; ticks of the gusts so far"""
        self._is_turbulent = turbulence.level != "none"
        self._y, self._altitude = plant.y, altitude
        self.gust = np.zeros(6)
        """m/s, rad/s; velocity and angular velocity of the air in addition to the wind, NED"""
        self.extra_wind = np.zeros(3)
        """m/s; NED, added to wind and gusts; the caller may write to it"""
        self._wind, self._noise = np.array(wind), dryden.noise_block(turbulence.seed, 0).copy()
        self.arrays = InputArrays(
            y=plant.y,
            r=plant.scratch.r,
            order=plant.order,
            observed=plant.observed,
            wind=self._wind,
            extra=self.extra_wind,
            gust=self.gust,
            memory=np.array(dryden.initial(turbulence, heading)[1:]),
            noise=self._noise,
            strength=dryden.strength_of(turbulence.level),
            span=turbulence.span,
            altitude=altitude,
            servo_gain=plant.parameters.servo_gain,
            travel=plant.vehicle.drive.travel,
            tail_travel=plant.vehicle.tail_servo.travel,
            targets=np.zeros(2),
        )
        """state and parameters of the inputs, shared with the kernels"""
        self._bound = Bound(self.arrays)

    def step(self, command: ActuatorCommand, duration: float) -> None:
        """Advance the gusts by ``duration`` s; set controls and surroundings of the plant's next step.

        Raises:
            ValueError: the vehicle is outside the standard atmosphere.
        """
        altitude = self._altitude - self._y.item(2)
        if not LOWEST <= altitude <= HIGHEST:
            isa(altitude)
        row = -1
        if self._is_turbulent:
            self.tick += 1
            row = self.tick % dryden.BLOCK
            if row == 0:
                self._noise[:] = dryden.noise_block(self._turbulence.seed, self.tick // dryden.BLOCK)
        _, left, right, throttle, elevator, rudder, armed = command
        self._set_inputs(row, duration, left, right, throttle, elevator, rudder, armed, self._bound)

    @cached_property
    def _set_inputs(self) -> Callable[..., None]:
        return entry_point(set_inputs, 0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0, self._bound)


@exact
def set_inputs(
    row: int,
    dt: float,
    left: float,
    right: float,
    throttle: float,
    elevator: float,
    rudder: float,
    armed: int,
    bound: Bound,
) -> None:
    """Set controls and air of a step of ``dt`` s; advance the gusts with a ``row`` of the noise, if any (>= 0)."""
    a = bound_values(bound)
    _set_controls(left, right, throttle, armed != 0, a)
    a.order[5], a.order[6], a.order[7] = _clip(elevator, a.tail_travel), _clip(rudder, a.tail_travel), dt
    if row >= 0:
        _advance_gust(row, dt, a)
    _set_air(a)


@exact_inlined
def _set_controls(left: float, right: float, throttle: float, is_armed: bool, a: InputArrays) -> None:
    """Set the first five and the last two fields of `plant_kernel.Controls`; unarmed wings keep their setpoints."""
    order, targets = a.order, a.targets
    order[0], order[2] = targets[0], targets[1]
    if is_armed:
        targets[0] = _clip(a.servo_gain[0] * left, a.travel)
        targets[1] = _clip(a.servo_gain[1] * right, a.travel)
    order[1], order[3] = targets[0], targets[1]
    order[4] = max(_clip(throttle, 1.0), 0.0) if is_armed else 0.0
    order[8], order[9] = 1.0, 1.0 if is_armed else 0.0


@exact_inlined
def _clip(value: float, limit: float) -> float:
    if -limit <= value <= limit:
        return value
    return math.copysign(limit, value) if math.isfinite(value) else 0.0


@exact_inlined
def _set_air(a: InputArrays) -> None:
    gust, order = a.gust, a.order
    air = _air_at(a.altitude - a.y[2], SEA_LEVEL_PRESSURE, SEA_LEVEL_TEMPERATURE)
    a.observed[o.STATIC_PRESSURE], a.observed[o.TEMPERATURE], a.observed[o.DENSITY] = air
    for i in range(3):
        order[k.WIND + i] = a.wind[i] + gust[i] + a.extra[i]
        turn = a.r[0, i] * gust[3] + a.r[1, i] * gust[4] + a.r[2, i] * gust[5]
        order[k.AIR_TURN + i] = turn + 0.0  # without gusts no negative zero
    order[k.AIR_DENSITY] = air.density


@exact
def _advance_gust(row: int, dt: float, a: InputArrays) -> None:
    n, m, v = a.noise[row], a.memory, o.V_NED
    through = (
        a.observed[v] - a.wind[0],
        a.observed[v + 1] - a.wind[1],
        a.observed[v + 2] - a.wind[2],
    )
    after, velocity, omega = dryden.advance(
        (m[0], m[1], m[2], m[3], m[4], m[5], m[6], m[7], m[8]),
        (n[0], n[1], n[2], n[3], n[4], n[5]),
        a.strength,
        (a.span, -a.y[2]),
        through,
        dt,
    )
    for i in range(9):
        m[i] = after[i]
    for i in range(3):
        a.gust[i] = velocity[i]
        a.gust[3 + i] = omega[i]
