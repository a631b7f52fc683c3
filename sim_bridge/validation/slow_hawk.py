"""Grauer, Ulrich, Hubbard, Pines, Humbert 2011: the Slow Hawk of `sim_bridge/vehicles/slow_hawk.toml`, flown.

What moves when its wings do (II, Fig. 2), the trimmed flight of V.A in strip theory, and Table 1 in the same flight.
The paper prints neither inertia tensors nor hinges, planform, twist or drive: most values of V.A went into
choosing them and is no validation; the vehicle file names each value that was fitted.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from scipy.optimize import brentq
from scipy.spatial.transform import Rotation

from sim_bridge.aerodynamics.regression import COLUMNS, Regression, level_heave
from sim_bridge.flight_mechanics.excursions import Excursions, excursions
from sim_bridge.flight_mechanics.orbit import Orbit, trim, trim_stroke
from sim_bridge.flight_mechanics.prescribed import SLOW_HAWK_STROKE as PRINTED
from sim_bridge.flight_mechanics.prescribed import Stroke
from sim_bridge.flight_mechanics.stroke_map import INTERVALS, StrokeMap
from sim_bridge.mechanism import all_parts, total_mass, wing_strips
from sim_bridge.multibody.tree import inertia_matrix
from sim_bridge.validation.row import Check, Row, compare, compare_share, figure, fitted, unreproducible
from sim_bridge.vectors import Floats
from sim_bridge.vehicles import SimulatedVehicle, load_vehicle, with_model
from sim_bridge.vehicles.bodies import matrix_of
from wingbeat.atmosphere import SEA_LEVEL_DENSITY
from wingbeat.constants import STANDARD_GRAVITY
from wingbeat.errors import InputError

VEHICLE = "slow_hawk"
SPEED = 9.2
"""m/s; V.A"""
HEAVE, PITCH_RATE, ACCELERATION, ALTITUDE = 2.0, 3.0, 8.9, 0.08
"""m/s, rad/s, g, m; peak to peak, V.A"""
MASSES = {"fuselage": 0.765, "wings": 0.186, "tail": 0.049}
"""-; fractions of 0.45 kg, II"""
TRAVEL, VARIATION = 0.03, 0.54
"""m, -; of the center of mass and of the moments of inertia over the stroke, Fig. 2"""
TOWS = (-0.12, -0.08)
"""m^2; limits of the drag area of the tow in Table 1's flight"""
SHAKING = "with its inertia, hinge, twist, camber and suction the vehicle was fitted to it"
SINUSOID = "fitted with the others; 2.0 m/s peak to peak at 5.91 Hz, if sinusoidal, are 0.054 m: both cannot be met"
GEOMETRY = "the four-bar was chosen for it; rods that give and a crank that turns unevenly are what is left"
MASS_DATA = "inertia and hinges are not printed: chosen for it"
SIGN = "sign and zero of the printed angle are not told"
PITCHING = "the printed 3.0 rad/s peak to peak are 0.04 rad about the mean at 5.91 Hz, if sinusoidal"
TOWED = "in the mean the printed C_T brakes: lift and pitch are in balance, the speed is held by this tow"


class MassProperties(NamedTuple):
    """Mass properties of the whole vehicle at one flap angle."""

    mass: float
    """kg"""
    center: Floats
    """(3,) m; from the base's origin, body axes"""
    inertia: Floats
    """(3, 3) kg m^2; about the centre of mass"""


def mass_properties(vehicle: SimulatedVehicle, flap: float) -> MassProperties:
    """Compute mass, center of mass and inertia with both wings at ``flap`` rad, all else at zero (Grauer Fig. 2)."""
    pieces = [*_bodies(vehicle, flap), *_membrane(vehicle, flap)]
    mass = sum(piece.mass for piece in pieces)
    center = np.sum([piece.mass * piece.center for piece in pieces], axis=0) / mass
    inertia = np.sum([_about(piece, center) for piece in pieces], axis=0)
    return MassProperties(mass, center, inertia)


def _bodies(vehicle: SimulatedVehicle, flap: float) -> list[MassProperties]:
    found = []
    for name, part in all_parts(vehicle).items():
        place, turn = _frame(vehicle, name, flap)
        tensor = turn @ inertia_matrix(part.inertia) @ turn.T
        found.append(MassProperties(part.mass, place + turn @ np.array(part.center), tensor))
    return found


def _membrane(vehicle: SimulatedVehicle, flap: float) -> list[MassProperties]:
    (strips, masses), wing = wing_strips(vehicle.wing), vehicle.wing
    frames = [_frame(vehicle, body, flap) for body in (wing.left, wing.right)]
    found = []
    for i, mass in enumerate(masses.tolist()):
        right, half, twist = int(strips.wing[i]), 0.5 * strips.chord[i], wing.washout * strips.eta[i]
        across = strips.span[i] if right else -strips.span[i]
        place, turn = frames[right]
        middle = np.array([-half * np.cos(twist), across, half * np.sin(twist)])
        found.append(MassProperties(mass, place + turn @ middle, np.zeros((3, 3))))
    return found


def _frame(vehicle: SimulatedVehicle, name: str, flap: float) -> tuple[Floats, Floats]:
    """Return position (3,) m and axes (3, 3) of a body in base axes."""
    part = all_parts(vehicle)[name]
    if not part.parent:
        return np.zeros(3), np.eye(3)
    place, turn = _frame(vehicle, part.parent, flap)
    angle = flap if name in (vehicle.wing.left, vehicle.wing.right) else 0.0
    joint = Rotation.from_rotvec(angle * np.array(part.axis)).as_matrix()
    return place + turn @ np.array(part.place), turn @ matrix_of(part.rotation) @ joint


def _about(piece: MassProperties, center: Floats) -> Floats:
    arm = piece.center - center
    return np.asarray(piece.inertia + piece.mass * (arm @ arm * np.eye(3) - np.outer(arm, arm)))


def center_travel(vehicle: SimulatedVehicle) -> float:
    """Compute the vertical travel in m of the center of mass over the printed stroke."""
    return float(np.ptp([mass_properties(vehicle, flap).center[2] for flap in _angles()]))


def inertia_variations(vehicle: SimulatedVehicle) -> Floats:
    """Compute (3,) -; range of each moment of inertia over the printed stroke, relative to its minimum."""
    moments = np.array([np.diag(mass_properties(vehicle, flap).inertia) for flap in _angles()])
    return np.asarray(np.ptp(moments, axis=0) / moments.min(axis=0))


def _angles() -> Floats:
    return np.linspace(PRINTED.lowest, PRINTED.highest, 31)


def mass_shares(vehicle: SimulatedVehicle) -> dict[str, float]:
    """Return the mass fractions, by the names of `MASSES`."""
    parts, whole = all_parts(vehicle), total_mass(vehicle)
    wings = 2.0 * vehicle.wing.membrane_mass + parts["right_wing"].mass + parts["left_wing"].mass
    tail = parts["elevator"].mass + parts["rudder"].mass
    return {"fuselage": parts["fuselage"].mass / whole, "wings": wings / whole, "tail": tail / whole}


def mass_rows() -> list[Row]:
    """Compare masses and planform of II, and Fig. 2."""
    vehicle = load_vehicle(VEHICLE)
    shares = mass_shares(vehicle)
    strips, _ = wing_strips(vehicle.wing)
    area = float(strips.chord @ strips.width)
    return [
        *(compare(figure("II", f"mass share of the {n}", "-", v), shares[n], 5e-4) for n, v in MASSES.items()),
        compare_share(figure("II", "wing area", "m^2", 0.3), area, 0.005),
        fitted(figure("Fig. 2a", "travel of the centre of mass", "m", TRAVEL), center_travel(vehicle), MASS_DATA),
        fitted(
            figure("Fig. 2b", "greatest variation of a moment of inertia", "-", VARIATION),
            float(inertia_variations(vehicle).max()),
            MASS_DATA,
        ),
    ]


def simulated_stroke(vehicle: SimulatedVehicle, orbit: Orbit) -> Stroke:
    """Return the stroke of motor and linkage in flight, with phases as fractions of the period."""
    stroke = StrokeMap(vehicle)
    stroke.unpack(orbit.state, orbit.inputs)
    flap, rate = np.zeros(INTERVALS + 1), np.zeros(INTERVALS + 1)
    place = stroke.plant.layout.flap[1]
    for i in range(INTERVALS + 1):
        flap[i], rate[i] = stroke.plant.y[place], stroke.plant.y[stroke.plant.layout.rate(place)]
        stroke.plant.advance(stroke.controls(i % INTERVALS, orbit.inputs), stroke.around)
    top, bottom = (int(np.flatnonzero((s * rate[:-1] > 0.0) & (s * rate[1:] <= 0.0))[0]) for s in (1.0, -1.0))
    turns = [(i + rate[i] / (rate[i] - rate[i + 1])) / INTERVALS for i in (top, bottom)]
    return Stroke(orbit.inputs.frequency, float(flap.max()), float(flap.min()), float(turns[0]), float(turns[1]))


def trimmed() -> tuple[SimulatedVehicle, Orbit]:
    """Compute the flight of V.A.

    Raises:
        InputError: there is no trim.
    """
    vehicle = load_vehicle(VEHICLE)
    return vehicle, trim(vehicle, SPEED, 0.0)


def flight_rows() -> list[Row]:
    """Compare the trimmed flight of V.A with strip theory."""
    vehicle, orbit = trimmed()
    return [*_shaking(excursions(vehicle, orbit)), *_stroke_rows(vehicle, orbit)]


def _shaking(moved: Excursions) -> list[Row]:
    numbers = (
        ("heave speed", "m/s", HEAVE, float(np.ptp(moved.heave_speed)), SHAKING),
        ("pitch rate", "rad/s", PITCH_RATE, float(np.ptp(moved.pitch_rate)), SHAKING),
        (
            "vertical acceleration",
            "g",
            ACCELERATION,
            float(np.ptp(moved.vertical_acceleration)) / STANDARD_GRAVITY,
            SHAKING,
        ),
        ("altitude", "m", ALTITUDE, moved.altitude, SINUSOID),
    )
    pitch = figure("V.A", "pitch about its mean", "rad", 0.02)
    return [
        *(
            fitted(figure("V.A", f"{name}, peak to peak", unit, v), computed, why)
            for name, unit, v, computed, why in numbers
        ),
        unreproducible(pitch, 0.5 * float(np.ptp(moved.pitch)), PITCHING),
    ]


def _stroke_rows(vehicle: SimulatedVehicle, orbit: Orbit) -> list[Row]:
    flown = simulated_stroke(vehicle, orbit)
    drive = "drag area and motor were chosen for frequency and throttle"
    numbers = (
        ("highest wing angle", "rad", PRINTED.highest, flown.highest, GEOMETRY),
        ("lowest wing angle", "rad", PRINTED.lowest, flown.lowest, GEOMETRY),
        ("beginning of the down-stroke", "T", PRINTED.down_from, flown.down_from, GEOMETRY),
        ("end of the down-stroke", "T", PRINTED.down_to, flown.down_to, GEOMETRY),
        ("flapping frequency", "Hz", PRINTED.frequency, flown.frequency, drive),
        ("throttle", "-", 0.77, orbit.inputs.throttle, drive),
    )
    elevator = unreproducible(figure("V.A", "elevator", "rad", -0.12), orbit.inputs.elevator, SIGN)
    return [
        *(fitted(figure("V.A", name, unit, v), computed, why) for name, unit, v, computed, why in numbers),
        elevator,
    ]


def towed(vehicle: SimulatedVehicle, column: str) -> tuple[Orbit, float]:
    """Compute level flight at V.A's speed and frequency by a column of Table 1, and its tow force in N.

    The mechanism flies freely with lift and pitching moment in balance. The tow acts along the flight path at the
    fuselage's center of mass; the wings do not twist, because the regression has no twisting loads.

    Raises:
        InputError: the lift of the column is below the weight within the recorded heave speeds, or there is no orbit.
    """
    settings: Regression = vehicle.sections["regression"]._replace(column=column)
    pressure = 0.5 * SEA_LEVEL_DENSITY * SPEED**2
    level_heave(settings, SPEED, total_mass(vehicle) * STANDARD_GRAVITY / (pressure * settings.area))
    rigid = vehicle.wing._replace(twists=False, twist_stiffness=0.0, twist_damping=0.0)
    sections = vehicle.sections | {"regression": settings}
    flown = with_model(vehicle._replace(wing=rigid, sections=sections), "regression")

    stroke = StrokeMap(flown)

    def orbit(area: float) -> Orbit:
        # The plant has no fuselage drag of its own, see `AerodynamicModel.with_fuselage`.
        pull = np.array([area, 0.0])
        stroke.plant.parameters = stroke.plant.parameters._replace(drag_areas=pull)
        return trim_stroke(stroke, SPEED, 0.0)

    area = float(brentq(lambda trial: orbit(trial).inputs.frequency - PRINTED.frequency, *TOWS, xtol=1e-5))
    return orbit(area), -area * pressure


def regression_rows() -> list[Row]:
    """Compare both columns of Table 1 in the flight of V.A."""
    return [row for column in COLUMNS for row in _regression_rows(column)]


def _regression_rows(column: str) -> list[Row]:
    where = f"Table 1, {column} domain, flown"
    thrust = figure(where, "tow that level flight needs", "N", 0.0)
    elevator = figure(where, "elevator of the towed flight", "rad", -0.12)
    try:
        orbit, tow = towed(load_vehicle(VEHICLE), column)
    except InputError as refusal:
        return [unreproducible(thrust, None, f"refused: {refusal}")]
    return [unreproducible(thrust, tow, TOWED), unreproducible(elevator, orbit.inputs.elevator, SIGN)]


CHECKS = (
    Check("Slow Hawk: masses", mass_rows),
    Check("Slow Hawk: trimmed flight", flight_rows, slow=True),
    Check("Slow Hawk: Table 1 in flight", regression_rows, slow=True),
)
