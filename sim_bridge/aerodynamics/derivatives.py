"""Stroke-averaged loads linear in the motion, as identified in flight tests (Malladi Eq. 26 to 28).

About a steady flight at the airspeed (u_0, w_0) with the elevator at delta_0 the aircraft as a whole accelerates by

    f_x = f_x0 + X_u (u - u_0) + X_w (w - w_0) + X_q q + X_delta (delta - delta_0) + X_drive s,

the same for f_z (Z) and the pitch acceleration (M, which has no trim value); f_y, roll and yaw acceleration by
Y, L, N of v, p, r and the rudder. u, v, w are the speeds of the centre of mass through the air, s is how much faster
than in the trim the wings flap: the relative change of the root mean square of the flap rate, which rises with the
half stroke and with the frequency alike, behind a first-order lag. The loads are these accelerations times mass and
inertia, at the stroke's mean centre of mass, over the density of the flight test.

The wings flap with their own inertia and meet no air: the air loads over a stroke are in the derivatives, stated in
the fuselage. So the body shakes as it does, phase and encoders are those of flapping wings, and the average is the
model's; torque, current and power of the drives are those of the inertia alone. The membranes ought to be stiff
(`wing.twists` false), for no air damps them. Tail, fins and fuselage are in the derivatives too.

Range: straight lines end somewhere. The speeds are held at `REACH` of the trim's airspeed from it, the rates at
`RATE_REACH`; beyond an airspeed of that reach the loads grow and fade with the dynamic pressure, so that they
are finite anywhere and nothing at rest.
"""

from __future__ import annotations

import math
from typing import Annotated, NamedTuple

import numpy as np

from sim_bridge.aerodynamics.protocol import AerodynamicModel, Motion, SectionLoads, Strips
from sim_bridge.compiled import inlined, kernel
from sim_bridge.vectors import Floats
from wingbeat.errors import InputError
from wingbeat.units import Quantity

REACH = 0.3
"""-; of the airspeed: w as far from its trim is an angle of attack of 17 degrees, about where wings stall (chosen)"""
RATE_REACH = 6.0
"""rad/s; above what flapping alone shakes the body with (chosen)"""
PARTS = ("longitudinal", "lateral", "drive")
LONGITUDINAL, LATERAL, DRIVE = range(len(PARTS))
ELEVATOR, RUDDER = 0, 1

PerSecond = Annotated[float, Quantity("1/s", -1e3, 1e3)]
PerSecondSquared = Annotated[float, Quantity("1/s^2", -1e4, 1e4)]
PerMetreSecond = Annotated[float, Quantity("rad/s/m", -1e3, 1e3)]
SpeedPerRadian = Annotated[float, Quantity("m/s/rad", -1e3, 1e3)]
AccelerationPerRadian = Annotated[float, Quantity("m/s^2/rad", -1e4, 1e4)]
Acceleration = Annotated[float, Quantity("m/s^2", -1e3, 1e3)]


class Derivatives(NamedTuple):
    """Section ``[derivatives]`` of a vehicle file."""

    forward: Annotated[float, Quantity("m/s", 0.5, 50.0)]
    """u_0; of the trim, of the centre of mass through the air, body axes"""
    down: Annotated[float, Quantity("m/s", -50.0, 50.0)]
    """w_0; likewise"""
    elevator: Annotated[float, Quantity("rad", -1.6, 1.6)]
    """delta_0; achieved, nose up positive"""
    force_x: Acceleration
    """f_x0; specific force of the trim"""
    force_z: Acceleration
    """f_z0; likewise, about -9.81"""
    density: Annotated[float, Quantity("kg/m^3", 0.1, 2.0)]
    """of the air in the flight test"""
    mass: Annotated[float, Quantity("kg", 1e-5, 100.0)]
    """of everything"""
    center: Annotated[tuple[float, float, float], Quantity("m", -5.0, 5.0)]
    """mean centre of mass over a stroke, from the base's origin"""
    inertia: Annotated[tuple[float, float, float, float], Quantity("kg m^2", -50.0, 50.0)]
    """of everything about that: moments xx, yy, zz, product (integral) xz; over a stroke the inverse's mean"""
    x_u: PerSecond
    x_w: PerSecond
    x_q: SpeedPerRadian
    x_delta: AccelerationPerRadian
    z_u: PerSecond
    z_w: PerSecond
    z_q: SpeedPerRadian
    z_delta: AccelerationPerRadian
    m_u: PerMetreSecond
    m_w: PerMetreSecond
    m_q: PerSecond
    m_delta: PerSecondSquared
    y_v: PerSecond
    y_p: SpeedPerRadian
    y_r: SpeedPerRadian
    y_rudder: AccelerationPerRadian
    """of the achieved rudder, nose right positive"""
    l_v: PerMetreSecond
    """rows L and N: roll and yaw acceleration, products of inertia already resolved"""
    l_p: PerSecond
    l_r: PerSecond
    l_rudder: PerSecondSquared
    n_v: PerMetreSecond
    n_p: PerSecond
    n_r: PerSecond
    n_rudder: PerSecondSquared
    x_drive: Acceleration
    """per relative change of the flap rate"""
    z_drive: Acceleration
    m_drive: PerSecondSquared
    flap_rate: Annotated[float, Quantity("rad/s", 1e-3, 1e4)]
    """root mean square in the trim, as this world's wings flap"""
    drive_lag: Annotated[float, Quantity("s", 0.01, 5.0)]
    """from the flapping to what acts"""


class Row(NamedTuple):
    """Derivatives of one force per mass or one acceleration."""

    first: float
    """as the row, per m/s; of u, or of v"""
    second: float
    """as the row, per m/s of w, or per rad/s of the roll"""
    third: float
    """as the row, per rad/s; of the pitch, or of the yaw"""
    tail: float
    """as the row, per rad; of elevator or rudder"""


class DerivativesParameters(NamedTuple):
    """Kernel arguments; SI."""

    forward: float
    """m/s; of the trim, body axes"""
    down: float
    """m/s; likewise"""
    elevator: float
    """rad; of the trim"""
    force_x: float
    """m/s^2; of the trim"""
    force_z: float
    """m/s^2; likewise"""
    density: float
    """kg/m^3; in the flight test"""
    mass: float
    """kg"""
    center_x: float
    """m; from the base's origin"""
    center_y: float
    """m"""
    center_z: float
    """m"""
    inertia_xx: float
    """kg m^2; about the centre of mass"""
    inertia_yy: float
    """kg m^2"""
    inertia_zz: float
    """kg m^2"""
    inertia_xz: float
    """kg m^2; product (integral)"""
    x: Row
    """m/s^2; along the body's x"""
    z: Row
    """m/s^2; along the body's z"""
    m: Row
    """rad/s^2; in pitch"""
    y: Row
    """m/s^2; along the body's y"""
    l: Row  # noqa: E741 - the field's own letter of the rolling moment
    """rad/s^2; in roll"""
    n: Row
    """rad/s^2; in yaw"""
    x_drive: float
    """m/s^2; per relative change of the flap rate, as the two below"""
    z_drive: float
    """m/s^2"""
    m_drive: float
    """rad/s^2"""
    flap_rate: float
    """rad/s; root mean square in the trim"""
    drive_lag: float
    """s"""


class Accelerations(NamedTuple):
    """Accelerations of the aircraft by the air, body axes."""

    x: float
    """m/s^2; specific force, as y and z"""
    y: float
    """m/s^2"""
    z: float
    """m/s^2"""
    roll: float
    """rad/s^2; as pitch and yaw"""
    pitch: float
    """rad/s^2"""
    yaw: float
    """rad/s^2"""


class Regressors(NamedTuple):
    """Regressors of the derivatives, limited to their range."""

    forward: float
    """m/s; from the trim's"""
    down: float
    """m/s; from the trim's"""
    side: float
    """m/s"""
    roll: float
    """rad/s"""
    pitch: float
    """rad/s"""
    yaw: float
    """rad/s"""
    scale: float
    """-; of the loads: density and, beyond the reach, dynamic pressure, over those of the trim and the reach"""


def build(settings: Derivatives, strips: Strips) -> DerivativesParameters:
    """Build the kernel arguments.

    Raises:
        InputError: an inertia that no body has.
    """
    xx, yy, zz, xz = settings.inertia
    if min(xx, yy, zz) <= 0.0 or xz * xz >= xx * zz:
        raise InputError("derivatives.inertia is of no body: xx, yy, zz must be above 0 and xz^2 below xx zz")
    s = settings
    return DerivativesParameters(
        s.forward, s.down, s.elevator, s.force_x, s.force_z, s.density, s.mass, *s.center, xx, yy, zz, xz,
        x=Row(s.x_u, s.x_w, s.x_q, s.x_delta),
        z=Row(s.z_u, s.z_w, s.z_q, s.z_delta),
        m=Row(s.m_u, s.m_w, s.m_q, s.m_delta),
        y=Row(s.y_v, s.y_p, s.y_r, s.y_rudder),
        l=Row(s.l_v, s.l_p, s.l_r, s.l_rudder),
        n=Row(s.n_v, s.n_p, s.n_r, s.n_rudder),
        x_drive=s.x_drive, z_drive=s.z_drive, m_drive=s.m_drive, flap_rate=s.flap_rate, drive_lag=s.drive_lag,
    )  # fmt: skip


def check(settings: Derivatives, airspeed: float) -> None:
    """Check the airspeed in m/s against the range of the model.

    Raises:
        InputError: farther than `REACH` from the trim's.
    """
    identified = math.hypot(settings.forward, settings.down)
    if abs(airspeed - identified) > REACH * identified:
        raise InputError(
            f"derivatives hold within {100 * REACH:.0f} % of {identified:.3g} m/s, the airspeed they were identified "
            f"at, not at {airspeed:g} m/s"
        )


def initial(parameters: DerivativesParameters, strips: Strips) -> Floats:
    """Return the lagged mean square of the flap rate in rad^2/s^2: 0, wings at rest."""
    return np.zeros(1)


@kernel
def saturate(value: float, reach: float) -> float:
    """Limit ``value`` to ``reach`` on both sides."""
    return min(max(value, -reach), reach)


@kernel
def regressors(p: DerivativesParameters, motion: Motion, density: float) -> Regressors:
    """Return the regressors: the motion of the center of mass through the air, relative to the trim."""
    v, w = motion.body[0:3], motion.body[3:6]
    forward = v[0] + w[1] * p.center_z - w[2] * p.center_y
    side = v[1] + w[2] * p.center_x - w[0] * p.center_z
    down = v[2] + w[0] * p.center_y - w[1] * p.center_x
    airspeed = math.sqrt(p.forward * p.forward + p.down * p.down)
    reach = REACH * airspeed
    speed = math.sqrt(forward * forward + side * side + down * down)
    within = min(max(speed, airspeed - reach), airspeed + reach)
    return Regressors(
        saturate(forward - p.forward, reach),
        saturate(down - p.down, reach),
        saturate(side, reach),
        saturate(w[0], RATE_REACH),
        saturate(w[1], RATE_REACH),
        saturate(w[2], RATE_REACH),
        density / p.density * (speed / within) ** 2,
    )


@kernel
def row(r: Row, first: float, second: float, third: float, tail: float) -> float:
    """Sum of derivatives times regressors."""
    return r.first * first + r.second * second + r.third * third + r.tail * tail


@inlined
def loads(
    parameters: DerivativesParameters,
    strips: Strips,
    motion: Motion,
    density: float,
    state: Floats,
    out: SectionLoads,
) -> None:
    """Fill ``out.body``; strips carry no load, see `sim_bridge.aerodynamics.protocol`."""
    p, r = parameters, regressors(parameters, motion, density)
    elevator, rudder = motion.tail[ELEVATOR] - p.elevator, motion.tail[RUDDER]
    faster = math.sqrt(max(state[0], 0.0)) / p.flap_rate - 1.0
    along = Accelerations(
        p.force_x + row(p.x, r.forward, r.down, r.pitch, elevator),
        0.0,
        p.force_z + row(p.z, r.forward, r.down, r.pitch, elevator),
        0.0,
        row(p.m, r.forward, r.down, r.pitch, elevator),
        0.0,
    )
    across = Accelerations(
        0.0,
        row(p.y, r.side, r.roll, r.yaw, rudder),
        0.0,
        row(p.l, r.side, r.roll, r.yaw, rudder),
        0.0,
        row(p.n, r.side, r.roll, r.yaw, rudder),
    )
    put(p, r.scale, along, out.body[LONGITUDINAL])
    put(p, r.scale, across, out.body[LATERAL])
    put(p, r.scale * faster, Accelerations(p.x_drive, 0.0, p.z_drive, 0.0, p.m_drive, 0.0), out.body[DRIVE])
    out.rates[0] = (mean_square_rate(motion) - state[0]) / p.drive_lag


@kernel
def put(p: DerivativesParameters, scale: float, a: Accelerations, out: Floats) -> None:
    """Fill ``out`` (6,) N, N m with ``scale`` times ``a`` as a load about the base's origin."""
    fx, fy, fz = scale * p.mass * a.x, scale * p.mass * a.y, scale * p.mass * a.z
    out[0], out[1], out[2] = fx, fy, fz
    out[3] = scale * (p.inertia_xx * a.roll - p.inertia_xz * a.yaw) + p.center_y * fz - p.center_z * fy
    out[4] = scale * p.inertia_yy * a.pitch + p.center_z * fx - p.center_x * fz
    out[5] = scale * (p.inertia_zz * a.yaw - p.inertia_xz * a.roll) + p.center_x * fy - p.center_y * fx


@kernel
def mean_square_rate(motion: Motion) -> float:
    """Mean square of the wings' flap rates in rad^2/s^2."""
    total, wings = 0.0, motion.wings.shape[0]
    for w in range(wings):
        total += motion.wings[w, 1] * motion.wings[w, 1]
    return float(total / wings)


@kernel
def advance(
    parameters: DerivativesParameters, strips: Strips, motion: Motion, density: float, state: Floats, dt: float
) -> None:
    """Do nothing: the drive lag is part of the integrated state."""


MODEL = AerodynamicModel(
    name="derivatives",
    title="Stroke-averaged derivatives about a trim (Malladi et al. 2007, Eq. 26 to 28), as a flight test gives them",
    settings=Derivatives,
    parameters=DerivativesParameters,
    parts=PARTS,
    build=build,
    initial=initial,
    loads=loads,
    advance=advance,
    with_fuselage=True,
    with_tail=True,
)
