"""Flight of vehicles whose wings follow a prescribed stroke: orbits, linear model and feedback, stroke by stroke.

The stroke map goes from one start of the stroke to the next. How long that takes hangs on the crank, which gathers
speed as its first-order lag lets it, so that the map begins and ends at the same phase whatever the throttle does.
Longitudinal flight only: both wings move alike and the lateral speeds stay zero.
"""

from __future__ import annotations

import math
from typing import Any, NamedTuple

import numpy as np
from scipy.optimize import root, root_scalar

from sim_bridge import plant_kernel as k
from sim_bridge.aerodynamics.protocol import FORWARD, NOSE_UP, UPWARD
from sim_bridge.flight_mechanics.stroke_map import paired_coordinates, throttle_for
from sim_bridge.plant import Plant
from sim_bridge.plant_kernel import STEP
from sim_bridge.vectors import Floats
from sim_bridge.vehicles import SimulatedVehicle
from wingbeat.atmosphere import SEA_LEVEL_DENSITY
from wingbeat.errors import InputError
from wingbeat.quaternions import quaternion_from_euler

HEIGHT = 1000.0
"""m; above the ground, without ground contact"""
BODY = ("u", "w", "q", "pitch", "x", "z", "crank")
"""m/s, m/s, rad/s, rad, m, m, Hz: velocity in body axes, pitch rate, pitch, position forward and down, crank speed;
first in the state vector, before coordinates and their rates
"""
U, W, Q, PITCH, X, Z, CRANK = range(len(BODY))
STRIDE = 0.5
"""m/s; step of the continuation from hover to forward flight"""
INPUTS = ("throttle", "elevator")
THROTTLE, ELEVATOR = range(len(INPUTS))


class HoverMap:
    """Map of the longitudinal state at the start of a stroke to that at the start of the next."""

    def __init__(self, vehicle: SimulatedVehicle, step: float = STEP) -> None:
        """Build the plant.

        Args:
            step: s; maximum integration step. The number of steps is that of the slowest stroke for all strokes, so
                that the map is smooth in the frequency.

        Raises:
            InputError: joints without a prescribed stroke, a crank that may stop, an aerodynamic model with memory.
        """
        self.vehicle, self.plant = vehicle, Plant(vehicle)
        _check(self.plant)
        self.around = k.Surroundings(0.0, 0.0, 0.0, SEA_LEVEL_DENSITY, k.FREE, 0.0, 0.0, 0.0)
        self.pieces = math.ceil(1.0 / (step * min(vehicle.drive.frequencies)))
        self.joints = paired_coordinates(self.plant)
        self.size = len(BODY) + 2 * len(self.joints)

    def start(self, state: Floats, inputs: Floats) -> Floats:
        """Return ``state`` (size,) with crank and joints after many strokes of ``inputs`` (2,)."""
        found, n = state.copy(), len(self.joints)
        found[CRANK] = frequency_at(float(inputs[THROTTLE]), self.vehicle)
        joints, motion = self.plant.parameters.joints, np.zeros(3)
        for i, places in enumerate(self.joints):
            own = places[0] - k.COORDINATES
            k.prescribed_motion(joints.motion[own], 0.0, motion)
            found[len(BODY) + i] = motion[0] + joints.steered[own, 0] * inputs[ELEVATOR]
            found[len(BODY) + n + i] = motion[1] * 2.0 * math.pi * found[CRANK]
        return found

    def unpack(self, state: Floats) -> None:
        """Set the plant to the longitudinal state (size,) at the start of a stroke."""
        y, layout, n = self.plant.y, self.plant.layout, len(self.joints)
        y[:] = 0.0
        y[0], y[2] = state[X], state[Z] - HEIGHT
        y[3:7] = quaternion_from_euler(0.0, float(state[PITCH]), 0.0)
        y[7], y[9], y[11] = state[:PITCH]
        for i, places in enumerate(self.joints):
            for place in places:
                y[place], y[layout.rate(place)] = state[len(BODY) + i], state[len(BODY) + n + i]
        y[layout.crank_speed] = state[CRANK]

    def pack(self) -> Floats:
        """Return the longitudinal state (size,) of the plant."""
        y, layout = self.plant.y, self.plant.layout
        pitch = 2.0 * math.atan2(y[5], y[3])
        first = [places[0] for places in self.joints]
        rates = [layout.rate(place) for place in first]
        body = (y[7], y[9], y[11], pitch, y[0], y[2] + HEIGHT, y[layout.crank_speed])
        return np.concatenate((body, y[first], y[rates]))

    def period(self, state: Floats, inputs: Floats) -> float:
        """Return the period in s of the stroke that begins with ``state`` (size,)."""
        crank, wanted = float(state[CRANK]), frequency_at(float(inputs[THROTTLE]), self.vehicle)
        lag = self.vehicle.drive.spin_time_constant

        def turned(t: float) -> float:
            return wanted * t - (crank - wanted) * lag * math.expm1(-t / lag) - 1.0

        slow, fast = sorted((crank, wanted))
        return float(root_scalar(turned, bracket=(0.99 / fast, 1.01 / slow), xtol=1e-15).root)

    def controls(self, state: Floats, inputs: Floats) -> k.Controls:
        """Return the commands over one of the ``pieces`` of the stroke that begins with ``state``."""
        throttle, elevator = inputs.tolist()
        duration = self.period(state, inputs) / self.pieces
        return k.Controls(0.0, 0.0, 0.0, 0.0, throttle, elevator, 0.0, duration, 1.0)

    def __call__(self, state: Floats, inputs: Floats) -> Floats:
        """Return the state (size,) one stroke after ``state``, with constant ``inputs`` (2,) throttle and elevator
        rad.
        """
        end: Floats = self.course(state, inputs)[-1]
        return end

    def course(self, state: Floats, inputs: Floats) -> Floats:
        """Return the states (pieces + 1, size) at equal time steps over the stroke that begins with ``state``."""
        self.unpack(state)
        controls = self.controls(state, inputs)
        found = [self.pack()]
        for _ in range(self.pieces):
            self.plant.advance(controls, self.around)
            found.append(self.pack())
        return np.array(found)


def _check(plant: Plant) -> None:
    vehicle = plant.vehicle
    if vehicle.drive.kind != "crank" or not np.all(plant.parameters.joints.kind == k.PRESCRIBED):
        raise InputError(f"{vehicle.name}: hover needs a crank drive and joints that are all moved by the stroke")
    if min(vehicle.drive.frequencies) <= 0.0:
        raise InputError(f"{vehicle.name}: hover needs a crank that never stops: drive.frequencies above 0 Hz")
    if plant.layout.size > plant.layout.aerodynamics:
        raise InputError(f"{vehicle.name}: hover needs air loads without memory, not {vehicle.aerodynamics.model}")


def frequency_at(throttle: float, vehicle: SimulatedVehicle) -> float:
    """Return the steady frequency of a crank drive in Hz; the inverse of `throttle_for`."""
    table = vehicle.drive.frequencies
    return float(np.interp(throttle, np.linspace(0.0, 1.0, len(table)), table))


class HoverOrbit(NamedTuple):
    """Periodic flight, with the period of the stroke."""

    state: Floats
    """(size,); at the start of the stroke, see `BODY`"""
    inputs: Floats
    """(2,); throttle and elevator rad"""
    period: float
    """s"""
    residual: float
    """largest difference between start and end of a stroke, in the units of the state"""


def hover(vehicle: SimulatedVehicle, forward: float = 0.0, climb_rate: float = 0.0, step: float = STEP) -> HoverOrbit:
    """Find throttle, elevator and state of a periodic stroke, in hover or at a mean speed.

    Shooting method on the stroke map: the unknowns are velocities, pitch rate and pitch at the start of the stroke,
    throttle and elevator. The first four are periodic, and the mean velocity is the requested one. The search begins
    in hover with a level stroke plane and continues to the requested speed.

    Args:
        forward, climb_rate: m/s; mean velocity over the ground. step: s; of the integrator.

    Raises:
        InputError: no such orbit was found within the drive's and the elevator's range.
    """
    stroke = HoverMap(vehicle, step=step)
    middle = throttle_for(vehicle.cruise.frequency, vehicle)
    x = np.array((0.0, 0.0, 0.0, level_pitch(stroke.plant), middle, 0.0))
    reached = 0.0
    for share in np.linspace(0.0, 1.0, 1 + math.ceil(math.hypot(forward, climb_rate) / STRIDE)):
        found = root(_missing, x, args=(stroke, share * forward, share * climb_rate), options={"xtol": 1e-12})
        if not (found.success and 0.0 < found.x[4] < 1.0 and abs(found.x[5]) <= vehicle.tail_servo.travel):
            break
        x, reached = found.x, share
    residual = float(np.max(np.abs(_missing(x, stroke, forward, climb_rate))))
    if not residual < 1e-7:
        throttle, elevator = found.x[4:]
        raise InputError(
            f"{vehicle.name}: no flight at {forward:g} m/s climbing {climb_rate:g} m/s with throttle 0 to 1 and"
            f" elevator within {vehicle.tail_servo.travel:g} rad: beyond {reached * forward:.2g} m/s climbing"
            f" {reached * climb_rate:.2g} m/s the search comes to {throttle:.2f} and {elevator:.2f} rad"
        )
    state, inputs = _placed(x, stroke)
    return HoverOrbit(state, inputs, stroke.period(state, inputs), residual)


def _placed(x: Floats, stroke: HoverMap) -> tuple[Floats, Floats]:
    """Return state and inputs of the six unknowns: u, w, q, pitch, throttle, elevator."""
    state = np.zeros(stroke.size)
    state[:X] = x[:4]
    return stroke.start(state, x[4:]), x[4:]


def _missing(x: Floats, stroke: HoverMap, forward: float, climb_rate: float) -> Floats:
    """Return the residual (6,): periodicity, and mean velocity in m/s less the requested one."""
    state, inputs = _placed(x, stroke)
    end = stroke(state, inputs)
    period = stroke.period(state, inputs)
    return np.concatenate((end[:X] - state[:X], (end[X] / period - forward, end[Z] / period + climb_rate)))


def level_pitch(plant: Plant) -> float:
    """Return the pitch in rad at which the stroke plane of the right wing's first joint is level."""
    body = int(np.flatnonzero(plant.mechanism.tree.coordinate == plant.layout.flap[1] - k.COORDINATES)[0])
    axis = plant.mechanism.tree.rotation[body] @ plant.mechanism.tree.axis[body]
    return math.atan2(-axis[0], axis[2])


class HoverModel(NamedTuple):
    """Stroke map linearized about an orbit: z[n + 1] = A z[n] + B v[n] of deviations."""

    a: Floats
    """(n, n)"""
    b: Floats
    """(n, 2)"""
    period: float
    """s"""


def linearize(vehicle: SimulatedVehicle, orbit: HoverOrbit, step: float = STEP) -> HoverModel:
    """Linearize the stroke map about ``orbit`` by central differences."""
    stroke, n = HoverMap(vehicle, step=step), len(orbit.state)
    columns = []
    for i in range(n + len(INPUTS)):
        ends = []
        size = 1e-5 * max(1.0, abs(float(orbit.state[i]))) if i < n else 1e-5
        for sign in (1.0, -1.0):
            moved = np.concatenate((orbit.state, orbit.inputs))
            moved[i] += sign * size
            ends.append(stroke(moved[:n], moved[n:]))
        columns.append((ends[0] - ends[1]) / (2.0 * size))
    whole = np.array(columns).T
    return HoverModel(whole[:, :n], whole[:, n:], orbit.period)


def state_space(model: HoverModel) -> Any:
    """Convert the model to a python-control ``StateSpace`` with one sample per stroke; outputs are the states."""
    import control  # takes half a second, which a flight need not wait for

    n = len(model.a)
    return control.ss(model.a, model.b, np.eye(n), np.zeros((n, len(INPUTS))), model.period)


def growth(model: HoverModel) -> complex:
    """Return the largest growth rate of the open-loop body motion in 1/s (Floquet exponent)."""
    exponents = np.log(np.linalg.eigvals(model.a[:X, :X]).astype(complex)) / model.period
    return complex(max(exponents, key=lambda exponent: (exponent.real, exponent.imag)))


def position_gain(model: HoverModel, tolerances: Floats, authority: Floats) -> Floats:
    """Compute the gain (2, n) of the linear-quadratic regulator of the stroke map (`control.dlqr`): v = -K z.

    Args:
        tolerances: (7,) of `BODY`, each in its unit: deviations of equal cost; infinite for no cost.
        authority: (2,) of throttle and elevator rad, likewise.
    """
    import control

    weights = np.zeros(len(model.a))
    weights[: len(BODY)] = tolerances**-2.0
    gain, _, _ = control.dlqr(model.a, model.b, np.diag(weights), np.diag(authority**-2.0))
    return np.asarray(gain, dtype=np.float64)


def fly(vehicle: SimulatedVehicle, orbit: HoverOrbit, start: Floats, gain: Floats, strokes: int) -> Floats:
    """Simulate the nonlinear plant with feedback once a stroke; states (strokes + 1, n) at the starts of strokes.

    ``start`` (n,) is the first state; ``gain`` (2, n) as of `position_gain`, zeros for an open loop. Throttle and
    elevator are limited to their range.
    """
    stroke, travel = HoverMap(vehicle), vehicle.tail_servo.travel
    course = [start]
    for _ in range(strokes):
        wanted = orbit.inputs - gain @ (course[-1] - orbit.state)
        course.append(stroke(course[-1], np.clip(wanted, (0.0, -travel), (1.0, travel))))
    return np.array(course)


class OpenLoop(NamedTuple):
    """Flight with constant throttle and elevator, sampled within the strokes."""

    time: Floats
    """(m,) s"""
    states: Floats
    """(m, n)"""

    @property
    def sink_rate(self) -> Floats:
        """Sink rate (m,) in m/s; down positive."""
        pitch = self.states[:, PITCH]
        return np.asarray(np.cos(pitch) * self.states[:, W] - np.sin(pitch) * self.states[:, U])


def open_loop(vehicle: SimulatedVehicle, orbit: HoverOrbit, frequency: float, strokes: int) -> OpenLoop:
    """Simulate from the orbit's state with its elevator, with a flapping frequency of ``frequency`` Hz."""
    stroke = HoverMap(vehicle)
    inputs = np.array((throttle_for(frequency, vehicle), orbit.inputs[ELEVATOR]))
    courses = [stroke.start(orbit.state, inputs)[None]]
    for _ in range(strokes):
        courses.append(stroke.course(courses[-1][-1], inputs)[1:])
    states = np.concatenate(courses)
    return OpenLoop(np.arange(len(states)) / (frequency * stroke.pieces), states)


def air_power(vehicle: SimulatedVehicle, orbit: HoverOrbit) -> float:
    """Compute the mean aerodynamic power of the wings in W, without apparent mass, whose mean power is zero."""
    stroke = HoverMap(vehicle)
    plant = stroke.plant
    stroke.unpack(orbit.state)
    controls = stroke.controls(orbit.state, orbit.inputs)
    total = 0.0
    for _ in range(stroke.pieces):
        plant.advance(controls, stroke.around)
        plant.evaluate(controls, stroke.around)
        motion, load = plant.scratch.wings.motion, plant.scratch.wings.loads.parts.sum(axis=0)
        work = load[UPWARD] * motion.down - load[FORWARD] * motion.along - load[NOSE_UP] * motion.pitch_rate
        total += float(np.sum(work))
    return total / stroke.pieces
