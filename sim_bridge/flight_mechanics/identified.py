"""The world of an identified aircraft: another vehicle's bodies and drive, flown with derivatives of a flight test.

What the flight test did not give is taken from that vehicle, linearized at the same airspeed, and marked as chosen:
the lateral derivatives, and what the drive does.
"""

from __future__ import annotations

import json
import math
from collections.abc import Callable
from typing import Any, NamedTuple, get_args, get_type_hints

import numpy as np

from sim_bridge.aerodynamics.derivatives import MODEL, Derivatives
from sim_bridge.flight_mechanics.averaged import stroke_averaged_model
from sim_bridge.flight_mechanics.averaged_axes import axes_model
from sim_bridge.flight_mechanics.orbit import Orbit, trim
from sim_bridge.flight_mechanics.stroke_map import INTERVALS, StrokeMap
from sim_bridge.tuning.model import DriveModel, Identified, LateralModel, LinearModel, model_of
from sim_bridge.vectors import Floats
from sim_bridge.vehicles import SimulatedVehicle
from wingbeat.atmosphere import SEA_LEVEL_DENSITY

SETTLING, AVERAGED = 4, 3
"""-; strokes until the wing motion is periodic, and strokes of the average"""
LEAST_LAG = 0.05
"""s; minimum lag of the drive: a shorter one would pass the flapping frequency"""
DIGITS = 6
LONGITUDINAL = tuple(f"{axis}_{follows}" for axis in "xzm" for follows in ("u", "w", "q", "delta"))
LATERAL = tuple(f"{axis}_{follows}" for axis in "yln" for follows in ("v", "p", "r", "rudder"))
DRIVE = ("x_drive", "z_drive", "m_drive", "flap_rate", "drive_lag")


class Whole(NamedTuple):
    """Mean properties of the aircraft over a stroke."""

    mass: float
    """kg"""
    center: Floats
    """(3,) m; mean center of mass, from the base's origin"""
    inertia: Floats
    """(3, 3) kg m^2; about it; the inverse of the mean inverse"""
    flap_rate: float
    """rad/s; root mean square"""


class IdentifiedWorld(NamedTuple):
    """Data of a vehicle file of the world."""

    values: Derivatives
    sources: dict[str, str]
    """source of each value: published, identified or chosen, with the reason"""
    notes: tuple[str, ...]
    """values taken from the base, one sentence each"""
    frequency: float
    """Hz; flapping frequency in the flight test, initial value of trim searches"""
    stroke_amplitude: float
    """rad; command of the base's trim at the speed of the flight test, likewise"""


def identified_world(
    model: LinearModel, base: SimulatedVehicle, on_progress: Callable[[int, int], None] = lambda done, of: None
) -> IdentifiedWorld:
    """Combine the derivatives of an identified ``model`` with the bodies of ``base``.

    ``on_progress`` is called during the linearization with flights done and their number.

    Raises:
        InputError: the model is not from an identification, or the base has no steady flight at its airspeed.
    """
    estimates = model.from_log()
    orbit = trim(base, model.airspeed, model.airspeed * math.sin(model.pitch - estimates.angle_of_attack))
    vehicle_values = None
    if model.lateral is None or model.drive is None:
        averaged = stroke_averaged_model(base, orbit, lambda done, of: on_progress(done, of + 1))
        vehicle_values = model_of(base, orbit, axes_model(base, orbit, averaged))
    values = _longitudinal(model, estimates)
    whole = _whole(base, values, orbit)
    values = values._replace(
        mass=whole.mass,
        center=(_round(whole.center[0]), 0.0, _round(whole.center[2])),
        inertia=_inertia(whole.inertia),
        flap_rate=_round(whole.flap_rate),
    )
    if vehicle_values is not None:
        vehicle_values = _at_centre(vehicle_values, whole.center)
    lateral, drive = model.lateral or _given(vehicle_values).lateral, model.drive or _given(vehicle_values).drive
    assert lateral is not None and drive is not None
    values = _with_drive(_with_lateral(values, lateral), drive, base)
    sources, notes = _sources(model, estimates, base), _notes(model, base)
    return IdentifiedWorld(values, sources, notes, model.frequency, _round(orbit.inputs.amplitude))


def _inertia(matrix: Floats) -> tuple[float, float, float, float]:
    """Return xx, yy, zz and the product xz, which has the opposite sign in the matrix (3, 3)."""
    return _round(matrix[0, 0]), _round(matrix[1, 1]), _round(matrix[2, 2]), _round(-matrix[0, 2])


def _given(vehicle_values: LinearModel | None) -> LinearModel:
    assert vehicle_values is not None
    return vehicle_values


def _round(value: float) -> float:
    return float(f"{value:.{DIGITS}g}")


def _longitudinal(model: LinearModel, estimates: Identified) -> Derivatives:
    """Return the longitudinal derivatives that the model contains; the others are zero."""
    forward = model.airspeed * math.cos(estimates.angle_of_attack)
    down = model.airspeed * math.sin(estimates.angle_of_attack)
    # The other elements of A are kinematics and gravity, about the same trim.
    kinematics = np.zeros((3, 3))
    kinematics[0, 2], kinematics[1, 2] = -down, forward
    rows = np.column_stack((model.a[:3, :3] - kinematics, model.elevator[:3]))
    named = dict(zip(LONGITUDINAL, (_round(value) for value in rows.ravel()), strict=True))
    gravity = -model.a[0, 3] / math.cos(model.pitch)
    blank = dict.fromkeys((*LATERAL, *DRIVE[:3]), 0.0)
    return Derivatives(
        forward=_round(forward),
        down=_round(down),
        elevator=_round(estimates.elevator),
        force_x=_round(gravity * math.sin(model.pitch)),
        force_z=_round(-gravity * math.cos(model.pitch)),
        density=SEA_LEVEL_DENSITY if estimates.density is None else _round(estimates.density),
        mass=1.0,
        center=(0.0, 0.0, 0.0),
        inertia=(1.0, 1.0, 1.0, 0.0),
        flap_rate=1.0,
        drive_lag=LEAST_LAG,
        **named,
        **blank,
    )


def _whole(base: SimulatedVehicle, values: Derivatives, orbit: Orbit) -> Whole:
    """Return mass, mean center, inertia and flap rate in vacuum at the base's trim command."""
    stroke = StrokeMap(simulate_with(base, values))
    start = stroke.start(orbit.inputs)
    start[:4] = values.forward, values.down, 0.0, orbit.means.pitch
    stroke.unpack(start, orbit.inputs)
    inertias, rates, layout = [], [], stroke.plant.layout
    flapping = [layout.rate(place) for place in layout.flap]
    for piece in range((SETTLING + AVERAGED) * INTERVALS):
        # Supported by the launcher, so that loads do not accelerate an aircraft of still unknown mass.
        around = stroke.around._replace(launcher=0)
        stroke.plant.advance(stroke.controls(piece % INTERVALS, orbit.inputs), around)
        inertias.append(stroke.plant.scratch.tree.inertia[0].copy())
        rates.append(stroke.plant.y[flapping] ** 2)
    last = slice(SETTLING * INTERVALS, None)
    parts = [_about_centre(inertia) for inertia in inertias[last]]
    inverse = np.mean([np.linalg.inv(inertia) for _, _, inertia in parts], axis=0)
    center = np.mean([center for _, center, _ in parts], axis=0)
    center[1] = 0.0
    return Whole(_round(parts[0][0]), center, np.linalg.inv(inverse), float(np.sqrt(np.mean(np.array(rates[last])))))


def _about_centre(spatial: Floats) -> tuple[float, Floats, Floats]:
    """Return mass, center and inertia (3, 3) about it of a spatial inertia (6, 6) about the origin."""
    mass = float(spatial[3, 3])
    center = np.array([spatial[2, 4], spatial[0, 5], spatial[1, 3]]) / mass
    return mass, center, spatial[:3, :3] - mass * (center @ center * np.eye(3) - np.outer(center, center))


def simulate_with(base: SimulatedVehicle, values: Derivatives) -> SimulatedVehicle:
    """Return the vehicle with rigid wings and these derivatives."""
    return base._replace(
        sections=base.sections | {MODEL.name: values},
        aerodynamics=base.aerodynamics._replace(model=MODEL.name),
        wing=base.wing._replace(twists=False),
    )


def _at_centre(model: LinearModel, center: Floats) -> LinearModel:
    """Transform the speeds of the model from the base's origin to the center of mass."""
    along, across = np.eye(4), np.eye(4)
    along[0, 2], along[1, 2] = center[2], -center[0]
    across[0, 1], across[0, 2] = -center[2], center[0]
    drive, lateral = model.drive, model.lateral
    assert drive is not None and lateral is not None
    return model._replace(
        drive=drive._replace(b=along @ drive.b),
        lateral=LateralModel(across @ lateral.a @ np.linalg.inv(across), across @ lateral.rudder),
    )


def _with_lateral(values: Derivatives, lateral: LateralModel) -> Derivatives:
    kinematics = np.zeros((3, 3))
    kinematics[0, 1], kinematics[0, 2] = values.down, -values.forward
    rows = np.column_stack((lateral.a[:3, :3] - kinematics, lateral.rudder[:3]))
    named: dict[str, Any] = dict(zip(LATERAL, (_round(value) for value in rows.ravel()), strict=True))
    return values._replace(**named)


def _with_drive(values: Derivatives, drive: DriveModel, base: SimulatedVehicle) -> Derivatives:
    """Return the drive derivatives per relative change of the flap rate, which is proportional to stroke and
    frequency.
    """
    relative = drive.at if base.drive.kind != "crank" else _frequency_share(drive.at, base.drive.frequencies)
    x, z, m = (_round(value * relative) for value in drive.b[:3])
    return values._replace(x_drive=x, z_drive=z, m_drive=m, drive_lag=_round(max(drive.lag, LEAST_LAG)))


def _frequency_share(throttle: float, frequencies: tuple[float, ...]) -> float:
    """Return the change of throttle that changes a crank's frequency by its own value."""
    places = np.linspace(0.0, 1.0, len(frequencies))
    at = float(np.interp(throttle, places, frequencies))
    ahead, behind = (
        float(np.interp(np.clip(throttle + side, 0.0, 1.0), places, frequencies)) for side in (0.02, -0.02)
    )
    width = float(np.clip(throttle + 0.02, 0.0, 1.0) - np.clip(throttle - 0.02, 0.0, 1.0))
    return at * width / (ahead - behind) if ahead > behind else 0.0


def _sources(model: LinearModel, estimates: Identified, base: SimulatedVehicle) -> dict[str, str]:
    log = f"{estimates.log}, {estimates.method}"
    vehicle_values = (
        f"chosen: not identified; {base.name} with {base.aerodynamics.model}, linearised at {model.airspeed:.3g} m/s"
    )
    bodies = f"chosen: the bodies of {base.name}, over a stroke"
    trim_of = f"identified: {estimates.log}, mean over the manoeuvres"
    errors = {value.name.lower(): value for value in estimates.values}
    sources = dict.fromkeys(("forward", "down", "elevator"), trim_of)
    sources |= dict.fromkeys(("force_x", "force_z"), f"{trim_of}: steady flight at that pitch")
    air = "chosen: sea level; the log does not tell" if estimates.density is None else f"identified: {estimates.log}"
    sources |= {"density": air} | dict.fromkeys(("mass", "center", "inertia"), bodies)
    for key in LONGITUDINAL:
        known = errors.get(key)
        given = f", standard error {known.standard_error:.2g}" if known else ""
        sources[key] = f"identified: {log}{given}"
    sources |= dict.fromkeys(LATERAL, vehicle_values if model.lateral is None else f"identified: {estimates.log}")
    sources |= dict.fromkeys(DRIVE, vehicle_values if model.drive is None else f"identified: {estimates.log}")
    sources["flap_rate"] = f"chosen: {base.name}'s wings without air, at its trim's command"
    return sources


def _notes(model: LinearModel, base: SimulatedVehicle) -> tuple[str, ...]:
    missing = [
        name for name, part in (("lateral derivatives", model.lateral), ("drive", model.drive)) if part is None
    ]
    vehicle_values = f"{base.name} with {base.aerodynamics.model}"
    return tuple(f"{name} of the world: not identified, those of {vehicle_values}" for name in missing)


def world_text(world: IdentifiedWorld, name: str, title: str, base: str) -> str:
    """Format a vehicle file of the world with the derivatives and ``base`` (a name, or a file beside it)."""
    hints = get_type_hints(Derivatives, include_extras=True)
    lines = [
        "# An identified aircraft: the bodies and the drive of its base, the air loads of a flight test.",
        f"name = {json.dumps(name)}",
        f"title = {json.dumps(title)}",
        f"base = {json.dumps(base)}",
        "",
        "[aerodynamics]",
        'model = { value = "derivatives", source = "chosen: what was identified" }',
        "",
        "[wing]",
        'twists = { value = false, source = "chosen: wings that meet no air have none to damp their membranes" }',
        "",
        "[cruise]",
        f'airspeed = {{ value = {_round(math.hypot(world.values.forward, world.values.down))!r}, unit = "m/s",'
        f" source = {json.dumps(world.sources['forward'])} }}",
        f'frequency = {{ value = {_round(world.frequency)!r}, unit = "Hz",'
        f" source = {json.dumps(world.sources['forward'])} }}",
        f'stroke_amplitude = {{ value = {world.stroke_amplitude!r}, unit = "rad",'
        f" source = {json.dumps(f'chosen: command of the trim of {base}')} }}",
        "",
        "[derivatives]",
    ]
    for key, value in world.values._asdict().items():
        unit = get_args(hints[key])[1].unit
        given = json.dumps(list(value)) if isinstance(value, tuple) else repr(float(value))
        lines.append(f'{key} = {{ value = {given}, unit = "{unit}", source = {json.dumps(world.sources[key])} }}')
    return "\n".join(lines) + "\n"
