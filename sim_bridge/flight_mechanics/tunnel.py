"""Recorded wing motion in an air stream: forces of any number of wings by any aerodynamic model.

The body is fixed in the stream. Each pair of wings (or single wing) is computed by itself: the flow of one pair does
not act on another. Conventions of the angles: `sim_bridge.flight_mechanics.prescribed`. Neither fuselage nor tail,
except in models that include them in their loads.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from pathlib import Path
from typing import Annotated, Any, NamedTuple

import numpy as np

from sim_bridge.aerodynamics.models import MODELS, find_model
from sim_bridge.aerodynamics.protocol import AerodynamicModel, Strips
from sim_bridge.flight_mechanics.prescribed import JointAngles, WingMount, joint_kinematics
from sim_bridge.flight_mechanics.recorded_motion import RecordedMotion
from sim_bridge.flight_mechanics.similarity import (
    RangeExcess,
    SimilarityNumbers,
    range_excesses,
    similarity_numbers,
)
from sim_bridge.flight_mechanics.stroke_loads import body_loads, lift_and_thrust, stroke_loads
from sim_bridge.mechanism import all_parts, wing_strips
from sim_bridge.vectors import Floats
from sim_bridge.vehicles import SimulatedVehicle
from sim_bridge.vehicles.bodies import way_to_base
from sim_bridge.vehicles.sections import Wing
from wingbeat.errors import InputError
from wingbeat.units import Quantity
from wingbeat.vehicle_file import Label, Schema, read_vehicle_file

DENSITY = 1.225
"""kg/m^3; of air at sea level"""
SETTLING = 3
"""strokes of a periodic motion until a model's memory is periodic; the last one counts"""
SIDES = {"both": (0.0, 1.0), "left": (0.0,), "right": (1.0,)}
"""indices of the wings of a pair"""
WAKE_STEPS = 20
"""fewest steps of a wake per stroke"""
ROUNDING = 1e-12
"""-; lateral force over the greatest force that counts as none"""
MINUTE = 1e-12
"""N, N m; loads that count as none"""


class TunnelWing(NamedTuple):
    """Section ``[wings.NAME]`` of a wing file: one wing, or two mirrored ones."""

    semispan: Annotated[float, Quantity("m", 1e-4, 20.0)]
    """hinge to tip"""
    root_chord: Annotated[float, Quantity("m", 1e-5, 10.0)]
    """greatest chord"""
    stroke_plane: Annotated[float, Quantity("rad", -3.2, 3.2)]
    """relative to the body's x-y plane: 0 sweeps fore and aft, pi/2 flaps up and down"""
    planform: str = "ellipse"
    """"ellipse" (elliptic chord) or "raven" (Gerdes Eq. 1)"""
    chords: Annotated[tuple[float, ...], Quantity("m", 0.0, 10.0)] = ()
    """chord at equal steps of span from hinge to tip, instead of a planform"""
    hinge: Annotated[tuple[float, float, float], Quantity("m", -10.0, 10.0)] = (0.0, 0.0, 0.0)
    """of the right wing, body axes"""
    axis: Annotated[float, Quantity("-", 0.0, 1.0)] = 0.25
    """feathering axis, in chords behind the leading edge"""
    strips: Annotated[int, Quantity("-", 2, 200)] = 20
    """of a wing"""
    washout: Annotated[float, Quantity("rad", -1.6, 1.6)] = 0.0
    """built-in twist of the tip, leading edge up is positive"""
    side: Annotated[str, Label()] = "both"
    """"both", "left" or "right\""""


class WingFile(NamedTuple):
    """Wings and the settings of aerodynamic models."""

    title: str
    wings: dict[str, TunnelWing]
    settings: dict[str, Any]
    """of aerodynamic models, by name"""
    source: str
    """name of the vehicle or path of the file, for error messages"""


class AirStream(NamedTuple):
    """Stream and attitude of the body in it."""

    airspeed: float
    """m/s"""
    climb_rate: float = 0.0
    """m/s; vertical part of the body's velocity through the air, up positive"""
    pitch: float = 0.0
    """rad; of the body, nose up positive"""
    density: float = DENSITY
    """kg/m^3"""


class TunnelForces(NamedTuple):
    """Forces of all wings; arrays (N,) at equal steps."""

    time: Floats
    """s"""
    lift: Floats
    """N; vertical, up"""
    thrust: Floats
    """N; horizontal, forward"""
    side: Floats
    """N; to the right"""
    pitch_moment: Floats
    """N m; about the body's origin, nose up"""
    by_wing: dict[str, tuple[float, float]]
    """N; mean lift and thrust of each wing or pair"""
    numbers: dict[str, SimilarityNumbers]
    """of each wing or pair"""
    excesses: tuple[RangeExcess, ...]
    """numbers outside the range of the model"""


SCHEMA = Schema({}, {model.name: model.settings for model in MODELS.values()}, {"wings": TunnelWing})


def load_wings(path: Path) -> WingFile:
    """Read a wing file: ``[wings.NAME]`` sections and sections of aerodynamic models, each value with its source.

    Raises:
        InputError: unreadable file, no wing, unknown key, or a value out of range.
    """
    file = read_vehicle_file(path, SCHEMA)
    wings: dict[str, TunnelWing] = file.sections["wings"]
    if not wings:
        raise InputError(f"{path}: no wing: a section [wings.NAME] is missing")
    for name, wing in wings.items():
        if wing.side not in SIDES:
            raise InputError(f'{path}: wings.{name}.side = "{wing.side}" must be one of {", ".join(SIDES)}')
        if wing.planform not in ("ellipse", "raven"):
            raise InputError(f'{path}: wings.{name}.planform = "{wing.planform}" must be "ellipse" or "raven"')
        if len(wing.chords) == 1 or (wing.chords and max(wing.chords) <= 0.0):
            raise InputError(f"{path}: wings.{name}.chords needs two values or more, one of them above 0")
    settings = {name: value for name, value in file.sections.items() if name != "wings"}
    return WingFile(file.title, wings, settings, str(path))


def wings_of_vehicle(vehicle: SimulatedVehicle) -> WingFile:
    """Return the pair of wings of a vehicle, named ``wing``, and its settings.

    The stroke plane is the nose-down complement of the pitch of the wing's joints; the feathering axis is where the
    leading edge lies ahead of the last joint, over the mean chord.
    """
    parts, wing = all_parts(vehicle), vehicle.wing
    chain = list(way_to_base(parts, wing.right))
    pitch = sum(parts[name].rotation[1] for name in chain)
    ahead = sum(parts[name].place[0] for name in chain[:-1])
    strips, _ = wing_strips(wing)
    chord = float(np.sum(strips.chord * strips.width)) / (2.0 * wing.semispan)
    pair = TunnelWing(
        wing.semispan,
        wing.root_chord,
        0.5 * math.pi - pitch,
        wing.planform,
        hinge=parts[chain[-1]].place,
        axis=ahead / chord,
        strips=wing.strips,
        washout=wing.washout,
    )
    settings = {name: vehicle.sections[name] for name in MODELS if name in vehicle.sections}
    return WingFile(vehicle.title, {"wing": pair}, settings, vehicle.name)


def tunnel_subject(
    vehicle: SimulatedVehicle | None, wing_file: Path | None, model: str | None, airspeed: float | None
) -> tuple[WingFile, str, float]:
    """Return wings, model and airspeed in m/s; a vehicle has defaults for model and airspeed.

    Raises:
        InputError: unknown model, invalid wing file, neither or both of vehicle and wing file, or a wing file without
            model or airspeed.
    """
    if (vehicle is None) == (wing_file is None):
        raise InputError("either a vehicle or a wing file is needed")
    if vehicle is not None:
        name = model or vehicle.aerodynamics.model
        find_model(name)
        return wings_of_vehicle(vehicle), name, vehicle.cruise.airspeed if airspeed is None else airspeed
    assert wing_file is not None
    if model is None:
        raise InputError("a wing file needs an aerodynamic model: --aerodynamics, or aerodynamics in Python")
    if airspeed is None:
        raise InputError("a wing file needs an airspeed: --airspeed, or airspeed in Python")
    find_model(model)
    return load_wings(wing_file), model, airspeed


def strips_of_pair(wing: TunnelWing) -> Strips:
    """Divide a pair of wings into strips, left wing first."""
    if not wing.chords:
        shape = Wing(
            "right", "left", wing.semispan, wing.root_chord, wing.planform, 0.0, 0.0, False, 0.0, 0.0, wing.strips
        )
        return wing_strips(shape)[0]
    fine = (np.arange(wing.strips * 40) + 0.5) / (wing.strips * 40)
    chord = (
        np.interp(fine, np.linspace(0.0, 1.0, len(wing.chords)), wing.chords).reshape(wing.strips, -1).mean(axis=1)
    )
    eta = (np.arange(wing.strips) + 0.5) / wing.strips
    width = np.full(2 * wing.strips, wing.semispan / wing.strips)
    index = np.repeat((0.0, 1.0), wing.strips)
    return Strips(np.tile(eta * wing.semispan, 2), np.tile(eta, 2), np.tile(chord, 2), width, index)


def tunnel_forces(file: WingFile, motion: RecordedMotion, model_name: str, stream: AirStream) -> TunnelForces:
    """Compute the forces of all wings over the recorded motion.

    A periodic motion is repeated `SETTLING` times for a model with memory; another one starts with the memory at
    rest.

    Raises:
        InputError: unknown model or one without settings in the file, wings without motion, a climb above the
            airspeed, or a model that holds for none of the wings.
    """
    model = find_model(model_name)
    if model.name not in file.settings:
        known = ", ".join(file.settings) or "none"
        raise InputError(f"{file.source} has no section [{model.name}]; it has {known}")
    if (model.with_tail or model.with_fuselage) and len(file.wings) > 1:
        raise InputError(f"{model.name} gives the loads of a whole vehicle: it takes one pair of wings")
    if model.keeps_wake and file.settings[model.name].rate < WAKE_STEPS * motion.stroke_rate:
        raise InputError(
            f"{model.name}.rate = {file.settings[model.name].rate:g} Hz is less than {WAKE_STEPS} steps of the wake"
            f" per stroke of {motion.stroke_rate:g} Hz"
        )
    missing = [name for name in file.wings if name not in motion.angles]
    if missing:
        raise InputError(f"{motion.source} has no motion of {', '.join(missing)}; it has {', '.join(motion.angles)}")
    if abs(stream.climb_rate) > stream.airspeed:
        raise InputError(f"{stream.airspeed:g} m/s does not climb {stream.climb_rate:g} m/s")
    force, moment = np.zeros((len(motion.time), 3)), np.zeros((len(motion.time), 3))
    by_wing, numbers = {}, {}
    excesses: dict[str, RangeExcess] = {}
    for name, wing in file.wings.items():
        loads = _pair_loads(model, file.settings[model.name], wing, motion, motion.angles[name], stream)
        mean = lift_and_thrust(loads[:, :3].mean(axis=0), stream.pitch)
        by_wing[name] = float(mean.lift), float(mean.thrust)
        found = similarity_numbers(
            strips_of_pair(wing), stream.airspeed, float(np.ptp(motion.angles[name].stroke[0])), motion.stroke_rate
        )
        numbers[name] = found
        for one in range_excesses(model, found):
            excesses.setdefault(one.quantity, one)
        force, moment = force + loads[:, :3], moment + loads[:, 3:]
    # Mirrored wings leave a lateral force of rounding errors.
    force[:, 1] = np.where(np.abs(force[:, 1]) > ROUNDING * np.max(np.abs(force)), force[:, 1], 0.0)
    whole = lift_and_thrust(force, stream.pitch)
    return TunnelForces(
        motion.time,
        np.asarray(whole.lift),
        np.asarray(whole.thrust),
        force[:, 1],
        moment[:, 1],
        by_wing,
        numbers,
        tuple(excesses.values()),
    )


def _pair_loads(
    model: AerodynamicModel,
    settings: Any,
    wing: TunnelWing,
    motion: RecordedMotion,
    angles: JointAngles,
    stream: AirStream,
) -> Floats:
    """Return (N, 6) force in N and moment in N m of the wings of one section, body axes."""
    strips = strips_of_pair(wing)
    built = np.zeros_like(angles.twist)
    built[0] = wing.washout
    mount = WingMount(wing.stroke_plane, wing.axis, wing.hinge)
    kinematics = joint_kinematics(
        angles._replace(twist=angles.twist + built), mount, strips, body_velocity(stream), motion.period
    )
    parameters = model.build(settings, strips)
    loads = stroke_loads(model, parameters, strips, kinematics, stream.density, SETTLING if motion.periodic else 1)
    sections = loads.sections.sum(axis=1)
    chosen = np.isin(strips.wing, SIDES[wing.side])
    sections[:, :, ~chosen] = 0.0
    found = np.array([body_loads(one, own) for one, own in zip(kinematics.motions, sections, strict=True)])
    whole = np.concatenate((loads.force.sum(axis=1), loads.moment.sum(axis=1)), axis=1)
    if chosen.all():
        return whole
    every = np.array(
        [body_loads(one, own) for one, own in zip(kinematics.motions, loads.sections.sum(axis=1), strict=True)]
    )
    if np.max(np.abs(whole - every)) > MINUTE:
        raise InputError(
            f"{model.name} gives the loads of both wings together: a wing of one side needs another model"
        )
    return found


def body_velocity(stream: AirStream) -> Floats:
    """Return (6,): velocity of the body through the air in m/s, body axes, and no angular velocity."""
    ahead = math.sqrt(max(stream.airspeed**2 - stream.climb_rate**2, 0.0))
    c, s = math.cos(stream.pitch), math.sin(stream.pitch)
    return np.array([c * ahead + s * stream.climb_rate, 0.0, s * ahead - c * stream.climb_rate, 0.0, 0.0, 0.0])


def measured_means(motion: RecordedMotion) -> Mapping[str, float]:
    """Return the means of the measured forces in N, by name."""
    return {name: float(np.mean(values)) for name, values in motion.measured.items()}
