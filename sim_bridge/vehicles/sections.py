"""The sections of a vehicle file of the simulated world: what is, not what the flight computer believes."""

from __future__ import annotations

from typing import Annotated, NamedTuple

from avionics.quantities import Quantity

Metres = Annotated[float, Quantity("m", -3.0, 3.0)]
Radians = Annotated[float, Quantity("rad", -1.6, 1.6)]


class Body(NamedTuple):
    """Fuselage with everything that does not flap; axes FRD, origin at its centre of mass."""

    mass: Annotated[float, Quantity("kg", 0.001, 50.0)]
    """all-up mass, wings included"""
    inertia_xx: Annotated[float, Quantity("kg m^2", 1e-8, 50.0)]
    """of the fuselage alone"""
    inertia_yy: Annotated[float, Quantity("kg m^2", 1e-8, 50.0)]
    """of the fuselage alone"""
    inertia_zz: Annotated[float, Quantity("kg m^2", 1e-8, 50.0)]
    """of the fuselage alone"""
    inertia_xz: Annotated[float, Quantity("kg m^2", -50.0, 50.0)]
    """of the fuselage alone; the integral of x z dm"""
    drag_area: Annotated[float, Quantity("m^2", 0.0, 2.0)]
    """drag over dynamic pressure, along the fuselage"""
    side_area: Annotated[float, Quantity("m^2", 0.0, 2.0)]
    """drag over dynamic pressure, across the fuselage"""
    imu_position: Annotated[tuple[float, float, float], Quantity("m", -2.0, 2.0)]
    """of the IMU, from the fuselage's centre of mass"""
    contact_nose: Metres
    """x of the foremost contact point"""
    contact_tail: Metres
    """x of the rearmost contact point"""
    contact_below: Annotated[float, Quantity("m", 0.0, 2.0)]
    """z of the contact points: how far the belly is below the centre of mass"""


class Wing(NamedTuple):
    """One of two mirrored wings: a straight leading-edge spar on a flapping hinge, a membrane that twists."""

    semispan: Annotated[float, Quantity("m", 0.005, 5.0)]
    """hinge to tip"""
    root_chord: Annotated[float, Quantity("m", 0.001, 2.0)]
    """greatest chord"""
    planform: str
    """"raven" (Gerdes Eq. 1) or "ellipse" (elliptic chord)"""
    mass: Annotated[float, Quantity("kg", 0.0, 10.0)]
    """of one wing"""
    spar_fraction: Annotated[float, Quantity("-", 0.0, 1.0)]
    """share of the wing's mass on the leading-edge spar; the rest lies at mid-chord"""
    hinge_x: Metres
    """of the hinge and leading edge, ahead of the fuselage's centre of mass"""
    hinge_y: Annotated[float, Quantity("m", 0.0, 1.0)]
    """of the hinge, from the plane of symmetry"""
    hinge_z: Metres
    """of the hinge, below the fuselage's centre of mass"""
    incidence: Radians
    """of the flapping axis to the fuselage, leading edge up"""
    washout: Radians
    """built-in twist of the tip, leading edge up is positive"""
    twist_stiffness: Annotated[float, Quantity("N m/rad", 0.0, 1e4)]
    """of the membrane against tip twist"""
    twist_damping: Annotated[float, Quantity("N m s/rad", 0.0, 1e3)]
    """structural, of the tip twist rate"""
    flap_damping: Annotated[float, Quantity("N m s/rad", 0.0, 1e2)]
    """mechanical, at the hinge"""
    zero_lift_angle: Radians
    """of the section, negated: the angle that camber adds to the angle of attack"""
    suction_efficiency: Annotated[float, Quantity("-", 0.0, 1.0)]
    """share of the leading-edge suction that is realised"""
    stall_angle: Annotated[float, Quantity("rad", 0.05, 1.5)]
    """static; raised by Kim's dynamic factor"""
    wake_lag: Annotated[float, Quantity("-", 0.0, 1.0)]
    """share of the unsteady wake's effect: 1 is DeLaurier's C'(k) in the time domain, 0 quasi-steady"""
    strips: Annotated[int, Quantity("-", 4, 60)]
    """a wing is cut into"""


class Tail(NamedTuple):
    """All-moving horizontal and vertical surface behind the fuselage."""

    position_x: Metres
    """of the tail's aerodynamic centre, ahead of the fuselage's centre of mass (negative: behind)"""
    position_z: Metres
    """of the vertical surface's centre, below the fuselage's centre of mass"""
    horizontal_area: Annotated[float, Quantity("m^2", 0.0, 2.0)]
    vertical_area: Annotated[float, Quantity("m^2", 0.0, 2.0)]
    lift_slope: Annotated[float, Quantity("1/rad", 0.5, 7.0)]
    """of both surfaces"""
    incidence: Radians
    """of the horizontal surface to the fuselage, leading edge up"""
    travel: Annotated[float, Quantity("rad", 0.05, 1.5)]
    """greatest deflection either way"""
    servo_time_constant: Annotated[float, Quantity("s", 0.001, 1.0)]
    servo_rate_limit: Annotated[float, Quantity("rad/s", 0.1, 100.0)]


class Drive(NamedTuple):
    """What moves the wings: two position servos, or one motor on a crank."""

    kind: str
    """"servo" or "crank\""""
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
    """The steady flight at which the vehicle's modes are told."""

    airspeed: Annotated[float, Quantity("m/s", 0.5, 50.0)]
    climb_rate: Annotated[float, Quantity("m/s", -5.0, 5.0)]
    stroke_amplitude: Annotated[float, Quantity("rad", 0.0, 1.5)]
    """half of the commanded stroke (servo drives)"""
    stroke_mean: Radians
    """middle of the commanded stroke (servo drives)"""
    frequency: Annotated[float, Quantity("Hz", 0.5, 100.0)]
    """flapping, where the search for the trim begins"""
