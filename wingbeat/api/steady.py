"""Trimmed flapping flight and its linear models."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, NamedTuple

import numpy as np
from numpy.typing import NDArray

from logs.identification.findings import Finding
from logs.model_range import range_findings
from sim_bridge.flight_mechanics.averaged import stroke_averaged_model
from sim_bridge.flight_mechanics.averaged_axes import axes_model
from sim_bridge.flight_mechanics.excursions import Figures, figures
from sim_bridge.flight_mechanics.orbit import Orbit
from sim_bridge.flight_mechanics.orbit import trim as find_orbit
from sim_bridge.flight_mechanics.similarity import orbit_excesses
from sim_bridge.tuning.model import LinearModel, model_of, save_model
from sim_bridge.vehicles import with_model
from wingbeat.api.vehicles import Vehicle, load_vehicle

if TYPE_CHECKING:
    from control import StateSpace

__all__ = ["LinearMotion", "SteadyFlight", "linearize", "trim"]

LONGITUDINAL = ("u", "w", "q", "theta")
"""states: velocity along body x and z (m/s), pitch rate (rad/s), pitch (rad)"""
LATERAL = ("v", "p", "r", "phi")
"""states: velocity along body y (m/s), roll and yaw rate (rad/s), roll (rad)"""


class SteadyFlight(NamedTuple):
    """A trimmed flapping flight: the stroke repeats itself."""

    vehicle: Vehicle
    orbit: Orbit
    """state at the start of a stroke, inputs, means over a stroke"""

    @property
    def figures(self) -> Figures:
        """Strouhal number, reduced frequency, cost of transport, endurance (s), range (m)."""
        return figures(self.vehicle.world, self.orbit)

    @property
    def findings(self) -> list[Finding]:
        """What is outside the range of the aerodynamic model."""
        return range_findings(orbit_excesses(self.vehicle.world, self.orbit))

    def __repr__(self) -> str:
        means, inputs = self.orbit.means, self.orbit.inputs
        return (
            f"SteadyFlight of {self.vehicle.name}: {means.airspeed:.2f} m/s, climb {means.climb_rate:.2f} m/s,"
            f" {inputs.frequency:.2f} Hz, pitch {np.degrees(means.pitch):.1f} deg,"
            f" elevator {np.degrees(inputs.elevator):.1f} deg, {means.electrical_power:.1f} W"
        )


class LinearMotion(NamedTuple):
    """Linear stroke-averaged motion of all axes about a trimmed flight."""

    model: LinearModel

    def longitudinal(self) -> StateSpace:
        """Return the state space of (u, w, q, theta) from the achieved elevator in rad, positive nose up.

        A python-control `StateSpace` with named states, inputs and outputs.
        """
        return state_space(self.model.a, self.model.elevator, LONGITUDINAL, "elevator")

    def lateral(self) -> StateSpace:
        """Return the state space of (v, p, r, phi) from the achieved rudder in rad, positive nose right.

        Raises:
            ValueError: the model has no lateral motion.
        """
        if self.model.lateral is None:
            raise ValueError("the model has no lateral motion")
        return state_space(self.model.lateral.a, self.model.lateral.rudder, LATERAL, "rudder")

    def save(self, path: Path | str) -> None:
        """Write the model file that ``wingbeat tune`` reads.

        Raises:
            InputError: the file exists or cannot be written.
        """
        save_model(Path(path), self.model)

    def __repr__(self) -> str:
        values = np.linalg.eigvals(self.model.a)
        fast = values[np.argmax(np.abs(values))]
        return (
            f"LinearMotion of {self.model.vehicle or self.model.origin} at {self.model.airspeed:.2f} m/s:"
            f" short period {abs(fast):.2f} rad/s, damping {-fast.real / abs(fast):.2f}"
        )


def state_space(a: NDArray[np.float64], b: NDArray[np.float64], states: tuple[str, ...], name: str) -> StateSpace:
    """Return a python-control `StateSpace` with named states as outputs and one named input."""
    import control  # takes 0.4 s

    size, named = len(states), list(states)
    matrices = a, np.reshape(b, (-1, 1)), np.eye(size), np.zeros((size, 1))
    return control.ss(*matrices, states=named, inputs=[name], outputs=named)


def _vehicle(vehicle: str | Path | Vehicle, aerodynamics: str | None) -> Vehicle:
    loaded = vehicle if isinstance(vehicle, Vehicle) else load_vehicle(vehicle)
    return loaded if aerodynamics is None else loaded._replace(world=with_model(loaded.world, aerodynamics))


def trim(
    vehicle: str | Path | Vehicle,
    airspeed: float | None = None,
    climb_rate: float | None = None,
    *,
    aerodynamics: str | None = None,
) -> SteadyFlight:
    """Find the trimmed flight at an airspeed and a climb rate.

    Args:
        vehicle: name, folder or loaded vehicle.
        airspeed: m/s (default: cruise).
        climb_rate: m/s, positive up (default: that of the cruise).
        aerodynamics: model of the wings (default: that of the vehicle file).

    Raises:
        InputError: unknown vehicle or model, or no such flight within the limits of the vehicle.
    """
    chosen = _vehicle(vehicle, aerodynamics)
    cruise = chosen.world.cruise
    speed = cruise.airspeed if airspeed is None else airspeed
    climb = cruise.climb_rate if climb_rate is None else climb_rate
    return SteadyFlight(chosen, find_orbit(chosen.world, speed, climb))


def linearize(
    vehicle: str | Path | Vehicle | SteadyFlight,
    airspeed: float | None = None,
    climb_rate: float | None = None,
    *,
    aerodynamics: str | None = None,
) -> LinearMotion:
    """Linearize the stroke-averaged motion about a trimmed flight; arguments as `trim`.

    Raises:
        InputError: unknown vehicle or model, or no such flight within the limits of the vehicle.
    """
    steady = (
        vehicle
        if isinstance(vehicle, SteadyFlight)
        else trim(vehicle, airspeed, climb_rate, aerodynamics=aerodynamics)
    )
    world, orbit = steady.vehicle.world, steady.orbit
    axes = axes_model(world, orbit, stroke_averaged_model(world, orbit))
    return LinearMotion(model_of(world, orbit, axes)._replace(vehicle=steady.vehicle.name))
