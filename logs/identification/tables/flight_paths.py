"""[path] of a map: biases and scales of the sensors from records whose kinematics must be those of one motion."""

from __future__ import annotations

from collections.abc import Mapping
from typing import NamedTuple

import numpy as np

from logs.identification.data.experiment import Experiment
from logs.identification.data.resampling import whole_records
from logs.identification.estimators.flight_path.reconstruction import Reconstruction, Setup, reconstruct
from logs.identification.estimators.flight_path.records import LEAST_SAMPLES
from logs.identification.estimators.flight_path.result import fitted_path, input_names, path_chapter
from logs.identification.estimators.flight_path.sensors import LONGITUDINAL_INPUTS, UNITS, WINDS, Places
from logs.identification.models.rigid_body import INPUTS
from logs.identification.results import Array, EstimationResult, Information, from_fitted
from logs.identification.sources.table.maneuvers import Cut
from logs.identification.sources.table.signals import LONGEST_FILL
from wingbeat.constants import STANDARD_GRAVITY
from wingbeat.errors import InputError
from wingbeat.schema import check_known
from wingbeat.text import pluralize

EXAMPLE = """\
# Biases and scales of the sensors: wingbeat identify FLIGHT.csv --map THIS.toml path
[time]
column = "t"                 # or rate = 50.0 (Hz) where the rows have no time
fill = 0.1                   # s; gaps of rates and accelerations up to that are bridged, at longer ones it is cut

[signals]                    # V and the rates and accelerations must be there, of the others what there is
p = { column = "p", unit = "deg/s" }
q = { column = "q", unit = "deg/s" }
r = { column = "r", unit = "deg/s" }
a_x = { column = "ax", unit = "g" }                  # specific forces, body axes: a_z is -1 g at rest
a_y = { column = "ay", unit = "g" }
a_z = { column = "az", unit = "g" }
V = { column = "tas", unit = "kn" }
alpha = { column = "aoa", unit = "deg" }
beta = { column = "aos", unit = "deg" }
phi = { column = "roll", unit = "deg" }
theta = { column = "pitch", unit = "deg" }
psi = { column = "yaw", unit = "deg" }
altitude = { column = "alt", unit = "ft" }           # climb_rate, north, east (m) too

[manoeuvres]
windows = [[10, 40], [60, 90]]
validate = [2]               # predicted with the errors maneuvers from the others

[path]
longitudinal = false         # true: u, w, theta and altitude alone, from q, a_x and a_z, wings level
also = ["scale_q"]           # beyond the usual: biases of rates and accelerations, bias and scale of the vanes, wind
known = []                   # errors that are zero, as "bias_a_y"
[path.places]                # m from the centre of mass, x forward, y right, z down
imu = [0.1, 0.0, -0.05]
airspeed = [1.2, 0.0, 0.0]
alpha = [1.5, 0.4, 0.1]
beta = [1.5, -0.4, 0.1]
"""


class PathSection(NamedTuple):
    """Section [path]."""

    longitudinal: bool | None = None
    """where one of p, r and a_y is not told when not given"""
    also: tuple[str, ...] = ()
    known: tuple[str, ...] = ()
    places: Places = Places()
    """m; the IMU's is that of the constants imu_x, imu_y, imu_z where not given"""
    input_noise: dict[str, float] = {}
    """SI; standard deviation of the white noise by input; by the records where not given"""


def path_fit(
    section: PathSection, maneuvers: Cut, constants: Mapping[str, float], fill: float | None
) -> list[EstimationResult]:
    """The reconstruction over all manoeuvres, and what its errors make of those that were held out.

    Raises:
        InputError: an input or the airspeed is not there, or no stretch without a gap is long enough.
    """
    setup, notes = _setup(section, tuple(maneuvers.fitted[0].signals), constants)
    fitted = _records(maneuvers.fitted, setup.longitudinal, fill, notes)
    if not fitted:
        raise InputError("path: " + "; ".join(notes))
    held = _records(maneuvers.held_out, setup.longitudinal, fill, notes)
    result = _with_level_wings(reconstruct(fitted, setup), fitted, setup.longitudinal)
    told = fitted_path(fitted, result, setup, held)
    told = told._replace(notes=(*notes, *_unknown_bank(fitted, result, setup.longitudinal), *told.notes))
    chapter = path_chapter(fitted, result)
    samples = sum(len(one.time) for one in fitted)
    chapters = () if chapter is None else (chapter,)
    one = from_fitted(told, "flight_path", result.failure, subject="path", samples=samples, chapters=chapters)
    return [one]


def _nothing(maneuvers: Reconstruction, why: str) -> Reconstruction:
    return maneuvers._replace(parameters=(), tracks=(), correlation=np.zeros((0, 0)), failure=why)


def _with_level_wings(maneuvers: Reconstruction, records: list[Experiment], longitudinal: bool) -> Reconstruction:
    """The result, or nothing if the longitudinal motion alone was fitted with a measured bank that matters.

    A level turn's pitch rate ``r tan(phi)`` would be a bias of q, and what a bank takes off ``g cos(phi)`` one of
    a_z.
    """
    banked = [one for one in records if "phi" in one.signals]
    if not longitudinal or maneuvers.failure or not banked:
        return maneuvers
    phi = np.concatenate([one.signals["phi"] for one in banked])
    turning = np.concatenate([_yaw_rate(one) for one in banked]) * np.tan(phi)
    made = {"bias_q": np.nanmean(turning), "bias_a_z": STANDARD_GRAVITY * np.nanmean(1.0 - np.cos(phi))}
    for one in maneuvers.parameters:
        if abs(made.get(one.name, 0.0)) > one.high - one.value:
            why = (
                f"phi of up to {np.degrees(np.nanmax(np.abs(phi))):.0f} deg is not level: the bank alone makes"
                f" {made[one.name]:.2g} {one.unit} of {one.name}; tell p, r and a_y, or cut where the wings are level"
            )
            return _nothing(maneuvers, why)
    return maneuvers


def _unknown_bank(records: list[Experiment], maneuvers: Reconstruction, longitudinal: bool) -> tuple[str, ...]:
    """What is said where no measured bank can refute the level wings of the longitudinal motion alone.

    Of a steady bank phi a level turn pitches by ``g / V sin(phi) tan(phi)``, and g (1 - cos(phi)) is taken off a_z.
    """
    if not longitudinal or maneuvers.failure or any("phi" in one.signals for one in records):
        return ()
    half = {one.name: one.high - one.value for one in maneuvers.parameters}
    speed = float(np.nanmean(np.concatenate([one.signals["airspeed"] for one in records])))
    made = []
    if "bias_q" in half:
        # sin(phi) tan(phi) = c of cos(phi)^2 + c cos(phi) - 1 = 0
        share = half["bias_q"] * speed / STANDARD_GRAVITY
        made.append(np.arccos(min((np.sqrt(share**2 + 4.0) - share) / 2.0, 1.0)))
    if "bias_a_z" in half:
        made.append(np.arccos(np.clip(1.0 - half["bias_a_z"] / STANDARD_GRAVITY, -1.0, 1.0)))
    if not made:
        return ()
    return (
        "phi is not told: that the wings were level is not tested, and a steady bank of"
        f" {np.degrees(min(made)):.1f} deg would take bias_q or bias_a_z out of its interval",
    )


def _yaw_rate(one: Experiment) -> Array:
    """Measured (N,), or that of a coordinated turn."""
    if "r" in one.signals:
        return np.asarray(one.signals["r"], dtype=np.float64)
    speed = np.asarray(one.signals["airspeed"], dtype=np.float64)
    return np.asarray(STANDARD_GRAVITY * np.sin(one.signals["phi"]) / np.where(speed > 0.0, speed, np.nan))


def _setup(section: PathSection, signals: tuple[str, ...], constants: Mapping[str, float]) -> tuple[Setup, list[str]]:
    names = (*(f"{kind}_{channel}" for kind in ("bias", "scale") for channel in UNITS), *WINDS)
    for key in ("also", "known"):
        for name in getattr(section, key):
            check_known(name, names, f"path.{key} {name}")
    for name, value in section.input_noise.items():
        check_known(name, INPUTS, f"path.input_noise.{name}")
        if not value > 0:
            raise InputError(f"path.input_noise.{name} must be above 0")
    absent = [name for name in INPUTS if name not in signals]
    longitudinal, notes = section.longitudinal, []
    if longitudinal is None:
        longitudinal = bool(set(absent) - set(LONGITUDINAL_INPUTS))
        if longitudinal:
            said = ", ".join(name for name in absent if name not in LONGITUDINAL_INPUTS)
            notes.append(f"not told: {said}; the longitudinal motion alone, flown with level wings")
    missing = [f"signals.{name}" for name in input_names(longitudinal) if name not in signals]
    missing += [] if {"V", "airspeed"} & set(signals) else ["signals.V"]
    if missing:
        raise InputError(f"path needs {', '.join(missing)}")
    places = section.places
    if places.imu == Places().imu:
        x, y, z = (constants.get(f"imu_{axis}", 0.0) for axis in "xyz")
        places = places._replace(imu=(x, y, z))
    return Setup(longitudinal, section.also, section.known, places, section.input_noise or None), notes


def _records(
    experiments: tuple[Experiment, ...], longitudinal: bool, fill: float | None, notes: list[str]
) -> list[Experiment]:
    """Stretches of the manoeuvres without gaps in what drives the kinematics, the airspeed by its name there."""
    maneuvers: list[Experiment] = []
    for one in map(_named, experiments):
        names, gap = input_names(longitudinal), LONGEST_FILL * one.step if fill is None else fill
        lost = int(np.count_nonzero(~np.all([np.isfinite(one.signals[name]) for name in names], axis=0)))
        try:
            pieces = whole_records(one, names, gap, (LEAST_SAMPLES - 1) * one.step)
        except InputError as reason:
            notes.append(f"left out: {reason}")
            continue
        left = len(one.time) - sum(len(piece.time) for piece in pieces)
        if lost:
            said = f"{pluralize(lost, 'sample')} without {', '.join(names)}"
            notes.append(
                Information(f"{one.name}: {said}, {lost - min(left, lost)} of them bridged, {left} left out")
            )
        maneuvers += pieces
    return maneuvers


def _named(one: Experiment) -> Experiment:
    """With the airspeed as the kinematics call it; an angle that wraps counts on."""
    if "V" not in one.signals or "airspeed" in one.signals:
        return one
    signals = {("airspeed" if name == "V" else name): values for name, values in one.signals.items()}
    return one._replace(signals=signals, units={name: UNITS.get(name, one.units.get(name, "")) for name in signals})
