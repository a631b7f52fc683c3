"""The simulated vehicle: a vehicle file turned into the compiled plant, stepped tick by tick."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from functools import cached_property
from typing import NamedTuple

import numpy as np

from sim_bridge import observation as o
from sim_bridge import plant_kernel as k
from sim_bridge.actuators.drives import drive_current
from sim_bridge.actuators.linkage import FourBar, Motor
from sim_bridge.aerodynamics.models import air_of
from sim_bridge.aerodynamics.protocol import strip_loads
from sim_bridge.compiled import Bound, entry_point, is_compiled
from sim_bridge.mechanism import Mechanism, build_mechanism, total_mass, wing_work
from sim_bridge.multibody.plates import no_plates
from sim_bridge.multibody.tree import BASE, blank_kinematics
from sim_bridge.multibody.wings import wing_places
from sim_bridge.vectors import Floats
from sim_bridge.vehicles import SimulatedVehicle
from wingbeat.constants import STANDARD_GRAVITY
from wingbeat.quaternions import quaternion_from_euler

DRIVES = {"servo": k.SERVO, "crank": k.CRANK, "linkage": k.LINKAGE}
NO_LINKAGE = FourBar(0.0, 1.0, 1.0, 1.0, 0.0, 0.0, False)
NO_MOTOR = Motor(1.0, 1.0, 0.0, 1.0, 1.0, 1.0)
"""what stands in the kernel's parameters for vehicles that have none"""
CONTROLS = len(k.Controls._fields)
ELEVATOR = k.Controls._fields.index("elevator")
"""index in an order; the rudder is the next"""


def contact_points(vehicle: SimulatedVehicle) -> Floats:
    """(4, 3) m; points of the fuselage that may touch the ground: nose, tail, and outriggers at the wings."""
    hull, out = vehicle.fuselage, 0.3 * vehicle.wing.semispan
    below = hull.contact_below
    return np.array([(hull.contact_nose, 0.0, below), (hull.contact_tail, 0.0, below), (0.0, -out, below),
                     (0.0, out, below)])  # fmt: skip


def plant_parameters(vehicle: SimulatedVehicle, mechanism: Mechanism) -> k.PlantParameters:
    """Flatten a vehicle into what the kernel takes."""
    hull, drive, battery, servo = vehicle.fuselage, vehicle.drive, vehicle.battery, vehicle.tail_servo
    return k.PlantParameters(
        tree=mechanism.tree,
        wings=mechanism.wings,
        joints=mechanism.joints,
        plates=no_plates() if mechanism.model.with_tail else mechanism.plates,
        air=air_of(mechanism.model, mechanism.aerodynamics),
        needs_places=mechanism.model.needs_places,
        advances=mechanism.model.advances,
        drag_areas=np.zeros(2) if mechanism.model.with_fuselage else np.array([hull.drag_area, hull.side_area]),
        contacts=contact_points(vehicle),
        imu=np.array(hull.imu_position),
        tail_servo=np.array([servo.time_constant, servo.rate_limit]),
        drive_kind=DRIVES[drive.kind],
        linkage=vehicle.linkage or NO_LINKAGE,
        motor=vehicle.motor or NO_MOTOR,
        drive=np.array(
            [drive.stall_torque, drive.no_load_speed, drive.nominal_voltage, drive.position_gain, drive.rate_gain]
        ),
        servo_gain=np.ones(2),
        crank_amplitude=np.full(len(mechanism.joints.kind), drive.crank_amplitude),
        crank_shape=np.array([drive.crank_mean, drive.spin_time_constant]),
        crank_frequencies=np.array(drive.frequencies),
        current=np.array([drive.torque_constant, drive.torque_offset, drive.idle_current]),
        battery=np.array([battery.full_voltage, battery.empty_voltage, battery.capacity, battery.resistance]),
        weight=total_mass(vehicle) * STANDARD_GRAVITY,
        nose=hull.contact_nose,
    )


def scratch(mechanism: Mechanism) -> k.Scratch:
    """Work space of the kernel."""
    speeds = BASE + len(mechanism.layout.coordinates)
    return k.Scratch(
        mass=np.zeros((speeds, speeds)),
        load=np.zeros(speeds),
        tree=blank_kinematics(mechanism.tree),
        wings=wing_work(mechanism),
        outside=np.zeros(9),
        base=np.zeros(6),
        work=np.zeros((5, 3)),
        r=np.zeros((3, 3)),
        plate_load=np.zeros(6),
        body_load=np.zeros(6),
        drive=np.zeros(4),
        accelerations=np.zeros(speeds),
        is_imposed=np.zeros(speeds, dtype=np.int64),
        imposed=np.zeros(speeds),
        crank=np.zeros(1),
        motion=np.zeros(3),
        rate=np.zeros(mechanism.layout.size),
        trial=np.zeros(mechanism.layout.size),
        total=np.zeros(mechanism.layout.size),
        means=np.zeros(len(Means._fields)),
        observed=np.zeros(o.SIZE),
    )


def initial_state(vehicle: SimulatedVehicle, mechanism: Mechanism) -> Floats:
    """The vehicle at rest in the launcher's hand, nose up by the launch pitch.

    The wings are level, or where the crank has them: 0.1 rad beside it, its rods would throw them there with 16 A.
    """
    y = np.zeros(mechanism.layout.size)
    y[2] = -vehicle.launch.height
    y[3:7] = quaternion_from_euler(0.0, vehicle.launch.pitch, 0.0)
    y[mechanism.layout.aerodynamics :] = mechanism.aerodynamic_state
    joints, start = mechanism.joints, np.zeros(3)
    for i, kind in enumerate(joints.kind):
        if kind == k.PRESCRIBED:
            k.prescribed_motion(joints.motion[i], 0.0, start)
            y[k.COORDINATES + i] = start[0]
        elif kind == k.WING and vehicle.drive.kind == "crank":
            y[k.COORDINATES + i] = vehicle.drive.crank_mean  # at phase 0
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


CURRENT = Means._fields.index("current")


def physics_compiled() -> bool:
    """Whether a plant flies at once; if not, the first step of one compiles for 15 to 30 s, once."""
    return is_compiled(k.advance_ordered)


class Plant:
    """The vehicle's state and its compiled integrator."""

    def __init__(self, vehicle: SimulatedVehicle) -> None:
        """Build the vehicle's mechanism, at rest in the launcher's hand.

        Raises:
            InputError: the bodies make no tree, or the aerodynamic model does not hold.
        """
        self.vehicle = vehicle
        self.mechanism = build_mechanism(vehicle)
        self.layout = self.mechanism.layout
        self.y = initial_state(vehicle, self.mechanism)
        self.scratch = scratch(self.mechanism)
        self.parameters = plant_parameters(vehicle, self.mechanism)
        self.scratch.drive[k.VOLTAGE] = vehicle.battery.full_voltage
        self.observed = self.scratch.observed
        """(`observation.SIZE`,); input of the sensors after `step`; ambient air: see `flight.inputs.PlantInputs`"""
        self.observed[o.BATTERY_RESISTANCE :] = (
            vehicle.battery.resistance,
            vehicle.drive.pulse_current,
            vehicle.drive.pwm_frequency,
        )
        self.touching = False
        self.order = np.zeros(k.ORDER.size // 8)
        """(21,); controls and surroundings of the next `step`, see `plant_kernel.ORDER`"""
        self._tail: tuple[float, float] | None = None
        self._stalled: dict[int, float] = {}

    @property
    def parameters(self) -> k.PlantParameters:
        """What the kernel has of the vehicle; other ones may take their place, their arrays may be written to."""
        return self._parameters

    @parameters.setter
    def parameters(self, parameters: k.PlantParameters) -> None:
        self._parameters = parameters
        self._bound = Bound((parameters, self.scratch))
        self.__dict__.pop("_advance", None)  # the entry point is for one type of `Bound`

    def advance(self, controls: k.Controls, around: k.Surroundings) -> Means:
        """Integrate over ``controls.duration`` seconds."""
        k.ORDER.pack_into(self.order.data, 0, *controls, *around)
        self.step()
        return self.means

    def step(self) -> None:
        """Integrate over the interval that `order` describes; `means` and `observed` have the result."""
        if self._tail is not None:
            self.order[ELEVATOR : ELEVATOR + 2] = self._tail
        current_before = self.scratch.means.item(CURRENT) if self._stalled else 0.0
        self.touching = self._advance(self.y, self.order, self._bound)
        if self._stalled:
            self._add_stalled_drives(current_before)

    @cached_property
    def _advance(self) -> Callable[[Floats, Floats, Bound], bool]:
        return entry_point(k.advance_ordered, self.y, self.order, self._bound)

    @property
    def means(self) -> Means:
        """Averages over the last interval."""
        return Means._make(self.scratch.means.tolist())

    def jam_tail(self) -> None:
        """Let elevator and rudder stay where they are."""
        at, commanded = (self.layout.elevator, self.layout.rudder), self.order[ELEVATOR : ELEVATOR + 2].tolist()
        angles = [float(self.y[i]) if i >= 0 else angle for i, angle in zip(at, commanded, strict=True)]
        self._tail = (angles[0], angles[1])

    def free_tail(self) -> None:
        """Let elevator and rudder follow their servos again."""
        self._tail = None

    def jam_wing(self, wing: int) -> None:
        """Let the left (0) or right (1) wing stay where it is, whatever its drive does; a crank stops with both."""
        for i in (0, 1) if self._cranked else (wing,):
            joint, angle = self.layout.flap[i] - k.COORDINATES, float(self.y[self.layout.flap[i]])
            self.parameters.joints.kind[joint] = k.PRESCRIBED
            self.parameters.joints.motion[joint] = 0.0
            self.parameters.joints.motion[joint, 0] = angle
            self._stalled[i] = angle

    def free_wing(self, wing: int) -> None:
        """Let the wing move with its drive again."""
        for i in (0, 1) if self._cranked else (wing,):
            joint = self.layout.flap[i] - k.COORDINATES
            self.parameters.joints.kind[joint] = k.WING
            self._stalled.pop(i, None)

    @property
    def _cranked(self) -> bool:
        return bool(self.parameters.drive_kind != k.SERVO)

    def _add_stalled_drives(self, current_before: float) -> None:
        """Add torque and current of drives whose wings are jammed to the means, and draw their charge."""
        controls, means, drive = k.Controls(*self.order[:CONTROLS].tolist()), self.means, self.parameters.drive
        torques, motor = [means.torque_left, means.torque_right], self.parameters.current
        current, voltage = 0.0, float(self.scratch.drive[k.VOLTAGE])
        stall = float(drive[0]) * voltage / float(drive[2])
        for i, angle in self._stalled.items():
            start, end = controls[2 * i : 2 * i + 2]
            servo = float(drive[3]) * (end - angle) + float(drive[4]) * (end - start) / controls.duration
            pull = controls.throttle * stall if self._cranked else servo
            torques[i] = min(max(pull, -stall), stall)
            current += drive_current(torques[i] * controls.conducting, *motor.tolist())
        self.y[self.layout.charge] += current * controls.duration
        total, power = means.current + current, means.electrical_power + current * voltage
        self.scratch.means[:4] = *torques, total, power
        self.observed[o.TORQUE_LEFT : o.CURRENT + 1] = *torques, 0.5 * (total + current_before)
        self.observed[o.OPEN_CIRCUIT_VOLTAGE] = k.open_circuit_voltage(
            self.y.item(self.layout.charge), self.parameters.battery
        )

    def follow(self, controls: Sequence[k.Controls], around: k.Surroundings) -> tuple[Floats, Floats]:
        """Integrate through intervals one after another; much less a call than as many of `advance`.

        Returns:
            the state at the end of each, (n, len(y)), and the fields of `Means` over each, (n, 7).
        """
        commands = np.array([(*one, k.steps_of(one.duration)) for one in controls], dtype=np.float64)
        history = np.zeros((len(controls), self.y.shape[0] + len(Means._fields)))
        self.touching = k.follow(self.y, commands, around, self._bound, history)
        return history[:, : self.y.shape[0]], history[:, self.y.shape[0] :]

    def compile(self) -> None:
        """Have the kernels compiled; the state is left as it is."""
        before = self.y.copy()
        self.advance(
            k.Controls(0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, k.STEP, 0.0),
            k.Surroundings(0.0, 0.0, 0.0, 1.225, k.HELD, 0.0, 0.0, 0.0),
        )
        self.y[:] = before
        self.scratch.means[:] = 0.0
        self.touching = False

    def evaluate(self, controls: k.Controls, around: k.Surroundings) -> Floats:
        """Rates of the state (len(y),) at its present value; loads and accelerations are left in ``scratch``."""
        k.derivatives(self.y, controls.duration, controls, around, self._bound)
        return self.scratch.rate.copy()

    def air_load(self) -> Floats:
        """(6,) N, N m: the wings' air load at the last stage, on the body about its origin, body axes.

        The sum of `part_loads`.
        """
        out = np.empty(6)
        self.fill_air_load(out)
        return out

    def fill_air_load(self, out: Floats) -> None:
        """Fill `air_load` in."""
        k.air_load(self._bound, out)

    def wing_loads(self) -> Floats:
        """(n, 6) N, N m: air loads of every strip at the last stage, on the body about its origin, body axes.

        Without the apparent mass, whose force is part of the mass matrix, and the loads of a model on the body alone.
        """
        wing_places(self.scratch.tree, self.mechanism.wings, self.scratch.wings)
        return strip_loads(self.scratch.wings.motion, self.scratch.wings.loads.parts.sum(axis=0))

    def part_loads(self) -> Floats:
        """(parts, 6) N, N m: air loads of the model's parts at the last stage, on the body about its origin.

        Body axes; of all strips and of the body, without the apparent mass.
        """
        wing_places(self.scratch.tree, self.mechanism.wings, self.scratch.wings)
        loads = self.scratch.wings.loads
        return np.asarray(strip_loads(self.scratch.wings.motion, loads.parts).sum(axis=1) + loads.body)
