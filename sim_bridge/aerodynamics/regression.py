"""Wing loads of Slow Hawk by regression on its motion (Grauer et al. 2011, Table 1).

Lift, thrust and pitching moment of both wings together, identified by equation error from three strokes of one
flight at 9.2 m/s (Eq. 14 to 19). They act on the fuselage: thrust along its x axis, lift against its z axis, the
moment about its centre of mass, which is the origin of the body axes. The tail's loads were taken out before the
regression (Eq. 13) and are added by the plant; the fuselage had none of its own there, so that its drag is in these
coefficients and the plant adds none.

As printed, the mean thrust over the stroke of V.A is negative in both columns (some 5 N of drag): lift and moment
can be balanced, the speed of that flight cannot.

Signs: v_x, v_z and omega_y are the fuselage's in body axes (forward, right, down). theta_11, the right wing's angle
about the forward axis, is positive with the wing **down**: so the lift rises with theta_11's rate in the down-stroke.

Range: the airspeed of that flight, `IDENTIFIED` (see `check`). Outside it the regressors are held at
`REACH`, so that the loads stay finite anywhere, but they mean nothing there: C_L = -1.55 at rest is no property of
the aircraft.
"""

from __future__ import annotations

from typing import Annotated, NamedTuple

import numpy as np

from sim_bridge.aerodynamics.protocol import AerodynamicModel, Motion, SectionLoads, Strips, ValidRange
from sim_bridge.compiled import inlined, kernel
from sim_bridge.vectors import Floats
from wingbeat.errors import InputError
from wingbeat.units import Quantity

MEAN_AIRSPEED = 9.2
"""m/s; of the flight, Grauer V.A"""
IDENTIFIED = (8.7, 9.7)
"""m/s; airspeeds at which the model is used: the mean and 0.5 either side (chosen: the slowest section of V.B, 8.9,
is at the root and shows how far the flight's own speed fell)"""
RECORDED_HEAVE = (-1.1, 0.9)
"""m/s; range of the heave speed in the flight, Grauer V.A, as printed"""


class Reach(NamedTuple):
    """Range of the regressors about their means."""

    forward: float
    """m/s; from MEAN_AIRSPEED"""
    heave: float
    """m/s"""
    pitch_rate: float
    """rad/s"""
    flap: float
    """rad"""
    flap_rate: float
    """rad/s"""


REACH = Reach(forward=1.0, heave=2.2, pitch_rate=3.2, flap=1.34, flap_rate=42.0)
"""twice the greatest of Grauer V.A (heave 1.1 m/s, pitch rate 1.6 rad/s, wing 0.67 rad and the rate that its stroke
needs at 5.91 Hz), and twice the half width of IDENTIFIED"""
HELD_FORWARD, HELD_HEAVE, HELD_PITCH_RATE, HELD_FLAP, HELD_FLAP_RATE = REACH


class Table(NamedTuple):
    """One column of Table 1."""

    lift_zero: float
    lift_forward: float
    """s/m; of v_x"""
    lift_heave: float
    """s/m; of v_z"""
    lift_pitch_rate: float
    """s/rad"""
    lift_flap_rate: float
    """s/rad"""
    thrust_zero: float
    thrust_flap_rate: float
    """s/rad"""
    thrust_flap_squared: float
    """1/rad^2"""
    thrust_flap_rate_squared: float
    """s^2/rad^2; the table's row is printed without its dot"""
    moment_zero: float
    moment_pitch_rate: float
    """s/rad"""
    moment_flap_rate: float
    """s/rad"""


COLUMNS = {
    "time": Table(
        -1.5507, 0.1966, 0.0575, 0.2540, 0.0311, -0.0734, -0.0068, 0.3760, -0.0012, -0.0587, -0.1132, -0.0029
    ),
    "frequency": Table(
        -1.7728, 0.3421, 0.2081, 0.3418, 0.0371, -0.0811, -0.0066, 0.1271, -0.0013, -0.0579, -0.1333, -0.0025
    ),
}
"""Table 1, by the domain of the estimation"""
PARTS = ("lift", "thrust", "moment")
LIFT, THRUST, MOMENT = range(len(PARTS))
X, Z, PITCH = 0, 2, 4


class Regression(NamedTuple):
    """Section ``[regression]`` of a vehicle file."""

    column: str
    """"time" or "frequency": the domain of the estimation, see COLUMNS"""
    area: Annotated[float, Quantity("m^2", 1e-4, 5.0)]
    """planform of both wings, S of Eq. 14"""
    chord: Annotated[float, Quantity("m", 1e-3, 3.0)]
    """c of Eq. 16"""


class RegressionParameters(NamedTuple):
    """One column with its reference area in m^2 and chord in m."""

    table: Table
    area: float
    chord: float


class Regressors(NamedTuple):
    """Regressors of Eq. 17 to 19."""

    forward: float
    """m/s; v_x of the fuselage"""
    heave: float
    """m/s; v_z of the fuselage, down positive"""
    pitch_rate: float
    """rad/s"""
    flap: float
    """rad; theta_11, wing down positive"""
    flap_rate: float
    """rad/s; of theta_11"""


class Coefficients(NamedTuple):
    """Coefficients of both wings."""

    lift: float
    thrust: float
    moment: float


class WingLoads(NamedTuple):
    """Loads of both wings on the fuselage."""

    lift: float
    """N; against the body's z axis"""
    thrust: float
    """N; along its x axis"""
    moment: float
    """N m; nose up"""


def table(settings: Regression) -> Table:
    """Return the chosen column of Table 1.

    Raises:
        InputError: there is no such column.
    """
    if settings.column not in COLUMNS:
        raise InputError(f'regression.column must be one of {", ".join(COLUMNS)}, not "{settings.column}"')
    return COLUMNS[settings.column]


def check(settings: Regression, airspeed: float) -> None:
    """Check the airspeed in m/s against the range of the model.

    Raises:
        InputError: outside `IDENTIFIED`, or no such column.
    """
    table(settings)
    low, high = IDENTIFIED
    if not low <= airspeed <= high:
        raise InputError(
            f"regression holds from {low:g} to {high:g} m/s, the speed of the flight it was identified from, "
            f"not at {airspeed:g} m/s"
        )


def carrying_heave(settings: Regression, airspeed: float, lift_coefficient: float) -> float:
    """Heave speed v_z in m/s that `level_heave` looks at, recorded or not."""
    t = table(settings)
    return (lift_coefficient - t.lift_zero - t.lift_forward * airspeed) / t.lift_heave


def level_heave(settings: Regression, airspeed: float, lift_coefficient: float) -> float:
    """Heave speed v_z in m/s at which the stroke's mean of Eq. 17, without pitch rate, is ``lift_coefficient``.

    Raises:
        InputError: the airspeed is outside the model's range, or the heave speed outside the recorded one.
    """
    check(settings, airspeed)
    heave = carrying_heave(settings, airspeed, lift_coefficient)
    low, high = RECORDED_HEAVE
    if not low <= heave <= high:
        raise InputError(
            f"regression, column {settings.column}: C_L = {lift_coefficient:.3g} at {airspeed:g} m/s needs a heave "
            f"speed of {heave:.2f} m/s, outside the recorded {low:g} to {high:g} m/s"
        )
    return heave


def build(settings: Regression, strips: Strips) -> RegressionParameters:
    """Build the kernel arguments.

    Raises:
        InputError: there is no such column.
    """
    return RegressionParameters(table(settings), settings.area, settings.chord)


def initial(parameters: RegressionParameters, strips: Strips) -> Floats:
    """Return an empty state: the loads depend on the motion alone."""
    return np.zeros(0)


@kernel
def coefficients(t: Table, r: Regressors) -> Coefficients:
    """Eq. 17 to 19."""
    return Coefficients(
        t.lift_zero
        + t.lift_forward * r.forward
        + t.lift_heave * r.heave
        + t.lift_pitch_rate * r.pitch_rate
        + t.lift_flap_rate * r.flap_rate,
        t.thrust_zero
        + t.thrust_flap_rate * r.flap_rate
        + t.thrust_flap_squared * r.flap * r.flap
        + t.thrust_flap_rate_squared * r.flap_rate * r.flap_rate,
        t.moment_zero + t.moment_pitch_rate * r.pitch_rate + t.moment_flap_rate * r.flap_rate,
    )


@kernel
def saturate(value: float, reach: float) -> float:
    """Limit ``value`` to ``reach`` on both sides."""
    return min(max(value, -reach), reach)


@kernel
def regressors(motion: Motion) -> Regressors:
    """Return the regressors, limited to `REACH`; mean flap angle of the wings with theta_11's sign."""
    flap, flap_rate, wings = 0.0, 0.0, motion.wings.shape[0]
    for w in range(wings):
        flap -= motion.wings[w, 0] / wings
        flap_rate -= motion.wings[w, 1] / wings
    return Regressors(
        MEAN_AIRSPEED + saturate(motion.body[0] - MEAN_AIRSPEED, HELD_FORWARD),
        saturate(motion.body[2], HELD_HEAVE),
        saturate(motion.body[4], HELD_PITCH_RATE),
        saturate(flap, HELD_FLAP),
        saturate(flap_rate, HELD_FLAP_RATE),
    )


@kernel
def dynamic_pressure(strips: Strips, motion: Motion, density: float) -> float:
    """Half the density times |v_mac|^2 of Eq. 14 in Pa, mean of the wings.

    A wing's velocity is linear along its span, so that the mean over its area is that at the aerodynamic centre.
    """
    total, wings = 0.0, motion.wings.shape[0]
    for w in range(wings):
        whole, along, down, outward = 0.0, 0.0, 0.0, 0.0
        for i in range(strips.chord.shape[0]):
            if int(strips.wing[i]) == w:
                area = strips.chord[i] * strips.width[i]
                whole += area
                along += area * motion.along[i]
                down += area * motion.down[i]
                outward += area * motion.outward[i]
        total += (along * along + down * down + outward * outward) / (whole * whole)
    return float(0.5 * density * total / wings)


@kernel
def wing_loads(parameters: RegressionParameters, strips: Strips, motion: Motion, density: float) -> WingLoads:
    """Loads of both wings at one instant, Eq. 14 to 16."""
    c = coefficients(parameters.table, regressors(motion))
    force = dynamic_pressure(strips, motion, density) * parameters.area
    return WingLoads(force * c.lift, force * c.thrust, force * parameters.chord * c.moment)


@inlined
def loads(
    parameters: RegressionParameters, strips: Strips, motion: Motion, density: float, state: Floats, out: SectionLoads
) -> None:
    """Fill ``out.body``; strips carry no load, see `sim_bridge.aerodynamics.protocol`."""
    wing = wing_loads(parameters, strips, motion, density)
    out.body[:, :] = 0.0
    out.body[LIFT, Z] = -wing.lift
    out.body[THRUST, X] = wing.thrust
    out.body[MOMENT, PITCH] = wing.moment


@kernel
def advance(
    parameters: RegressionParameters, strips: Strips, motion: Motion, density: float, state: Floats, dt: float
) -> None:
    """Do nothing: the model has no memory."""


RANGES = (
    ValidRange("advance_ratio", 1.1, 1.35, "Grauer 2011, V.A: one flight at 9.2 m/s, 5.91 Hz, 1.06 rad: 1.22"),
    ValidRange("reynolds", 1.5e5, 3.5e5, "Grauer 2011, V.A: one flight, 290,000"),
    ValidRange("reduced_frequency", 0.4, 0.6, "Grauer 2011, V.A: one flight, 0.50"),
    ValidRange("aspect_ratio", 4.0, 5.0, "Grauer 2011, II: 4.4; 4.8 by its span and area"),
)
MODEL = AerodynamicModel(
    name="regression",
    title="Regression on the motion (Grauer et al. 2011, Table 1), Slow Hawk at 9.2 m/s",
    settings=Regression,
    parameters=RegressionParameters,
    parts=PARTS,
    build=build,
    initial=initial,
    loads=loads,
    advance=advance,
    with_fuselage=True,
    ranges=RANGES,
)
