"""The air around one vehicle in flight: standard atmosphere, steady wind and Dryden gusts, one tick at a time."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from sim_bridge import observation as o
from sim_bridge import plant_kernel as k
from sim_bridge.compiled import Bound, bound_values, exact
from sim_bridge.environment import dryden
from sim_bridge.observation import Vector
from sim_bridge.plant import Plant
from sim_bridge.vectors import Floats
from wingbeat import atmosphere
from wingbeat.atmosphere import HIGHEST, LOWEST, SEA_LEVEL_PRESSURE, SEA_LEVEL_TEMPERATURE, isa

_air_at = exact(atmosphere.air_at)


class AirArrays(NamedTuple):
    """Kernel arguments."""

    y: Floats
    """state of the plant"""
    r: Floats
    """(3, 3); r_ned_from_frd at the end of the last step"""
    order: Floats
    """(21,) out; of the plant's next step: velocity, density and angular velocity of the air"""
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


class MovingAir:
    """Air of one flight; `step` before each step of the plant."""

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
        self._turbulence, self._tick = turbulence, 0
        self._is_turbulent = turbulence.level != "none"
        self._y, self._altitude = plant.y, altitude
        self.gust = np.zeros(6)
        """m/s, rad/s; velocity and angular velocity of the air in addition to the wind, NED"""
        self.extra_wind = np.zeros(3)
        """m/s; NED, added to wind and gusts; the caller may write to it"""
        self._wind, self._noise = np.array(wind), np.zeros((dryden.BLOCK, dryden.DRAWS))
        self._noise[:] = dryden.noise_block(turbulence.seed, 0)
        self._bound = Bound(
            AirArrays(
                plant.y,
                plant.scratch.r,
                plant.order,
                plant.observed,
                self._wind,
                self.extra_wind,
                self.gust,
                np.array(dryden.initial(turbulence, heading)[1:]),
                self._noise,
                dryden.strength_of(turbulence.level),
                turbulence.span,
                altitude,
            )
        )

    def step(self, duration: float) -> None:
        """Advance the gusts by ``duration`` s; set the surroundings of the plant's next step.

        Raises:
            ValueError: the vehicle is outside the standard atmosphere.
        """
        altitude = self._altitude - self._y.item(2)
        if not LOWEST <= altitude <= HIGHEST:
            isa(altitude)
        row = -1
        if self._is_turbulent:
            self._tick += 1
            row = self._tick % dryden.BLOCK
            if row == 0:
                self._noise[:] = dryden.noise_block(self._turbulence.seed, self._tick // dryden.BLOCK)
        move_air(row, duration, self._bound)

    @property
    def velocity(self) -> Vector:
        """m/s; velocity of the air at the vehicle, NED: steady wind, gust and `extra_wind`."""
        north, east, down = (self._wind + self.gust[:3] + self.extra_wind).tolist()
        return north, east, down


@exact
def move_air(row: int, dt: float, bound: Bound) -> None:
    """Advance the gusts by ``dt`` s with a ``row`` of the noise, if any (>= 0); fill order and ambient air."""
    a = bound_values(bound)
    gust, order = a.gust, a.order
    if row >= 0:
        _advance_gust(row, dt, a)
    air = _air_at(a.altitude - a.y[2], SEA_LEVEL_PRESSURE, SEA_LEVEL_TEMPERATURE)
    a.observed[o.STATIC_PRESSURE], a.observed[o.TEMPERATURE], a.observed[o.DENSITY] = air
    for i in range(3):
        order[k.WIND + i] = a.wind[i] + gust[i] + a.extra[i]
        turn = a.r[0, i] * gust[3] + a.r[1, i] * gust[4] + a.r[2, i] * gust[5]
        order[k.AIR_TURN + i] = turn + 0.0  # without gusts no negative zero
    order[k.AIR_DENSITY] = air.density


@exact
def _advance_gust(row: int, dt: float, a: AirArrays) -> None:
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
