"""The compiled right-hand side and integrator of the plant.

State vector: position NED 0-2, quaternion 3-6, velocity 7-9 and angular velocity 10-12 in body axes, then for the
left (13-16) and the right wing (17-20) flap angle, tip twist, flap rate, tip-twist rate; elevator 21, rudder 22,
crank phase 23, crank speed in Hz 24, charge drawn in C 25, then the wake states of the strips, left and right.
"""

from __future__ import annotations

import math
from typing import NamedTuple

from sim_bridge.actuators.drives import drive_current, servo_torque
from sim_bridge.aerodynamics.strip_theory import StripParameters
from sim_bridge.aerodynamics.surfaces import body_drag, plate_pressure
from sim_bridge.multibody.contact import ground_force
from sim_bridge.multibody.flapper import (
    add_body_force,
    add_fuselage,
    add_wing,
    clear,
    hold_speeds,
    solve,
)
from sim_bridge.vectors import Floats, kernel, rotation

GRAVITY = 9.80665
VOLTAGE_ROUNDS = 3
LEFT, RIGHT = 13, 17
ELEVATOR, RUDDER, CRANK_PHASE, CRANK_SPEED, CHARGE, WAKE = 21, 22, 23, 24, 25, 26

# Phases of the flight as the launcher sees them.
HELD, THROWN, FREE = 0, 1, 2


class PlantParameters(NamedTuple):
    """Everything the kernel needs of a vehicle; SI."""

    fuselage_mass: float
    inertia: Floats
    drag_areas: Floats
    contacts: Floats
    imu: Floats
    strips: Floats
    hinge: Floats
    hinge_position: Floats
    section: StripParameters
    washout: float
    twist: Floats
    flap_damping: float
    tail: Floats
    tail_servo: Floats
    crank: bool
    drive: Floats
    crank_shape: Floats
    crank_frequencies: Floats
    current: Floats
    battery: Floats
    weight: float


class Controls(NamedTuple):
    """Commands over one interval; the wing angles move linearly from ``_start`` to ``_end``."""

    left_start: float
    left_end: float
    right_start: float
    right_end: float
    throttle: float
    elevator: float
    rudder: float
    duration: float
    powered: float
    """1 when the drives are on, 0 when they are slack"""


class Surroundings(NamedTuple):
    """Air and launcher over one interval."""

    wind_north: float
    wind_east: float
    wind_down: float
    density: float
    launcher: int
    throw_x: float
    throw_y: float
    throw_z: float


class Scratch(NamedTuple):
    """Work space and outputs of one right-hand side."""

    mass: Floats
    load: Floats
    frame: Floats
    work: Floats
    r: Floats
    left_loads: Floats
    right_loads: Floats
    tail_load: Floats
    body_load: Floats
    drive: Floats
    """torque left, right N m; current A; voltage V; tail deflections"""
    accelerations: Floats
    """(10,) rates of the speeds"""
    held: Floats


@kernel
def crank_frequency(throttle: float, table: Floats) -> float:
    """Flapping frequency in Hz of a crank drive: linear between the table's equal steps of throttle."""
    place = min(max(throttle, 0.0), 1.0) * (table.shape[0] - 1)
    low = min(int(place), table.shape[0] - 2)
    return float(table[low] + (place - low) * (table[low + 1] - table[low]))


@kernel
def _supply(charge: float, battery: Floats) -> float:
    full, empty, capacity = battery[0], battery[1], battery[2]
    return float(full + (empty - full) * min(max(charge / capacity, 0.0), 1.2))


@kernel
def _drive_wings(y: Floats, t: float, c: Controls, p: PlantParameters, s: Scratch) -> None:
    # The torque a servo can give depends on the voltage, which sags with the current that the torque draws: from
    # the open-circuit voltage three rounds come within a millivolt.
    open_circuit = _supply(y[CHARGE], p.battery)
    voltage = open_circuit
    for _ in range(VOLTAGE_ROUNDS):
        _drive_torques(y, t / c.duration, max(voltage, 0.1) / p.drive[2], c, p, s)
        voltage = open_circuit - p.battery[3] * s.drive[2]
    s.drive[3] = voltage


@kernel
def _drive_torques(y: Floats, share: float, ratio: float, c: Controls, p: PlantParameters, s: Scratch) -> None:
    total = 0.0
    for k in range(2):
        base = LEFT + 4 * k
        if p.crank:
            wanted = p.crank_shape[1] + p.crank_shape[0] * math.sin(y[CRANK_PHASE])
            wanted_rate = p.crank_shape[0] * math.cos(y[CRANK_PHASE]) * 2.0 * math.pi * y[CRANK_SPEED]
        else:
            start = c.left_start if k == 0 else c.right_start
            end = c.left_end if k == 0 else c.right_end
            wanted = start + share * (end - start)
            wanted_rate = (end - start) / c.duration
        gains = (p.drive[3], p.drive[4])
        torque = servo_torque(
            wanted - y[base], wanted_rate - y[base + 2], y[base + 2], gains, p.drive[0] * ratio, p.drive[1] * ratio
        )
        s.drive[k] = torque * c.powered
        total += drive_current(s.drive[k], p.current[0], p.current[1], p.current[2])
    s.drive[2] = total


@kernel
def _tail_and_body(y: Floats, p: PlantParameters, density: float, s: Scratch) -> None:
    v, w, air = s.frame[1], s.frame[2], s.frame[3]
    force, x, z = s.work[0, 0:3], p.tail[0], p.tail[1]
    along, down = v[0] - air[0], v[2] - air[2] - w[1] * x
    # Undeflected normal points up: moving down is an upwash, and a deflection raises the leading edge.
    pressure = plate_pressure(along, -down, p.tail[5] - y[ELEVATOR], p.tail[4], density)
    s.tail_load[:] = 0.0
    force[0], force[1], force[2] = 0.0, 0.0, -pressure * p.tail[2]
    add_body_force(s.tail_load, x, 0.0, 0.0, force)
    aside = v[1] - air[1] + w[2] * x - w[0] * z
    pressure = plate_pressure(along, aside, -y[RUDDER], p.tail[4], density)
    force[0], force[1], force[2] = 0.0, pressure * p.tail[3], 0.0
    add_body_force(s.tail_load, x, 0.0, z, force)
    s.body_load[:] = 0.0
    speeds = s.work[1, 0:3]
    for i in range(3):
        speeds[i] = v[i] - air[i]
    body_drag(speeds, p.drag_areas[0], p.drag_areas[1], density, force)
    add_body_force(s.body_load, 0.0, 0.0, 0.0, force)
    for i in range(6):
        s.load[i] += s.tail_load[i] + s.body_load[i]


@kernel
def _contacts(y: Floats, p: PlantParameters, s: Scratch) -> bool:
    touching = False
    if y[2] < -2.0:
        return False
    velocity, force, body = s.work[0, 0:3], s.work[1, 0:3], s.work[2, 0:3]
    v, w = s.frame[1], s.frame[2]
    for k in range(p.contacts.shape[0]):
        px, py, pz = p.contacts[k, 0], p.contacts[k, 1], p.contacts[k, 2]
        depth = y[2] + s.r[2, 0] * px + s.r[2, 1] * py + s.r[2, 2] * pz
        if depth <= 0.0:
            continue
        body[0] = v[0] + w[1] * pz - w[2] * py
        body[1] = v[1] + w[2] * px - w[0] * pz
        body[2] = v[2] + w[0] * py - w[1] * px
        for i in range(3):
            velocity[i] = s.r[i, 0] * body[0] + s.r[i, 1] * body[1] + s.r[i, 2] * body[2]
        touching = ground_force(depth, velocity, p.weight, force) or touching
        for i in range(3):
            body[i] = s.r[0, i] * force[0] + s.r[1, i] * force[1] + s.r[2, i] * force[2]
        add_body_force(s.load, px, py, pz, body)
    return touching


@kernel
def _axes(y: Floats, around: Surroundings, p: PlantParameters, s: Scratch) -> None:
    rotation(y[3], y[4], y[5], y[6], s.r)
    for i in range(3):
        s.frame[1, i] = y[7 + i]
        s.frame[2, i] = y[10 + i]
        s.frame[3, i] = s.r[0, i] * around.wind_north + s.r[1, i] * around.wind_east + s.r[2, i] * around.wind_down
        s.frame[4, i] = s.r[2, i] * GRAVITY


@kernel
def derivatives(
    y: Floats, t: float, c: Controls, around: Surroundings, p: PlantParameters, s: Scratch, rate: Floats
) -> bool:
    """Fill ``rate`` with dy/dt at ``t`` seconds into the interval; returns whether the ground is touched."""
    n = p.strips.shape[0]
    clear(s.mass, s.load)
    _axes(y, around, p, s)
    add_fuselage(s.mass, s.load, p.fuselage_mass, p.inertia, s.frame[1], s.frame[2])
    for i in range(3):
        s.load[i] += p.fuselage_mass * s.frame[4, i]
    _tail_and_body(y, p, around.density, s)
    touching = _contacts(y, p, s)
    _drive_wings(y, t, c, p, s)
    for k in range(2):
        base, side = LEFT + 4 * k, -1.0 if k == 0 else 1.0
        s.frame[0, 0] = p.hinge_position[0]
        s.frame[0, 1] = side * p.hinge_position[1]
        s.frame[0, 2] = p.hinge_position[2]
        lags, lag_rates = y[WAKE + n * k : WAKE + n * (k + 1)], rate[WAKE + n * k : WAKE + n * (k + 1)]
        loads = s.left_loads if k == 0 else s.right_loads
        add_wing(
            s.mass, s.load, y[base : base + 4], side, p.strips, p.hinge, s.frame, lags, lag_rates,
            around.density, p.section, p.washout, s.work, loads,
        )  # fmt: skip
        s.load[6 + 2 * k] += s.drive[k] - p.flap_damping * y[base + 2]
        s.load[7 + 2 * k] -= p.twist[0] * y[base + 1] + p.twist[1] * y[base + 3]
    _impose_launcher(y, around, s)
    solve(s.mass, s.load)
    _kinematics(y, c, p, s, rate)
    return touching


@kernel
def _impose_launcher(y: Floats, around: Surroundings, s: Scratch) -> None:
    if around.launcher == FREE:
        return
    s.held[:] = 0.0
    if around.launcher == THROWN:
        s.held[0], s.held[1], s.held[2] = around.throw_x, around.throw_y, around.throw_z
    hold_speeds(s.mass, s.load, s.held, 0, 6)


@kernel
def _kinematics(y: Floats, c: Controls, p: PlantParameters, s: Scratch, rate: Floats) -> None:
    for i in range(10):
        s.accelerations[i] = s.load[i]
    for i in range(3):
        rate[i] = s.r[i, 0] * y[7] + s.r[i, 1] * y[8] + s.r[i, 2] * y[9]
    w, x, z_, q = y[3], y[4], y[5], y[6]
    a, b, d = y[10], y[11], y[12]
    # The last term pulls the quaternion back to unit length.
    stray = 1.0 - (w * w + x * x + z_ * z_ + q * q)
    rate[3] = 0.5 * (-x * a - z_ * b - q * d) + stray * w
    rate[4] = 0.5 * (w * a + z_ * d - q * b) + stray * x
    rate[5] = 0.5 * (w * b - x * d + q * a) + stray * z_
    rate[6] = 0.5 * (w * d + x * b - z_ * a) + stray * q
    for i in range(6):
        rate[7 + i] = s.load[i]
    for k in range(2):
        base = LEFT + 4 * k
        rate[base] = y[base + 2]
        rate[base + 1] = y[base + 3]
        rate[base + 2] = s.load[6 + 2 * k]
        rate[base + 3] = s.load[7 + 2 * k]
    limit = p.tail_servo[1]
    rate[ELEVATOR] = min(max((c.elevator - y[ELEVATOR]) / p.tail_servo[0], -limit), limit)
    rate[RUDDER] = min(max((c.rudder - y[RUDDER]) / p.tail_servo[0], -limit), limit)
    rate[CRANK_PHASE] = 2.0 * math.pi * y[CRANK_SPEED]
    wanted = crank_frequency(c.throttle, p.crank_frequencies) * c.powered
    rate[CRANK_SPEED] = (wanted - y[CRANK_SPEED]) / p.crank_shape[2]
    rate[CHARGE] = s.drive[2]


@kernel
def _add_specific_force(r: Floats, s: Scratch, means: Floats, share: float) -> None:
    """Add ``share`` of the acceleration at ``r`` less gravity: v' + w x v + w' x r + w x (w x r) - g."""
    v, w, a = s.frame[1], s.frame[2], s.accelerations
    inner = s.work[0, 0:3]
    for i in range(3):
        j, k = (i + 1) % 3, (i + 2) % 3
        inner[i] = v[i] + w[j] * r[k] - w[k] * r[j]
    for i in range(3):
        j, k = (i + 1) % 3, (i + 2) % 3
        turning = w[j] * inner[k] - w[k] * inner[j] + a[3 + j] * r[k] - a[3 + k] * r[j]
        means[4 + i] += share * (a[i] + turning - s.frame[4, i])


@kernel
def advance(
    y: Floats,
    steps: int,
    c: Controls,
    around: Surroundings,
    p: PlantParameters,
    s: Scratch,
    stages: Floats,
    means: Floats,
) -> bool:
    """Advance ``y`` in place over ``c.duration`` in ``steps`` classical fourth-order Runge-Kutta steps.

    Args:
        stages: (6, len(y)) scratch. means: (7,) out, over the interval: mean torque left and right, current,
            electrical power, specific force (3,) at the IMU in body axes.
    Returns:
        whether the ground was touched.
    """
    h = c.duration / steps
    touching = False
    means[:] = 0.0
    trial = stages[4]
    for step in range(steps):
        t = step * h
        touching = derivatives(y, t, c, around, p, s, stages[0]) or touching
        means[0] += s.drive[0] / steps
        means[1] += s.drive[1] / steps
        means[2] += s.drive[2] / steps
        means[3] += s.drive[2] * s.drive[3] / steps
        _add_specific_force(p.imu, s, means, 1.0 / steps)
        for i in range(y.shape[0]):
            trial[i] = y[i] + 0.5 * h * stages[0, i]
        derivatives(trial, t + 0.5 * h, c, around, p, s, stages[1])
        for i in range(y.shape[0]):
            trial[i] = y[i] + 0.5 * h * stages[1, i]
        derivatives(trial, t + 0.5 * h, c, around, p, s, stages[2])
        for i in range(y.shape[0]):
            trial[i] = y[i] + h * stages[2, i]
        derivatives(trial, t + h, c, around, p, s, stages[3])
        for i in range(y.shape[0]):
            y[i] += h / 6.0 * (stages[0, i] + 2.0 * stages[1, i] + 2.0 * stages[2, i] + stages[3, i])
    return touching
