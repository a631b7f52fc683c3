"""Sections of a vehicle file of the simulator; the flight computer has its own assumptions."""

from __future__ import annotations

from typing import Annotated, NamedTuple

from wingbeat.units import Quantity
from wingbeat.vehicle_file import Label

Metres = Annotated[float, Quantity("m", -3.0, 3.0)]
Radians = Annotated[float, Quantity("rad", -1.6, 1.6)]


class BodyPart(NamedTuple):
    """A rigid body, ``[bodies.NAME]``, and the joint it hangs on; a body without a parent is the base.

    Axes FRD where all joints are at zero; the base's origin is the vehicle's.
    """

    parent: Annotated[str, Label()] = ""
    """name of the body it hangs on"""
    mirror_of: Annotated[str, Label()] = ""
    """a body of the right side of which this is the mirror image on the left: only its parent is given"""
    moved_by: Annotated[str, Label()] = ""
    """what turns the joint: "right_wing", "left_wing" (the drive), "elevator", "rudder" (a servo that it follows),
    "stroke" (the motion prescribed below); nothing but its spring if empty"""
    place: Annotated[tuple[float, float, float], Quantity("m", -5.0, 5.0)] = (0.0, 0.0, 0.0)
    """of the joint, in the parent's axes"""
    rotation: Annotated[tuple[float, float, float], Quantity("rad", -3.2, 3.2)] = (0.0, 0.0, 0.0)
    """roll, pitch, yaw of the body's axes to the parent's where the joint is at zero"""
    axis: Annotated[tuple[float, float, float], Quantity("-", -1.0, 1.0)] = (0.0, 0.0, 0.0)
    """of the joint's positive turn, in the body's axes; a fixed joint has none"""
    mass: Annotated[float, Quantity("kg", 0.0, 50.0)] = 0.0
    center: Annotated[tuple[float, float, float], Quantity("m", -5.0, 5.0)] = (0.0, 0.0, 0.0)
    """centre of mass, from the joint"""
    inertia: Annotated[tuple[float, float, float, float, float, float], Quantity("kg m^2", -50.0, 50.0)] = (
        0.0, 0.0, 0.0, 0.0, 0.0, 0.0,
    )  # fmt: skip
    """about the centre of mass: moments xx, yy, zz, products (integrals) xy, xz, yz"""
    stiffness: Annotated[float, Quantity("N m/rad", 0.0, 1e4)] = 0.0
    """of a spring that pulls the joint to zero"""
    damping: Annotated[float, Quantity("N m s/rad", 0.0, 1e3)] = 0.0
    """of the joint"""
    motion: Annotated[tuple[float, ...], Quantity("rad", -3.2, 3.2)] = ()
    """prescribed by the stroke's phase: mean, then cosine and sine of each harmonic"""
    motion_by_elevator: Annotated[float, Quantity("-", -5.0, 5.0)] = 0.0
    """shift of the mean of a prescribed motion by the elevator command"""
    motion_by_rudder: Annotated[float, Quantity("-", -5.0, 5.0)] = 0.0
    """shift of the mean of a prescribed motion by the rudder command, opposite on the mirror image"""


class Fuselage(NamedTuple):
    """What the base is to the air, the ground and the sensors."""

    drag_area: Annotated[float, Quantity("m^2", 0.0, 2.0)]
    """drag over dynamic pressure, along the fuselage"""
    side_area: Annotated[float, Quantity("m^2", 0.0, 2.0)]
    """drag over dynamic pressure, across the fuselage"""
    imu_position: Annotated[tuple[float, float, float], Quantity("m", -2.0, 2.0)]
    """of the IMU, from the base's origin"""
    contact_nose: Metres
    """x of the foremost contact point"""
    contact_tail: Metres
    """x of the rearmost contact point"""
    contact_below: Annotated[float, Quantity("m", 0.0, 2.0)]
    """z of the contact points: how far the belly is below the origin"""


class Wing(NamedTuple):
    """Two mirrored wings: strips behind a straight leading edge, on a body each; the membrane may twist."""

    right: Annotated[str, Label()]
    """body that carries the right wing: leading edge along its y axis, chord along x"""
    left: Annotated[str, Label()]
    """body that carries the left wing"""
    semispan: Annotated[float, Quantity("m", 0.005, 5.0)]
    """hinge to tip"""
    root_chord: Annotated[float, Quantity("m", 0.001, 2.0)]
    """greatest chord"""
    planform: str
    """"raven" (Gerdes Eq. 1) or "ellipse" (elliptic chord)"""
    membrane_mass: Annotated[float, Quantity("kg", 0.0, 10.0)]
    """of one wing, at mid-chord; spars belong to the body"""
    washout: Radians
    """built-in twist of the tip, leading edge up is positive"""
    twists: bool
    """whether the membrane turns about the leading edge, linearly from root to tip"""
    twist_stiffness: Annotated[float, Quantity("N m/rad", 0.0, 1e4)]
    """of the membrane against tip twist"""
    twist_damping: Annotated[float, Quantity("N m s/rad", 0.0, 1e3)]
    """structural, of the tip twist rate"""
    strips: Annotated[int, Quantity("-", 4, 60)]
    """a wing is cut into"""


class Plate(NamedTuple):
    """A flat surface, ``[plates.NAME]``: tail or fin; it moves with its body."""

    body: Annotated[str, Label()]
    """that carries it; chord along its x axis"""
    place: Annotated[tuple[float, float, float], Quantity("m", -5.0, 5.0)]
    """of the aerodynamic centre, from the body's joint"""
    normal: Annotated[tuple[float, float, float], Quantity("-", -1.0, 1.0)]
    """in the body's axes"""
    area: Annotated[float, Quantity("m^2", 0.0, 2.0)]
    lift_slope: Annotated[float, Quantity("1/rad", 0.5, 7.0)]


class TailServo(NamedTuple):
    """The servos of elevator and rudder."""

    travel: Annotated[float, Quantity("rad", 0.05, 1.5)]
    """greatest deflection either way"""
    time_constant: Annotated[float, Quantity("s", 0.001, 1.0)]
    rate_limit: Annotated[float, Quantity("rad/s", 0.1, 100.0)]


class Aerodynamics(NamedTuple):
    """Which model makes the loads; its values stand in the section of its name."""

    model: str


class Drive(NamedTuple):
    """What moves the wings: two position servos, one motor on a crank, or a motor model on a four-bar linkage."""

    kind: str
    """"servo" (one on each wing), "crank" (driven by the throttle) or "linkage" (sections [linkage], [motor])"""
    stall_torque: Annotated[float, Quantity("N m", 0.0, 500.0)]
    """of one wing's servo at nominal voltage"""
    no_load_speed: Annotated[float, Quantity("rad/s", 0.1, 1000.0)]
    """of one wing's servo at nominal voltage"""
    nominal_voltage: Annotated[float, Quantity("V", 0.1, 100.0)]
    position_gain: Annotated[float, Quantity("N m/rad", 0.0, 1e4)]
    rate_gain: Annotated[float, Quantity("N m s/rad", 0.0, 1e3)]
    travel: Annotated[float, Quantity("rad", 0.05, 1.6)]
    """greatest flap angle either way"""
    crank_amplitude: Annotated[float, Quantity("rad", 0.0, 1.5)]
    """half stroke of a crank drive"""
    crank_mean: Radians
    """middle of the stroke of a crank drive"""
    frequencies: Annotated[tuple[float, ...], Quantity("Hz", 0.0, 100.0)]
    """flapping frequency of a crank drive at equal steps of throttle from 0 to 1"""
    spin_time_constant: Annotated[float, Quantity("s", 0.01, 5.0)]
    """of a crank drive's speed"""
    torque_constant: Annotated[float, Quantity("N m/A", 1e-6, 10.0)]
    """K_tau of Gerdes Eq. 11: mean torque of the drives over their total current"""
    torque_offset: Annotated[float, Quantity("N m", -10.0, 10.0)]
    """K_tau0 of Gerdes Eq. 11"""
    idle_current: Annotated[float, Quantity("A", 0.0, 10.0)]
    """of one drive without torque"""
    pulse_current: Annotated[float, Quantity("A", 0.1, 200.0)]
    """of both drives together while the PWM is on"""
    pwm_frequency: Annotated[float, Quantity("Hz", 0.0, 20000.0)]
    """of the current modulation"""


class Battery(NamedTuple):
    """Open-circuit voltage falling linearly with charge drawn, behind a resistance."""

    full_voltage: Annotated[float, Quantity("V", 0.1, 100.0)]
    empty_voltage: Annotated[float, Quantity("V", 0.1, 100.0)]
    capacity: Annotated[float, Quantity("C", 1.0, 1e6)]
    resistance: Annotated[float, Quantity("ohm", 0.0, 10.0)]


class Launch(NamedTuple):
    """The hand launch."""

    height: Annotated[float, Quantity("m", 0.1, 10.0)]
    speed: Annotated[float, Quantity("m/s", 0.5, 30.0)]
    pitch: Annotated[float, Quantity("rad", -0.5, 1.0)]
    duration: Annotated[float, Quantity("s", 0.05, 2.0)]
    """of the throw"""


class Cruise(NamedTuple):
    """Steady flight at which the vehicle's modes are given."""

    airspeed: Annotated[float, Quantity("m/s", 0.5, 50.0)]
    climb_rate: Annotated[float, Quantity("m/s", -5.0, 5.0)]
    stroke_amplitude: Annotated[float, Quantity("rad", 0.0, 1.5)]
    """half of the commanded stroke (servo drives)"""
    stroke_mean: Radians
    """middle of the commanded stroke (servo drives)"""
    frequency: Annotated[float, Quantity("Hz", 0.5, 100.0)]
    """flapping, where the search for the trim begins"""


class AsMeasured(NamedTuple):
    """Optional ``[as_measured]``: what reproduces a measured flight where the vehicle flies with another value.

    See `sim_bridge.flight_mechanics.wing_fit`.
    """

    stall_torque: Annotated[float, Quantity("N m", 0.0, 500.0)]
    """of one wing's servo at nominal voltage, as the next"""
    no_load_speed: Annotated[float, Quantity("rad/s", 0.1, 1000.0)]
    position_gain: Annotated[float, Quantity("N m/rad", 0.0, 1e4)]
    rate_gain: Annotated[float, Quantity("N m s/rad", 0.0, 1e3)]
    twist_stiffness: Annotated[float, Quantity("N m/rad", 0.0, 1e4)]
    """of the membrane; its damping ratio stays"""
    washout: Radians
    stall_angle: Annotated[float, Quantity("rad", 0.05, 1.5)]
    """of strip theory"""
