"""Truth of the simulated world: one kernel computes the numbers of its messages."""

from __future__ import annotations

import math
from collections.abc import Callable
from functools import cached_property
from typing import NamedTuple

import numpy as np

from sim_bridge import observation as o
from sim_bridge.compiled import Bound, bound_values, entry_point, exact
from sim_bridge.flight.inputs import PlantInputs
from sim_bridge.messages import TruthLoads, TruthState, TruthWing
from sim_bridge.plant import Plant
from sim_bridge.plant_kernel import observe_velocities, open_circuit_voltage
from sim_bridge.sensors.power_sensor import mean_square
from sim_bridge.vectors import Floats, Integers

WIND, AIR, WING, MEANS, TAIL, CHARGE = 13, 16, 19, 25, 29, 31
"""-; index of the first number of: wind, velocity through the air, wings, drives, tail, open-circuit voltage. The
numbers before `AIR` are those of `TruthState`, in order."""


class TruthArrays(NamedTuple):
    """Kernel arguments."""

    y: Floats
    """state of the plant"""
    r: Floats
    """(3, 3); r_ned_from_frd"""
    means: Floats
    """averages over the last step, see `plant.Means`"""
    observed: Floats
    """(`observation.SIZE`,) out; velocities over ground and through the air"""
    wind: Floats
    """(3,) m/s; NED, steady"""
    gust: Floats
    """(6,) m/s, rad/s; velocity and angular velocity of the air, NED"""
    extra: Floats
    """(3,) m/s; NED, set by the caller"""
    battery: Floats
    """(4,); see `plant_kernel.PlantParameters`"""
    nose: float
    """m; pitot tube ahead of the base's origin"""
    wings: Integers
    """(6,); states of flap angles, rates and tip twists, each left and right, -1 for none"""
    tail: Integers
    """(2,); states of elevator and rudder, -1 for none"""
    charge: int
    """state of the charge drawn from the battery"""
    values: Floats
    """(32,) out; SI, see `WIND`"""


@exact
def fill_truth(bound: Bound) -> None:
    """Fill the values and the observed velocities with the state at the end of the last step."""
    a = bound_values(bound)
    y, r, values = a.y, a.r, a.values
    wind = values[WIND:AIR]
    for i in range(3):
        wind[i] = a.wind[i] + a.gust[i] + a.extra[i]
    observe_velocities(y, r, wind, a.nose, a.observed)
    for i in range(3):
        values[i], values[3 + i], values[10 + i] = y[i], a.observed[o.V_NED + i], y[10 + i]
        values[AIR + i] = y[7 + i] - (r[0, i] * wind[0] + r[1, i] * wind[1] + r[2, i] * wind[2])
    for i in range(4):
        values[6 + i], values[MEANS + i] = y[3 + i], a.means[i]
    for i in range(6):
        values[WING + i] = y[a.wings[i]] if a.wings[i] >= 0 else 0.0
    for i in range(2):
        values[TAIL + i] = y[a.tail[i]] if a.tail[i] >= 0 else 0.0
    values[CHARGE] = open_circuit_voltage(y[a.charge], a.battery)


class Truth:
    """The messages of a plant and its air; averages are over the last step."""

    def __init__(self, plant: Plant, inputs: PlantInputs) -> None:
        """Share the arrays of both; battery and pitot tube are those of the plant's parameters at this time."""
        self._plant, self._edge = plant, plant.vehicle.sections["power_sensor"].edge
        at, air = plant.layout, inputs.arrays
        wings = (*at.flap, at.rate(at.flap[0]), at.rate(at.flap[1]), *at.twist)
        self._values, self._loads = np.zeros(CHARGE + 1), np.zeros(6)
        self._bound = Bound(
            TruthArrays(
                plant.y, plant.scratch.r, plant.scratch.means, plant.observed, air.wind, air.gust, air.extra,
                plant.parameters.battery, plant.parameters.nose, np.array(wings), np.array((at.elevator, at.rudder)),
                at.charge, self._values,
            )
        )  # fmt: skip

    @cached_property
    def _fill(self) -> Callable[[Bound], None]:
        return entry_point(fill_truth, self._bound)

    def values(self) -> list[float]:
        """Return the numbers of the messages; the observed velocities are those of the present state, too."""
        self._fill(self._bound)
        return self._values.tolist()

    def state(self, time_us: int, values: list[float], on_ground: bool) -> TruthState:
        """Return the state of the body."""
        x, y, z = values[AIR:WING]
        return TruthState._make((time_us, *values[:AIR], math.hypot(x, y, z), math.atan2(z, x), int(on_ground)))

    def wing(self, time_us: int, values: list[float]) -> TruthWing:
        """Return the state of wings and drives."""
        voltage, power = self._supply(values[MEANS + 2], values[MEANS + 3], values[CHARGE])
        return TruthWing._make((time_us, *values[WING : MEANS + 3], voltage, power, *values[TAIL:CHARGE]))

    def loads(self, time_us: int) -> TruthLoads:
        """Return the air loads of wings and tail near the end of the last step."""
        self._plant.fill_air_load(self._loads)
        return TruthLoads._make((time_us, *self._loads.tolist(), *self._plant.scratch.plate_load.tolist()))

    def _supply(self, current: float, power: float, open_circuit: float) -> tuple[float, float]:
        """Return voltage (V) and power (W) at the drives' terminals, averaged over the last step and the modulation.

        The plant's current is smooth. Current pulses of the same mean, with the edges that the ADC samples, have
        larger losses in the battery.
        """
        drive, resistance = self._plant.vehicle.drive, self._plant.vehicle.battery.resistance
        if drive.pwm_frequency > 0.0 and 0.0 < current < drive.pulse_current:
            square = mean_square(current / drive.pulse_current, drive.pwm_frequency * self._edge)
            lost = resistance * drive.pulse_current * drive.pulse_current * square
            return open_circuit - resistance * current, open_circuit * current - lost
        return power / current if current else open_circuit, power
