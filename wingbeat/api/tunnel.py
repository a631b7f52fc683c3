"""Recorded wing motion in an air stream."""

from __future__ import annotations

from pathlib import Path

from sim_bridge.flight_mechanics.recorded_motion import load_motion
from sim_bridge.flight_mechanics.tunnel import DENSITY, AirStream, TunnelForces, tunnel_forces, tunnel_subject
from wingbeat.api.vehicles import Vehicle, load_vehicle

__all__ = ["TunnelForces", "tunnel"]


def tunnel(
    kinematics: Path | str,
    vehicle: str | Path | Vehicle | None = None,
    *,
    wing: Path | str | None = None,
    aerodynamics: str | None = None,
    airspeed: float | None = None,
    climb_rate: float = 0.0,
    pitch: float = 0.0,
    density: float = DENSITY,
    frequency: float | None = None,
    harmonics: int | None = None,
) -> TunnelForces:
    """Compute the forces of recorded wing motion, the body fixed in an air stream.

    Args:
        kinematics: table (.csv) or Fourier coefficients (.toml), see ``wingbeat tunnel --help``.
        vehicle: name, folder or loaded vehicle whose wings move.
        wing: wing file, instead of a vehicle.
        aerodynamics: model (default: that of the vehicle).
        airspeed: m/s (default: cruise of the vehicle).
        climb_rate: m/s, up positive.
        pitch: rad, nose up.
        density: kg/m^3.
        frequency: Hz; of a table that repeats itself.
        harmonics: number fitted to a table.

    Raises:
        InputError: unknown vehicle or model, or a file that cannot be read.
    """
    loaded = vehicle if vehicle is None or isinstance(vehicle, Vehicle) else load_vehicle(vehicle)
    world = None if loaded is None else loaded.world
    wings, model, speed = tunnel_subject(world, None if wing is None else Path(wing), aerodynamics, airspeed)
    motion = load_motion(Path(kinematics), list(wings.wings), frequency, harmonics)
    return tunnel_forces(wings, motion, model, AirStream(speed, climb_rate, pitch, density))
