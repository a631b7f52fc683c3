"""The simulated vehicle: a vehicle file turned into the compiled plant, stepped tick by tick."""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from sim_bridge import plant_kernel as k
from sim_bridge.aerodynamics.strip_theory import strip_parameters
from sim_bridge.multibody.flapper import SPEEDS, hinge_rotation
from sim_bridge.vectors import Floats, quaternion_from_euler, rotation
from sim_bridge.vehicles import SimulatedVehicle
from sim_bridge.vehicles.sections import Wing

STEP = 0.001
"""s; of the integrator (a tick is cut into equal steps no longer than this)"""


def chord_shape(planform: str, eta: float) -> float:
    """Chord over the greatest chord at the relative span ``eta`` (0 root, 1 tip).

    ``raven`` is Gerdes Eq. 1; ``ellipse`` an elliptic chord distribution.
    """
    if planform == "raven":
        return 1.0 if eta < 0.5 else 4.0 * eta * (1.0 - eta)
    return math.sqrt(max(1.0 - eta * eta, 0.0))


def wing_strips(wing: Wing) -> Floats:
    """Strips of one wing (n, 6): span m, eta, chord m, width m, spar mass kg, membrane mass kg.

    The spar's mass is spread evenly over the span, the membrane's in proportion to area.
    """
    width = 1.0 / wing.strips
    etas = [(i + 0.5) * width for i in range(wing.strips)]
    # A strip's chord is the mean over its width, so that the strips' areas add up to the planform's.
    fine = [(j + 0.5) / 40 - 0.5 for j in range(40)]
    shapes = [sum(chord_shape(wing.planform, eta + f * width) for f in fine) / 40 for eta in etas]
    area = sum(shapes)
    rows = [
        (
            eta * wing.semispan,
            eta,
            shape * wing.root_chord,
            width * wing.semispan,
            wing.mass * wing.spar_fraction * width,
            wing.mass * (1.0 - wing.spar_fraction) * shape / area,
        )
        for eta, shape in zip(etas, shapes, strict=True)
    ]
    return np.array(rows)


def aspect_ratio(wing: Wing, strips: Floats) -> float:
    """Of both wings together: span squared over area."""
    area = 2.0 * float(np.sum(strips[:, 2] * strips[:, 3]))
    return (2.0 * wing.semispan) ** 2 / area


def plant_parameters(vehicle: SimulatedVehicle) -> k.PlantParameters:
    """Flatten a vehicle into what the kernel takes."""
    body, wing, tail, drive = vehicle.body, vehicle.wing, vehicle.tail, vehicle.drive
    strips = wing_strips(wing)
    section = strip_parameters(
        aspect_ratio(wing, strips), wing.zero_lift_angle, wing.suction_efficiency, wing.stall_angle
    )
    section = section._replace(c1=section.c1 * wing.wake_lag)
    below = body.contact_below
    contacts = [(body.contact_nose, 0.0, below), (body.contact_tail, 0.0, below)]
    contacts += [(0.0, side * 0.3 * wing.semispan, below) for side in (-1.0, 1.0)]
    return k.PlantParameters(
        fuselage_mass=body.mass - 2.0 * wing.mass,
        inertia=np.array([body.inertia_xx, body.inertia_yy, body.inertia_zz, body.inertia_xz]),
        drag_areas=np.array([body.drag_area, body.side_area]),
        contacts=np.array(contacts),
        imu=np.array(body.imu_position),
        strips=strips,
        hinge=hinge_rotation(wing.incidence),
        hinge_position=np.array([wing.hinge_x, wing.hinge_y, wing.hinge_z]),
        section=section,
        washout=wing.washout,
        twist=np.array([wing.twist_stiffness, wing.twist_damping]),
        flap_damping=wing.flap_damping,
        tail=np.array(
            [tail.position_x, tail.position_z, tail.horizontal_area, tail.vertical_area, tail.lift_slope,
             tail.incidence]
        ),
        tail_servo=np.array([tail.servo_time_constant, tail.servo_rate_limit, tail.travel]),
        crank=drive.kind == "crank",
        drive=np.array(
            [drive.stall_torque, drive.no_load_speed, drive.nominal_voltage, drive.position_gain, drive.rate_gain]
        ),
        crank_shape=np.array([drive.crank_amplitude, drive.crank_mean, drive.spin_time_constant]),
        crank_frequencies=np.array(drive.frequencies),
        current=np.array([drive.torque_constant, drive.torque_offset, drive.idle_current]),
        battery=np.array(
            [vehicle.battery.full_voltage, vehicle.battery.empty_voltage, vehicle.battery.capacity,
             vehicle.battery.resistance]
        ),
        weight=body.mass * k.GRAVITY,
    )  # fmt: skip


def scratch(strips: int) -> k.Scratch:
    """Work space of the kernel for wings of ``strips`` strips."""
    return k.Scratch(
        mass=np.zeros((SPEEDS, SPEEDS)),
        load=np.zeros(SPEEDS),
        frame=np.zeros((5, 3)),
        work=np.zeros((8, 18)),
        r=np.zeros((3, 3)),
        left_loads=np.zeros((strips, 6)),
        right_loads=np.zeros((strips, 6)),
        tail_load=np.zeros(SPEEDS),
        body_load=np.zeros(SPEEDS),
        drive=np.zeros(4),
        accelerations=np.zeros(SPEEDS),
        held=np.zeros(SPEEDS),
    )


def initial_state(vehicle: SimulatedVehicle) -> Floats:
    """The vehicle at rest in the launcher's hand, wings level, nose up by the launch pitch."""
    y = np.zeros(k.WAKE + 2 * vehicle.wing.strips)
    y[2] = -vehicle.launch.height
    y[3:7] = quaternion_from_euler(0.0, vehicle.launch.pitch, 0.0)
    return y


class Means(NamedTuple):
    """Averages over the last interval: drives, and the specific force at the IMU in body axes."""

    torque_left: float
    torque_right: float
    current: float
    electrical_power: float
    specific_force_x: float
    specific_force_y: float
    specific_force_z: float


class Plant:
    """The vehicle's state and its compiled integrator."""

    def __init__(self, vehicle: SimulatedVehicle) -> None:
        self.vehicle = vehicle
        self.parameters = plant_parameters(vehicle)
        self.y = initial_state(vehicle)
        self.scratch = scratch(vehicle.wing.strips)
        self.scratch.drive[3] = vehicle.battery.full_voltage
        self.touching = False
        self._stages = np.zeros((6, self.y.shape[0]))
        self._means = np.zeros(7)

    def advance(self, controls: k.Controls, around: k.Surroundings) -> Means:
        """Integrate over ``controls.duration`` seconds."""
        steps = max(1, math.ceil(controls.duration / STEP - 1e-9))
        self.touching = k.advance(
            self.y, steps, controls, around, self.parameters, self.scratch, self._stages, self._means
        )
        rotation(self.y[3], self.y[4], self.y[5], self.y[6], self.scratch.r)
        return Means(*self._means.tolist())

    def evaluate(self, controls: k.Controls, around: k.Surroundings) -> Floats:
        """Rates of the state (len(y),) at its present value; loads and accelerations are left in ``scratch``."""
        k.derivatives(self.y, controls.duration, controls, around, self.parameters, self.scratch, self._stages[5])
        rates: Floats = self._stages[5].copy()
        return rates
