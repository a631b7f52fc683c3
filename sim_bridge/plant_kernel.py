"""The compiled right-hand side and integrator of the plant.

State vector: position NED 0-2, quaternion 3-6, velocity 7-9 and angular velocity 10-12 of the base in body axes, from
13 the c coordinates (joints of the tree, then tip twists) and their c rates, then crank phase, crank speed in Hz,
charge drawn in C, then the state of the aerodynamic model: see `Layout`.
"""

from __future__ import annotations

import math
import struct
from typing import NamedTuple

from sim_bridge import observation as o
from sim_bridge.actuators.drives import drive_current, servo_torque
from sim_bridge.actuators.linkage import FourBar, Motor, flap_motion
from sim_bridge.actuators.linkage import drive as motor_drive
from sim_bridge.aerodynamics import models
from sim_bridge.aerodynamics.surfaces import body_drag
from sim_bridge.compiled import (
    Bound,
    bound_values,
    clear,
    exact,
    inlined,
    inlined_internal,
    internal,
    kernel,
    noalias,
)
from sim_bridge.multibody.contact import ground_force
from sim_bridge.multibody.plates import Plates, add_plates
from sim_bridge.multibody.tree import BASE, Equations, Kinematics, Tree, add_wrench, assemble, impose, move, solve
from sim_bridge.multibody.wings import Wings, WingWork, add_wings, wing_motion, wing_places
from sim_bridge.vectors import Floats, Integers, add_scaled, rotation
from wingbeat.constants import STANDARD_GRAVITY

VOLTAGE_ROUNDS = 3
"""of torque, current and sag, see `_drive_wings`"""
COORDINATES = 13
"""index of the first coordinate in the state vector"""
LEADS, WEIGHTS = (0.0, 0.5, 0.5, 1.0), (1.0 / 6.0, 1.0 / 3.0, 1.0 / 3.0, 1.0 / 6.0)
"""of the stages of a Runge-Kutta step: how far ahead in the step, on the rate of the stage before, and share"""

# Phases of the flight as the launcher sees them.
HELD, THROWN, FREE = 0, 1, 2

# What moves a coordinate: nothing but its spring and damper, a wing's drive, a servo that its motion follows, or a
# motion prescribed by the phase of the stroke.
PASSIVE, WING, FOLLOWS, PRESCRIBED = 0, 1, 2, 3

# What drives the wings: a position servo each, a crank driven by the throttle, or a motor on a four-bar.
SERVO, CRANK, LINKAGE = 0, 1, 2

# The channels that a coordinate may be moved by.
LEFT, RIGHT, ELEVATOR, RUDDER = 0, 1, 2, 3

# Outputs in `Scratch.drive`.
TORQUE_LEFT, TORQUE_RIGHT, CURRENT, VOLTAGE = 0, 1, 2, 3


class Joints(NamedTuple):
    """How each of the c coordinates is moved and held."""

    kind: Integers
    """(c,); PASSIVE, WING, FOLLOWS or PRESCRIBED"""
    channel: Integers
    """(c,); LEFT, RIGHT, ELEVATOR or RUDDER"""
    stiffness: Floats
    """(c,) N m/rad"""
    damping: Floats
    """(c,) N m s/rad"""
    motion: Floats
    """(c, 1 + 2 h) rad; prescribed: mean, then cosine and sine of each harmonic of the stroke's phase"""
    steered: Floats
    """(c, 2) -; prescribed: shift of the mean by elevator and rudder commands"""


class PlantParameters(NamedTuple):
    """Everything the kernel needs of a vehicle; SI."""

    tree: Tree
    wings: Wings
    joints: Joints
    plates: Plates
    """none where the aerodynamic model has the tail's loads in its own"""
    air: models.Air
    """the chosen aerodynamic model"""
    needs_places: bool
    """the model requires the positions of the strips"""
    advances: bool
    """the model has a share of its state that moves between the steps"""
    drag_areas: Floats
    """(2,) m^2; along and across the fuselage, 0 where the aerodynamic model has its drag in its loads"""
    contacts: Floats
    """(n, 3) m; on the base"""
    imu: Floats
    """(3,) m; on the base"""
    tail_servo: Floats
    """(2,) time constant s, rate limit rad/s"""
    drive_kind: int
    """SERVO, CRANK or LINKAGE"""
    linkage: FourBar
    motor: Motor
    drive: Floats
    """(5,) stall torque N m, no-load speed rad/s, nominal voltage V, position gain N m/rad, rate gain N m s/rad"""
    servo_gain: Floats
    """(2,) -; wing angle over setpoint of the left and the right servo; `Controls` already contain it"""
    crank_amplitude: Floats
    """(c,) rad; of the coordinates that a crank moves"""
    crank_shape: Floats
    """(2,) mean rad, time constant s"""
    crank_frequencies: Floats
    """Hz; at equal steps of throttle"""
    current: Floats
    """(3,) torque constant N m/A, torque offset N m, idle current A"""
    battery: Floats
    """(4,) full V, empty V, capacity C, resistance ohm"""
    weight: float
    """N"""
    nose: float
    """m; pitot tube ahead of the base's origin"""


class Controls(NamedTuple):
    """Commands over one interval; the wing angles move linearly from ``_start`` to ``_end``."""

    left_start: float
    """rad; flap angle, wing up positive, as the next three; servo drives"""
    left_end: float
    right_start: float
    right_end: float
    throttle: float
    """0 to 1; crank and linkage drives"""
    elevator: float
    """rad; nose up positive"""
    rudder: float
    """rad; nose right positive"""
    duration: float
    """s"""
    powered: float
    """1 when the drives are on, 0 when they are slack"""
    conducting: float = 1.0
    """1 when the drives are armed, 0 when their controllers conduct nothing and the gears hold the wings"""


class Surroundings(NamedTuple):
    """Air and launcher over one interval."""

    wind_north: float
    """m/s; velocity of the air, NED, as the next two"""
    wind_east: float
    wind_down: float
    density: float
    """kg/m^3"""
    launcher: int
    """HELD, THROWN or FREE"""
    throw_x: float
    """m/s^2; imposed while thrown: rate of the base's velocity in body axes, as the next two"""
    throw_y: float
    throw_z: float
    turn_x: float = 0.0
    """rad/s; angular velocity of the air, body axes, as are the next two"""
    turn_y: float = 0.0
    turn_z: float = 0.0


class Scratch(NamedTuple):
    """Work space and outputs of one right-hand side."""

    mass: Floats
    """(6 + c, 6 + c); of the speeds, upper triangle"""
    load: Floats
    """(6 + c,) N, N m; after `solve` the rates of the speeds"""
    tree: Kinematics
    wings: WingWork
    outside: Floats
    """(9,) gravity m/s^2; velocity m/s and angular velocity rad/s of the air; body axes"""
    base: Floats
    """(6,) velocity m/s and angular velocity rad/s of the base, body axes"""
    work: Floats
    """(5, 3)"""
    r: Floats
    """(3, 3); r_ned_from_frd"""
    plate_load: Floats
    """(6,) N, N m; of tail and fins, body axes about the base's origin"""
    body_load: Floats
    """(6,) N, N m; of the fuselage and of the aerodynamic model on the body"""
    drive: Floats
    """(4,) torque left, right N m; current A; voltage V"""
    accelerations: Floats
    """(6 + c,); rates of the speeds"""
    is_imposed: Integers
    """(6 + c,); 1 where the rate of a speed is imposed"""
    imposed: Floats
    """(6 + c,); the rates imposed"""
    crank: Floats
    """(1,) Hz/s; rate of the crank's speed"""
    motion: Floats
    """(3,); of a prescribed coordinate, see `prescribed_motion`"""
    rate: Floats
    """(len(y),); of the state, see `derivatives`"""
    trial: Floats
    """(len(y),); the state at a stage of a step"""
    total: Floats
    """(len(y),); sum of the stages' rates"""
    means: Floats
    """(7,); over the interval, see `advance`"""
    observed: Floats
    """(`observation.SIZE`,); input of the sensors at the end of the interval, see `advance_ordered`"""


@kernel
def crank_frequency(throttle: float, table: Floats) -> float:
    """Flapping frequency in Hz of a crank drive: linear between the table's equal steps of throttle."""
    place = min(max(throttle, 0.0), 1.0) * (table.shape[0] - 1)
    low = min(int(place), table.shape[0] - 2)
    return float(table[low] + (place - low) * (table[low + 1] - table[low]))


@inlined
def _supply(charge: float, battery: Floats) -> float:
    full, empty, capacity = battery[0], battery[1], battery[2]
    return float(full + (empty - full) * min(max(charge / capacity, 0.0), 1.2))


@inlined
def _drive_wings(y: Floats, t: float, c: Controls, p: PlantParameters, s: Scratch) -> None:
    """Load the wings with their drives' torques, and return the acceleration of the crank."""
    # The torque a servo can give depends on the voltage, which sags with the current that the torque draws: from
    # the open-circuit voltage three rounds come within a millivolt.
    n = p.joints.kind.shape[0]
    charge = y[COORDINATES + 2 * n + 2]
    open_circuit = _supply(charge, p.battery)
    voltage = open_circuit
    before = last = open_circuit
    for _ in range(VOLTAGE_ROUNDS):
        _drive_torques(y, t / c.duration, max(voltage, 0.1) / p.drive[2], c, p, s)
        before, last, voltage = last, voltage, open_circuit - p.battery[3] * s.drive[CURRENT]
        if p.drive_kind == LINKAGE and last != before:
            voltage = _extrapolated(before, last, voltage)
    s.drive[VOLTAGE] = voltage
    for i in range(n):
        if p.joints.kind[i] == WING:
            s.load[BASE + i] += s.drive[p.joints.channel[i]]


@inlined
def _extrapolated(before: float, last: float, voltage: float) -> float:
    """The end of a row of voltages that shrinks by the same share each round: a motor's current is linear in it."""
    bend = voltage - 2.0 * last + before
    return voltage - (voltage - last) * (voltage - last) / bend if bend != 0.0 else voltage


@inlined
def _drive_torques(y: Floats, share: float, ratio: float, c: Controls, p: PlantParameters, s: Scratch) -> None:
    """Torques, current and the crank's acceleration at a ``share`` of the interval, by a voltage ``ratio``."""
    if p.drive_kind == LINKAGE:
        _linkage_torques(y, ratio, c, p, s)
    else:
        _servo_torques(y, share, ratio, c, p, s)


@inlined
def _servo_torques(y: Floats, share: float, ratio: float, c: Controls, p: PlantParameters, s: Scratch) -> None:
    """A position servo on each wing; of a crank drive, that of what the crank's phase wants.

    Drives that are not armed, and the motor of a crank at closed throttle, draw their idle current alone: the gears
    hold the wings, without limit, as a servo's do by friction up to the torque offset.
    """
    conducting = c.conducting > 0.0 and (p.drive_kind == SERVO or c.throttle * c.powered > 0.0)
    total, n, gains = 0.0, p.joints.kind.shape[0], (p.drive[3], p.drive[4])
    stall_torque, no_load_speed = p.drive[0] * ratio, p.drive[1] * ratio
    for i in range(n):
        if p.joints.kind[i] != WING:
            continue
        angle, rate = y[COORDINATES + i], y[COORDINATES + n + i]
        wanted, wanted_rate = _commanded(y, i, share, c, p)
        error, error_rate = wanted - angle, wanted_rate - rate
        torque = c.powered * servo_torque(error, error_rate, rate, gains, stall_torque, no_load_speed)
        loaded = drive_current(torque, p.current[0], p.current[1], p.current[2])
        total += loaded if conducting else p.current[2]
        s.drive[p.joints.channel[i]] = torque
    turned = crank_frequency(c.throttle, p.crank_frequencies) * c.powered
    s.crank[0] = (turned - y[COORDINATES + 2 * n + 1]) / p.crank_shape[1]
    s.drive[CURRENT] = total


@inlined
def _commanded(y: Floats, i: int, share: float, c: Controls, p: PlantParameters) -> tuple[float, float]:
    """Angle in rad and rate in rad/s that a wing's coordinate is to have."""
    if p.drive_kind == CRANK:
        crank = COORDINATES + 2 * p.joints.kind.shape[0]
        phase, rate = y[crank], 2.0 * math.pi * y[crank + 1]
        amplitude, mean = p.crank_amplitude[i], p.crank_shape[0]
        return mean + amplitude * math.sin(phase), amplitude * math.cos(phase) * rate
    left = p.joints.channel[i] == LEFT
    start, end = c.left_start if left else c.right_start, c.left_end if left else c.right_end
    return start + share * (end - start), (end - start) / c.duration


@inlined
def _linkage_torques(y: Floats, ratio: float, c: Controls, p: PlantParameters, s: Scratch) -> None:
    """The rods are stiff, not ideal: what they do to the wing they do, through the slope, to the crank."""
    n, reaction = p.joints.kind.shape[0], 0.0
    crank_rate = 2.0 * math.pi * y[COORDINATES + 2 * n + 1]
    flap = flap_motion(p.linkage, y[COORDINATES + 2 * n])
    for i in range(n):
        if p.joints.kind[i] == WING:
            error = flap.angle - y[COORDINATES + i]
            error_rate = flap.slope * crank_rate - y[COORDINATES + n + i]
            torque = p.drive[3] * error + p.drive[4] * error_rate
            reaction += torque * flap.slope
            s.drive[p.joints.channel[i]] = torque
    duty = min(max(c.throttle, 0.0), 1.0) * c.powered
    turning = motor_drive(p.motor, duty * ratio * p.drive[2], crank_rate)
    inertia = p.motor.rotor_inertia * p.motor.gear_ratio * p.motor.gear_ratio
    s.crank[0] = (turning.torque - reaction) / inertia / (2.0 * math.pi)
    s.drive[CURRENT] = duty * turning.current


@inlined
def set_motion(y: Floats, around: Surroundings, p: PlantParameters, s: Scratch) -> None:
    """Place and move bodies and wings, and the strips through the air."""
    n = p.joints.kind.shape[0]
    q, rates = y[COORDINATES : COORDINATES + n], y[COORDINATES + n : COORDINATES + 2 * n]
    set_outside(y, around, s)
    move(p.tree, q, rates, s.base, s.outside[0:3], s.tree)
    wing_motion(s.tree, p.wings, q, rates, s.outside, s.wings)
    _set_tail(q, p.joints, s.wings.motion.tail)
    _set_tail(rates, p.joints, s.wings.motion.tail_rate)
    if p.needs_places:
        wing_places(s.tree, p.wings, s.wings)


@inlined
def _set_tail(q: Floats, joints: Joints, tail: Floats) -> None:
    """Return elevator and rudder angles from the coordinates ``q``, or their rates."""
    for i in range(joints.kind.shape[0]):
        if joints.kind[i] == FOLLOWS:
            tail[joints.channel[i] - ELEVATOR] = q[i]


@inlined
def add_air_loads(y: Floats, density: float, p: PlantParameters, s: Scratch) -> None:
    """Add the air loads of wings, tail and fuselage; return the rates of the model's state.

    After `set_motion`.
    """
    _load_sections(y, density, p, s)
    _add_loads(density, p, s)


@inlined
def _load_sections(y: Floats, density: float, p: PlantParameters, s: Scratch) -> None:
    start = aero_start(p.joints.kind.shape[0])
    models.loads(p.air, p.wings.strips, s.wings.motion, density, y[start:], s.wings.loads)
    for i in range(y.shape[0] - start):
        s.rate[start + i] = s.wings.loads.rates[i]


@inlined
def _add_loads(density: float, p: PlantParameters, s: Scratch) -> None:
    add_wings(p.tree, s.tree, p.wings, s.wings, Equations(s.mass, s.load))
    add_plates(s.tree, p.plates, s.outside[3:9], density, s.plate_load)
    load_fuselage(density, p.drag_areas, s)


@inlined_internal
def load_fuselage(density: float, drag_areas: Floats, s: Scratch) -> None:
    """Add its drag, and the loads of the aerodynamic model on the body, to the base."""
    load_base(density, drag_areas, s.wings.motion.body, s.wings.loads.body, s.body_load, s.tree.force[0])


@noalias
def load_base(
    density: float, drag_areas: Floats, body: Floats, model_load: Floats, body_load: Floats, force: Floats
) -> None:
    """`load_fuselage` of the arrays that it is about."""
    body_drag(body[0:3], drag_areas[0], drag_areas[1], density, body_load[0:3])
    f0, f1, f2, n0, n1, n2 = body_load[0], body_load[1], body_load[2], 0.0, 0.0, 0.0
    for part in range(model_load.shape[0]):
        f0 += model_load[part, 0]
        f1 += model_load[part, 1]
        f2 += model_load[part, 2]
        n0 += model_load[part, 3]
        n1 += model_load[part, 4]
        n2 += model_load[part, 5]
    load = (f0, f1, f2, n0, n1, n2)
    body_load[0], body_load[1], body_load[2], body_load[3], body_load[4], body_load[5] = load
    force[0] -= n0
    force[1] -= n1
    force[2] -= n2
    force[3] -= f0
    force[4] -= f1
    force[5] -= f2


@inlined
def aero_start(coordinates: int) -> int:
    """Index of the aerodynamic model's state in the state vector."""
    return COORDINATES + 2 * coordinates + 3


@inlined
def _contacts(y: Floats, contacts: Floats, weight: float, s: Scratch) -> bool:
    touching = False
    if y[2] < -2.0:
        return False
    velocity, force, body, point = s.work[0], s.work[1], s.work[2], s.work[3]
    v, w = s.base[0:3], s.base[3:6]
    for k in range(contacts.shape[0]):
        px, py, pz = contacts[k, 0], contacts[k, 1], contacts[k, 2]
        depth = y[2] + s.r[2, 0] * px + s.r[2, 1] * py + s.r[2, 2] * pz
        if depth <= 0.0:
            continue
        body[0] = v[0] + w[1] * pz - w[2] * py
        body[1] = v[1] + w[2] * px - w[0] * pz
        body[2] = v[2] + w[0] * py - w[1] * px
        for i in range(3):
            velocity[i] = s.r[i, 0] * body[0] + s.r[i, 1] * body[1] + s.r[i, 2] * body[2]
        touching = ground_force(depth, velocity, weight, force) or touching
        for i in range(3):
            body[i] = s.r[0, i] * force[0] + s.r[1, i] * force[1] + s.r[2, i] * force[2]
            point[i] = contacts[k, i]
        add_wrench(s.tree, 0, point, body)
    return touching


@inlined
def set_outside(y: Floats, around: Surroundings, s: Scratch) -> None:
    """Turn attitude, gravity and the motion of the air into body axes."""
    rotation(y[3], y[4], y[5], y[6], s.r)
    for i in range(3):
        s.base[i] = y[7 + i]
        s.base[3 + i] = y[10 + i]
        s.outside[i] = s.r[2, i] * STANDARD_GRAVITY
        wind = s.r[0, i] * around.wind_north + s.r[1, i] * around.wind_east + s.r[2, i] * around.wind_down
        s.outside[3 + i] = wind
    s.outside[6], s.outside[7], s.outside[8] = around.turn_x, around.turn_y, around.turn_z


@inlined
def _add_joint_loads(y: Floats, joints: Joints, load: Floats) -> None:
    n = joints.kind.shape[0]
    for i in range(n):
        angle, rate = y[COORDINATES + i], y[COORDINATES + n + i]
        load[BASE + i] -= joints.stiffness[i] * angle + joints.damping[i] * rate


@inlined
def _impose(y: Floats, c: Controls, around: Surroundings, joints: Joints, servo: Floats, s: Scratch) -> bool:
    """Return which rates of speeds are imposed: those of the launcher, and of joints that follow a servo."""
    any_held = around.launcher != FREE
    for i in range(BASE):
        s.is_imposed[i] = 1 if any_held else 0
        s.imposed[i] = 0.0
    if around.launcher == THROWN:
        s.imposed[0], s.imposed[1], s.imposed[2] = around.throw_x, around.throw_y, around.throw_z
    n = joints.kind.shape[0]
    for i in range(n):
        s.is_imposed[BASE + i] = 0
        if joints.kind[i] == FOLLOWS:
            wanted = c.elevator if joints.channel[i] == ELEVATOR else c.rudder
            s.is_imposed[BASE + i] = 1
            s.imposed[BASE + i] = _servo_acceleration(
                wanted - y[COORDINATES + i], y[COORDINATES + n + i], servo[0], servo[1]
            )
            any_held = True
        elif joints.kind[i] == PRESCRIBED:
            s.is_imposed[BASE + i] = 1
            s.imposed[BASE + i] = _prescribed_acceleration(y, i, c, joints, servo, s)
            any_held = True
    return any_held


@kernel
def prescribed_motion(series: Floats, phase: float, out: Floats) -> None:
    """Angle in rad and its first and second derivative with the phase, (3,), of a motion as `Joints` keeps it."""
    out[0], out[1], out[2] = series[0], 0.0, 0.0
    for h in range(1, (series.shape[0] + 1) // 2):
        a, b = series[2 * h - 1], series[2 * h]
        cosine, sine = math.cos(h * phase), math.sin(h * phase)
        out[0] += a * cosine + b * sine
        out[1] += h * (b * cosine - a * sine)
        out[2] -= h * h * (a * cosine + b * sine)


@inlined
def _prescribed_acceleration(y: Floats, i: int, c: Controls, joints: Joints, servo: Floats, s: Scratch) -> float:
    """rad/s^2 of a prescribed coordinate; what steers it, and what has strayed, is made good like a servo's error."""
    n, motion = joints.kind.shape[0], s.motion
    phase, rate = y[COORDINATES + 2 * n], 2.0 * math.pi * y[COORDINATES + 2 * n + 1]
    prescribed_motion(joints.motion[i], phase, motion)
    shift = joints.steered[i, 0] * c.elevator + joints.steered[i, 1] * c.rudder
    error = motion[0] + shift - y[COORDINATES + i]
    error_rate = motion[1] * rate - y[COORDINATES + n + i]
    pull = 2.0 / servo[0]
    feedforward = motion[2] * rate * rate + motion[1] * 2.0 * math.pi * s.crank[0]
    return float(feedforward + pull * pull * error + 2.0 * pull * error_rate)


@inlined
def _servo_acceleration(error: float, rate: float, time_constant: float, rate_limit: float) -> float:
    """rad/s^2 of a position servo: a rate loop of a quarter of the time constant inside a position loop of it.

    Small errors decay critically damped, as late as a first-order lag of ``time_constant`` s. The rate command is
    limited to ``rate_limit`` rad/s.
    """
    wanted = min(max(error / time_constant, -rate_limit), rate_limit)
    return (wanted - rate) / (0.25 * time_constant)


@kernel
def derivatives(y: Floats, t: float, c: Controls, around: Surroundings, bound: Bound) -> bool:
    """Fill ``Scratch.rate`` with dy/dt at ``t`` seconds into the interval; returns whether the ground is touched.

    ``bound`` is (`PlantParameters`, `Scratch`), as in what follows.
    """
    _set_motion(y, around, bound)
    _set_loads(y, around.density, bound)
    _act(around.density, bound)
    return _accelerate(y, t, c, around, bound)


# The right-hand side is compiled in four pieces, each of which takes from `Bound` what it needs: as one, its hundreds
# of addresses would be moved to and fro all the time.


@internal
def _set_motion(y: Floats, around: Surroundings, bound: Bound) -> None:
    p, s = bound_values(bound)
    set_motion(y, around, p, s)


@internal
def _set_loads(y: Floats, density: float, bound: Bound) -> None:
    p, s = bound_values(bound)
    _load_sections(y, density, p, s)


@internal
def _act(density: float, bound: Bound) -> None:
    """Begin the equations of motion with what the air does."""
    p, s = bound_values(bound)
    clear(s.mass)
    clear(s.load)
    _add_loads(density, p, s)


@internal
def _accelerate(y: Floats, t: float, c: Controls, around: Surroundings, bound: Bound) -> bool:
    """Finish the equations of motion and solve them; returns whether the ground is touched."""
    p, s = bound_values(bound)
    touching = _contacts(y, p.contacts, p.weight, s)
    assemble(p.tree, s.tree, s.mass, s.load)
    _add_joint_loads(y, p.joints, s.load)
    _drive_wings(y, t, c, p, s)
    if _impose(y, c, around, p.joints, p.tail_servo, s):
        impose(s.mass, s.load, s.is_imposed, s.imposed)
    solve(s.mass, s.load)
    _kinematics(y, s)
    return touching


@inlined
def _kinematics(y: Floats, s: Scratch) -> None:
    n, rate, load, r = s.load.shape[0] - BASE, s.rate, s.load, s.r
    for i in range(BASE + n):
        s.accelerations[i] = load[i]
    for i in range(3):
        rate[i] = r[i, 0] * y[7] + r[i, 1] * y[8] + r[i, 2] * y[9]
    w, x, z_, q = y[3], y[4], y[5], y[6]
    a, b, d = y[10], y[11], y[12]
    # The last term pulls the quaternion back to unit length.
    stray = 1.0 - (w * w + x * x + z_ * z_ + q * q)
    rate[3] = 0.5 * (-x * a - z_ * b - q * d) + stray * w
    rate[4] = 0.5 * (w * a + z_ * d - q * b) + stray * x
    rate[5] = 0.5 * (w * b - x * d + q * a) + stray * z_
    rate[6] = 0.5 * (w * d + x * b - z_ * a) + stray * q
    for i in range(BASE):
        rate[7 + i] = load[i]
    for i in range(n):
        rate[COORDINATES + i] = y[COORDINATES + n + i]
        rate[COORDINATES + n + i] = load[BASE + i]
    phase = COORDINATES + 2 * n
    rate[phase] = 2.0 * math.pi * y[phase + 1]
    rate[phase + 1] = s.crank[0]
    rate[phase + 2] = s.drive[CURRENT]


@inlined
def _add_means(imu: Floats, s: Scratch, share: float) -> None:
    """Add ``share`` of what drives and IMU see at this instant to ``s.means``."""
    means, drive = s.means, s.drive
    means[0] += share * drive[TORQUE_LEFT]
    means[1] += share * drive[TORQUE_RIGHT]
    means[2] += share * drive[CURRENT]
    means[3] += share * drive[CURRENT] * drive[VOLTAGE]
    _add_specific_force(imu, s, means, share)


@inlined
def _add_specific_force(r: Floats, s: Scratch, means: Floats, share: float) -> None:
    """Add ``share`` of the acceleration at ``r`` less gravity: v' + w x v + w' x r + w x (w x r) - g."""
    v, w, a = s.base[0:3], s.base[3:6], s.accelerations
    inner = s.work[0]
    for i in range(3):
        j, k = (i + 1) % 3, (i + 2) % 3
        inner[i] = v[i] + w[j] * r[k] - w[k] * r[j]
    for i in range(3):
        j, k = (i + 1) % 3, (i + 2) % 3
        turning = w[j] * inner[k] - w[k] * inner[j] + a[3 + j] * r[k] - a[3 + k] * r[j]
        means[4 + i] += share * (a[i] + turning - s.outside[i])


@kernel
def advance_memory(y: Floats, h: float, around: Surroundings, bound: Bound) -> None:
    """Move what of the aerodynamic model's state has a clock of its own, at the end ``y`` of a step of ``h`` s."""
    p, s = bound_values(bound)
    set_motion(y, around, p, s)
    wing_places(s.tree, p.wings, s.wings)
    ground = s.wings.motion.ground
    ground[0] = -y[2]
    for i in range(3):
        ground[1 + i] = s.r[2, i]
    memory = y[aero_start(p.joints.kind.shape[0]) :]
    models.advance(p.air, p.wings.strips, s.wings.motion, around.density, memory, h)


@kernel
def advance(y: Floats, steps: int, c: Controls, around: Surroundings, bound: Bound) -> bool:
    """Advance ``y`` in place over ``c.duration`` in ``steps`` classical fourth-order Runge-Kutta steps.

    Leaves in ``Scratch.means``, over the interval: mean torque left and right in N m, current in A, electrical power
    in W, specific force (3,) in m/s^2 at the IMU in body axes; in ``Scratch.r`` the attitude at the end.

    Returns:
        whether the ground was touched.
    """
    p, s = bound_values(bound)
    h, touching = c.duration / steps, False
    s.means[:] = 0.0
    s.rate[:] = 0.0
    for step in range(steps):
        s.total[:] = 0.0
        for stage in range(4):
            ahead = LEADS[stage] * h
            add_scaled(y, ahead, s.rate, s.trial)
            touched = derivatives(s.trial, step * h + ahead, c, around, bound)
            for i in range(y.shape[0]):
                s.total[i] += WEIGHTS[stage] * s.rate[i]
            if stage == 0:
                touching = touched or touching
                _add_means(p.imu, s, 1.0 / steps)
        for i in range(y.shape[0]):
            y[i] += h * s.total[i]
        if p.advances:
            advance_memory(y, h, around, bound)
    rotation(y[3], y[4], y[5], y[6], s.r)
    return touching


STEP = 0.001
"""s; longest step of the integrator; an interval is divided into equal ones"""
ORDER = struct.Struct(f"<{len(Controls._fields) + len(Surroundings._fields)}d")
"""`Controls` and `Surroundings` as `advance_ordered` takes them"""
WIND, AIR_DENSITY, LAUNCHER, AIR_TURN = 10, 13, 14, 18
"""where in an order the air's velocity, its density, the launcher and the air's angular velocity begin"""


@exact
def steps_of(duration: float) -> int:
    """Number of the integrator's steps in ``duration`` s."""
    return max(1, math.ceil(duration / STEP - 1e-9))


@kernel
def advance_ordered(y: Floats, order: Floats, bound: Bound) -> bool:
    """`advance` by the numbers of `Controls`, then `Surroundings`, (21,): numba unpacks an array faster than them.

    Fills ``Scratch.observed`` but for the air's state and the battery's and drives' constants.
    """
    p, s = bound_values(bound)
    n = order
    c = Controls(n[0], n[1], n[2], n[3], n[4], n[5], n[6], n[7], n[8], n[9])
    around = Surroundings(n[10], n[11], n[12], n[13], int(n[14]), n[15], n[16], n[17], n[18], n[19], n[20])
    before = s.means[2]
    touching = advance(y, steps_of(c.duration), c, around, bound)
    s.observed[o.CURRENT] = 0.5 * (s.means[2] + before)
    s.observed[o.OPEN_CIRCUIT_VOLTAGE] = open_circuit_voltage(y[aero_start(p.joints.kind.shape[0]) - 1], p.battery)
    _observe(y, p.wings.flap, s.means, s.observed)
    observe_velocities(y, s.r, order[WIND : WIND + 3], p.nose, s.observed)
    return touching


@exact
def _observe(y: Floats, flap: Integers, means: Floats, out: Floats) -> None:
    """Fill the part of an observation that state and means have unchanged."""
    for i in range(4):
        out[o.QUATERNION + i] = y[3 + i]
    for i in range(3):
        out[o.OMEGA + i] = y[10 + i]
        out[o.FORCE + i] = means[4 + i]
        out[o.POSITION + i] = y[i]
    for side in range(2):
        if flap[side] >= 0:
            out[o.FLAP_LEFT + side] = y[COORDINATES + flap[side]]
    out[o.TORQUE_LEFT], out[o.TORQUE_RIGHT] = means[0], means[1]


@exact
def open_circuit_voltage(charge: float, battery: Floats) -> float:
    """V; of the battery after ``charge`` in C was drawn."""
    drawn = min(charge / battery[2], 1.2)
    return float(battery[0] + (battery[1] - battery[0]) * drawn)


@exact
def observe_velocities(y: Floats, r: Floats, wind: Floats, nose: float, out: Floats) -> None:
    """Fill velocities over ground and through the air at the pitot tube.

    Args:
        r: (3, 3); r_ned_from_frd.
        wind: (3,) m/s; velocity of the air, NED.
        nose: m; pitot tube ahead of the base's origin.
        out: (`observation.SIZE`,).
    """
    north, east, down = wind[0], wind[1], wind[2]
    for i in range(3):
        out[o.V_NED + i] = r[i, 0] * y[7] + r[i, 1] * y[8] + r[i, 2] * y[9]
    out[o.V_AIR] = y[7] - (r[0, 0] * north + r[1, 0] * east + r[2, 0] * down)
    out[o.V_AIR + 1] = y[8] + y[12] * nose - (r[0, 1] * north + r[1, 1] * east + r[2, 1] * down)
    out[o.V_AIR + 2] = y[9] - y[11] * nose - (r[0, 2] * north + r[1, 2] * east + r[2, 2] * down)


@kernel
def air_load(bound: Bound, out: Floats) -> None:
    """Fill ``out`` (6,) N, N m with the wings' air load of the last stage, on the body about its origin, body axes.

    Of all strips, and of the loads of the aerodynamic model on the body alone; without the apparent mass.
    """
    p, s = bound_values(bound)
    wing_places(s.tree, p.wings, s.wings)
    motion, loads = s.wings.motion, s.wings.loads
    force = s.work[0]
    out[:] = 0.0
    for part in range(loads.parts.shape[0]):
        for n in range(motion.place.shape[1]):
            forward, upward = loads.parts[part, 0, n], loads.parts[part, 1, n]
            outward, nose_up = loads.parts[part, 2, n], loads.parts[part, 3, n]
            for i in range(3):
                span, chord, normal = motion.axes[0, i, n], motion.axes[1, i, n], motion.axes[2, i, n]
                force[i] = forward * chord + upward * normal + outward * span
            for i in range(3):
                j, k = (i + 1) % 3, (i + 2) % 3
                turning = motion.axes[1, j, n] * motion.axes[2, k, n] - motion.axes[1, k, n] * motion.axes[2, j, n]
                out[i] += force[i]
                out[3 + i] += motion.place[j, n] * force[k] - motion.place[k, n] * force[j] + nose_up * turning
        for i in range(6):
            out[i] += loads.body[part, i]


@kernel
def follow(y: Floats, commands: Floats, around: Surroundings, bound: Bound, history: Floats) -> bool:
    """Advance ``y`` in place through intervals one after another, without coming back to Python in between.

    Args:
        commands: (n, 11) the fields of `Controls`, then the number of steps of each interval.
        history: (n, len(y) + 7) out; state at the end of each interval and its means.
    Returns:
        whether the ground was touched.
    """
    _, s = bound_values(bound)
    touching, size = False, y.shape[0]
    for i in range(commands.shape[0]):
        row = commands[i]
        c = Controls(row[0], row[1], row[2], row[3], row[4], row[5], row[6], row[7], row[8], row[9])
        touching = advance(y, int(row[10]), c, around, bound) or touching
        for j in range(size):
            history[i, j] = y[j]
        for j in range(s.means.shape[0]):
            history[i, size + j] = s.means[j]
    return touching
