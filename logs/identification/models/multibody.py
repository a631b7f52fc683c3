"""The air load that the wings must have made for a vehicle to move as it did (Grauer et al. 2011, Eq. 13).

The equations of motion of the plant, read the other way: mass matrix times the measured rates of the speeds, less
what bias motion, weight, tail and, where asked for, the fuselage's drag make. What the joints' drives, springs and
servos do stays inside the vehicle and is in none of the base's six equations.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from sim_bridge import plant_kernel as k
from sim_bridge.aerodynamics.regression import dynamic_pressure
from sim_bridge.compiled import Bound, bound_values, kernel
from sim_bridge.mechanism import build_mechanism, wing_strips
from sim_bridge.multibody.plates import add_plates
from sim_bridge.multibody.tree import BASE, Equations, assemble
from sim_bridge.multibody.wings import add_wings
from sim_bridge.plant import plant_parameters, scratch
from sim_bridge.vectors import Floats
from sim_bridge.vehicles import SimulatedVehicle
from wingbeat.errors import InputError


class Wing(NamedTuple):
    """What coefficients are told of."""

    area: float
    """m^2; S of Eq. 14, both wings"""
    chord: float
    """m; c of Eq. 16"""


class MovedVehicle(NamedTuple):
    """How a vehicle with c coordinates moved at N instants; coordinates in the order of `Layout.coordinates`."""

    quaternion: Floats
    """-; (N, 4), of r_ned_from_frd"""
    speeds: Floats
    """m/s, rad/s; (N, 6 + c), velocity over ground and angular velocity of the base, body axes; coordinates' rates"""
    coordinates: Floats
    """rad; (N, c)"""
    rates: Floats
    """(N, 6 + c) m/s^2, rad/s^2; time derivatives of ``speeds``, component by component"""
    wind_ned: Floats
    """m/s; (N, 3), velocity of the air over ground"""


class WingAir(NamedTuple):
    """What the air did to the wings, N instants."""

    load: Floats
    """N, N m; (N, 6), on the vehicle about the base's origin, body axes; apparent mass included"""
    pressure: Floats
    """Pa; (N,), half the density times |v_mac|^2 of Eq. 14, mean of the wings"""


def wing_of(vehicle: SimulatedVehicle) -> Wing:
    """Area of both wings and their mean chord, as the vehicle's regression has them, or by its strips."""
    told = vehicle.sections.get("regression")
    if told is not None:
        return Wing(float(told.area), float(told.chord))
    strips, _ = wing_strips(vehicle.wing)
    area = float(np.sum(strips.chord * strips.width))
    return Wing(area, area / (2.0 * vehicle.wing.semispan))


def flap_columns(vehicle: SimulatedVehicle) -> list[int]:
    """Columns of the flapping angles among the coordinates of the ``vehicle``."""
    return [index - k.COORDINATES for index in build_mechanism(vehicle).layout.flap]


def coordinate_count(vehicle: SimulatedVehicle) -> int:
    """Number of the coordinates of the ``vehicle``."""
    return len(build_mechanism(vehicle).layout.coordinates)


@kernel
def _required(states: Floats, rates: Floats, winds: Floats, density: float, bound: Bound, out: Floats) -> None:
    """Fill ``out`` (N, 7) with load and dynamic pressure of every instant."""
    p, s = bound_values(bound)
    for n in range(states.shape[0]):
        around = k.Surroundings(winds[n, 0], winds[n, 1], winds[n, 2], density, k.FREE, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0)
        s.mass[:, :] = 0.0
        s.load[:] = 0.0
        k.set_motion(states[n], around, p, s)
        add_wings(p.tree, s.tree, p.wings, s.wings, Equations(s.mass, s.load))
        add_plates(s.tree, p.plates, s.outside[3:9], density, s.plate_load)
        k.load_fuselage(density, p.drag_areas, s)
        assemble(p.tree, s.tree, s.mass, s.load)
        for i in range(BASE):
            out[n, i] = -s.load[i]
            for j in range(rates.shape[1]):
                out[n, i] += (s.mass[i, j] if i <= j else s.mass[j, i]) * rates[n, j]
        out[n, BASE] = dynamic_pressure(p.wings.strips, s.wings.motion, density)


def wing_air(vehicle: SimulatedVehicle, moved: MovedVehicle, density: float, with_drag: bool = True) -> WingAir:
    """The wings' air load and dynamic pressure at every instant of ``moved``, air of ``density`` kg/m^3.

    The tail's load is that of the vehicle's plates. The fuselage's drag is left in the wings' load ``with_drag``, as
    Grauer did, or else taken off by the vehicle's drag areas.

    Raises:
        InputError: the motion has other coordinates than the vehicle.
    """
    mechanism = build_mechanism(vehicle)
    names, hull = mechanism.layout.coordinates, vehicle.fuselage
    if moved.coordinates.shape[1] != len(names):
        raise InputError(f"{vehicle.name} has the coordinates {', '.join(names)}, not {moved.coordinates.shape[1]}")
    areas = np.zeros(2) if with_drag else np.array([hull.drag_area, hull.side_area])
    parameters = plant_parameters(vehicle, mechanism)._replace(plates=mechanism.plates, drag_areas=areas)
    states = np.zeros((len(moved.speeds), mechanism.layout.size))
    first, c = k.COORDINATES, len(names)
    states[:, 3:7] = moved.quaternion
    states[:, 7:first] = moved.speeds[:, :BASE]
    states[:, first : first + c] = moved.coordinates
    states[:, first + c : first + 2 * c] = moved.speeds[:, BASE:]
    out = np.zeros((len(states), BASE + 1))
    bound = Bound((parameters, scratch(mechanism)))
    rates, winds = (np.ascontiguousarray(values, dtype=np.float64) for values in (moved.rates, moved.wind_ned))
    _required(states, rates, winds, density, bound, out)
    return WingAir(out[:, :BASE], out[:, BASE])


__all__ = ["BASE", "SimulatedVehicle"]
"""re-exported, so that no other module of the core imports the plant"""
