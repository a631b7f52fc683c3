"""The plant in a wind tunnel: the body's motion is imposed, the servos drive the wings.

What goes in is what a pilot and a battery give, the commanded stroke and the voltage; what comes out is what the
instruments of Gerdes 2017 saw in flight: the wing's motion, torque, current and power. The body is held at the speed
and climb of the flight, pitched until the wings carry the all-up weight.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from sim_bridge import plant_kernel as k
from sim_bridge.aerodynamics.protocol import MASS
from sim_bridge.mechanism import total_mass, wing_strips
from sim_bridge.multibody.wings import wing_places
from sim_bridge.plant import Plant
from sim_bridge.vectors import Floats, rotation
from sim_bridge.vehicles import SimulatedVehicle
from wingbeat.constants import STANDARD_GRAVITY
from wingbeat.errors import InputError

INTERVALS = 125
"""intervals of a stroke over which the commanded angle is linear, and samples of the record"""
LEVELLING = 10
"""strokes over which the angle of attack is adjusted for lift equal to weight"""
SETTLING = 3
"""further strokes before the recorded one"""
DENSITY = 1.225
"""kg/m^3; at sea level"""
HOLDING = 150.0
"""rad/s; bandwidth of ideal drives: six times the flapping at 4 Hz, a seventh of the integrator's rate"""
BISECTIONS = 10
"""bisection steps of the reachable stroke: a thousandth of the commanded one"""
STEEPEST = 1.2
"""rad; limit of the angle of attack in the search for lift equal to weight"""


class Stream(NamedTuple):
    """Prescribed flight condition."""

    airspeed: float
    """m/s"""
    climb_rate: float
    """m/s"""
    frequency: float
    """Hz; of the commanded stroke"""
    amplitude: float
    """rad; half of the commanded stroke, a sine about the vehicle's ``cruise.stroke_mean``"""
    voltage: float
    """V; at the drives, constant"""


class Record(NamedTuple):
    """One stroke of the right wing and the loads of both wings; arrays (`INTERVALS`,) in equal time steps."""

    angle_of_attack: float
    """rad; of the body"""
    period: float
    """s"""
    command: Floats
    """rad"""
    flap: Floats
    """rad"""
    rate: Floats
    """rad/s; of the flap angle"""
    twist: Floats
    """rad; of the tip"""
    torque: Floats
    """N m; of one drive, mean over the step that ends at the sample, as the next two"""
    power: Floats
    """W; mechanical, of one drive: torque times rate"""
    current: Floats
    """A; of both drives"""
    lift: Floats
    """N; vertical, of both wings, with apparent mass"""
    thrust: Floats
    """N; forward and horizontal, with apparent mass"""


class Tunnel:
    """Vehicle with servo drives, fixed in the stream."""

    def __init__(self, vehicle: SimulatedVehicle, stream: Stream) -> None:
        """Build the plant with a supply of constant voltage.

        Raises:
            InputError: the vehicle's wings are not driven by servos, or do not twist; or the climb is above the
                speed.
        """
        if vehicle.drive.kind != "servo" or not vehicle.wing.twists:
            raise InputError(f"{vehicle.name}: the wind tunnel takes wings that twist and are driven by servos")
        if not abs(stream.climb_rate) < stream.airspeed:
            raise InputError(
                f"climb_rate = {stream.climb_rate:g} m/s is not below airspeed = {stream.airspeed:g} m/s"
            )
        supply = vehicle.battery._replace(full_voltage=stream.voltage, empty_voltage=stream.voltage, resistance=0.0)
        self.vehicle, self.stream = vehicle, stream
        self.plant = Plant(vehicle._replace(battery=supply))
        self.plant.y[2] = -1000.0
        self.around = k.Surroundings(0.0, 0.0, 0.0, DENSITY, k.HELD, 0.0, 0.0, 0.0)

    def point(self, angle_of_attack: float) -> None:
        """Set the angle of attack of the body in rad, with the flight path of the stream."""
        y, speed = self.plant.y, self.stream.airspeed
        pitch = angle_of_attack + math.asin(self.stream.climb_rate / speed)
        y[3:7] = math.cos(pitch / 2), 0.0, math.sin(pitch / 2), 0.0
        y[7:10] = speed * math.cos(angle_of_attack), 0.0, speed * math.sin(angle_of_attack)
        rotation(y[3], y[4], y[5], y[6], self.plant.scratch.r)

    def command(self) -> Floats:
        """(`INTERVALS` + 1,) rad; commanded stroke from its middle."""
        phase = 2.0 * math.pi * np.arange(INTERVALS + 1) / INTERVALS
        return np.asarray(self.vehicle.cruise.stroke_mean + self.stream.amplitude * np.sin(phase))

    def stroke(self, angle_of_attack: float) -> Record:
        """Simulate one stroke."""
        self.point(angle_of_attack)
        command, period = self.command(), 1.0 / self.stream.frequency
        layout, rows, forces = self.plant.layout, [], []
        flap, twist = layout.flap[1], layout.twist[1]
        step = period / INTERVALS
        for start, end in zip(command[:-1].tolist(), command[1:].tolist(), strict=True):
            controls = k.Controls(start, end, start, end, 0.0, 0.0, 0.0, step, 1.0)
            before = float(self.plant.y[flap])
            means = self.plant.advance(controls, self.around)
            y = self.plant.y
            power = means.torque_right * (y[flap] - before) / step
            rows.append((end, y[flap], y[layout.rate(flap)], y[twist], means.torque_right, power, means.current))
            forces.append(self._sections())
        lift, thrust = self._lift_and_thrust(forces, period)
        return Record._make((angle_of_attack, period, *np.array(rows).T, lift, thrust))

    def _sections(self) -> Floats:
        """Return (14, n): force along chord, normal and span in N, those axes, mid-chord speed, apparent mass."""
        mechanism, scratch = self.plant.mechanism, self.plant.scratch
        wing_places(scratch.tree, mechanism.wings, scratch.wings)
        motion, loads = scratch.wings.motion, scratch.wings.loads
        axes = motion.axes[[1, 2, 0]].reshape(9, -1)
        return np.concatenate((loads.parts.sum(axis=0)[:3], axes, [motion.down, loads.apparent[MASS]]))

    def _lift_and_thrust(self, sections: list[Floats], period: float) -> tuple[Floats, Floats]:
        """Return lift and thrust of both wings over a periodic stroke: (`INTERVALS`,) each."""
        table = np.array(sections)
        force, axes, down, apparent = table[:, :3], table[:, 3:12], table[:, 12], table[:, 13]
        # The apparent mass resists the derivative of the normal speed.
        step = period / INTERVALS
        force[:, 1] += apparent * (np.roll(down, -1, axis=0) - np.roll(down, 1, axis=0)) / (2.0 * step)
        body = np.einsum("tcn,tcin->ti", force, axes.reshape(len(table), 3, 3, -1))
        earth = body @ self.plant.scratch.r.T
        return -earth[:, 2], earth[:, 0]


def fly(vehicle: SimulatedVehicle, stream: Stream, angle_of_attack: float | None = None) -> Record:
    """Return a settled stroke at an angle of attack, or at the one of mean lift equal to weight.

    Raises:
        InputError: see `Tunnel`; or the wings cannot carry the vehicle.
    """
    tunnel = Tunnel(vehicle, stream)
    if angle_of_attack is not None:
        return [tunnel.stroke(angle_of_attack) for _ in range(SETTLING + 1)][-1]
    record = levelled(tunnel)
    weight, lift = total_mass(vehicle) * STANDARD_GRAVITY, float(np.mean(record.lift))
    if abs(lift - weight) > 0.1 * weight:
        raise InputError(
            f"{vehicle.name}: the wings do not carry {weight:.2f} N at {stream.airspeed:g} m/s"
            f" ({lift:.2f} N at {record.angle_of_attack:.2f} rad)"
        )
    return record


def levelled(tunnel: Tunnel) -> Record:
    """Return a settled stroke at the angle of attack whose mean lift is closest to the weight.

    The angle is adjusted from stroke to stroke by the secant method.
    """
    strips, speed = tunnel.plant.mechanism.wings.strips, tunnel.stream.airspeed
    steady = 0.5 * DENSITY * speed**2 * float(strips.chord @ strips.width) * math.pi
    weight, alpha, slope, before = total_mass(tunnel.vehicle) * STANDARD_GRAVITY, 0.1, steady, (0.0, 0.0)
    for stroke in range(LEVELLING):
        lift = float(np.mean(tunnel.stroke(alpha).lift))
        if stroke > 1 and abs(alpha - before[0]) > 1e-4:
            # The lift of a stroke lags, so the slope is limited to 0.2 to 1 times the steady slope.
            slope = min(max((lift - before[1]) / (alpha - before[0]), 0.2 * steady), steady)
        before = (alpha, lift)
        alpha = min(max(alpha + (weight - lift) / slope, -STEEPEST), STEEPEST)
    return [tunnel.stroke(alpha) for _ in range(SETTLING)][-1]


class Measures(NamedTuple):
    """Measured quantities of a stroke, of both drives together unless stated otherwise."""

    angle_of_attack: float
    """rad; of the body"""
    amplitude: float
    """rad; peak to peak, of the flap angle"""
    plunge_speed: float
    """rad/s; maximum"""
    overshoot: float
    """-; overshoot of the plunge speed, see `overshoot_of`"""
    twist: float
    """rad; half of the tip's peak-to-peak twist"""
    torque: float
    """N m; mean magnitude, of one drive"""
    positive_power: float
    """W; mean of the positive mechanical power of the drives, without the returned power"""
    net_power: float
    """W; mean mechanical power, less the returned power"""
    current: float
    """A; mean"""
    electrical_power: float
    """W; mean, into the drives"""
    lift: float
    """N; mean"""
    thrust: float
    """N; mean"""


def measure(record: Record, stream: Stream) -> Measures:
    """Reduce a stroke to the quantities of Gerdes 2017."""
    power = 2.0 * record.power
    current = float(np.mean(record.current))
    return Measures(
        record.angle_of_attack,
        float(np.ptp(record.flap)),
        float(np.max(np.abs(record.rate))),
        max(overshoot_of(record.rate), overshoot_of(-record.rate)),
        0.5 * float(np.ptp(record.twist)),
        float(np.mean(np.abs(record.torque))),
        float(np.mean(np.maximum(power, 0.0))),
        float(np.mean(power)),
        current,
        current * stream.voltage,
        float(np.mean(record.lift)),
        float(np.mean(record.thrust)),
    )


def overshoot_of(rate: Floats) -> float:
    """Compute the relative overshoot of the plunge speed's first peak over the minimum before its last one.

    Gerdes Table 6. ``rate`` (n,) in rad/s over a periodic stroke; the positive part is used. 0 for a single peak.
    """
    start = int(np.argmin(rate))
    half = np.roll(rate, -start)
    half = half[half > 0.0]
    inner = half[1:-1]
    peaks = np.flatnonzero((inner > half[:-2]) & (inner >= half[2:])) + 1
    if len(peaks) < 2:
        return 0.0
    return float(half[peaks[0]] / np.min(half[peaks[0] : peaks[-1] + 1]) - 1.0)


def rate_error(record: Record) -> float:
    """Compute the RMS difference of commanded and actual flap rate, relative to the RMS of the command."""
    step = record.period / len(record.command)
    wanted = (np.roll(record.command, -1) - np.roll(record.command, 1)) / (2.0 * step)
    return float(np.sqrt(np.mean((wanted - record.rate) ** 2) / np.mean(wanted**2)))


def stiffened(vehicle: SimulatedVehicle) -> SimulatedVehicle:
    """Return the vehicle with unlimited drives that follow the commanded stroke: Gerdes' kinematics only.

    The loop is critically damped at `HOLDING` for the inertia of the flat wing about its hinge, apparent mass
    included.
    """
    inertia = hinge_inertia(vehicle)
    ideal = vehicle.drive._replace(
        stall_torque=400.0,
        no_load_speed=1000.0,
        position_gain=inertia * HOLDING**2,
        rate_gain=2.0 * inertia * HOLDING,
    )
    return vehicle._replace(drive=ideal)


def hinge_inertia(vehicle: SimulatedVehicle) -> float:
    """Compute the inertia in kg m^2 of a flat wing about its hinge: spar, membrane and apparent mass."""
    strips, membrane = wing_strips(vehicle.wing)
    spar = vehicle.bodies[vehicle.wing.right]
    apparent = DENSITY * math.pi * strips.chord**2 / 4.0 * strips.width
    both = float(np.sum((membrane + apparent) * strips.span**2))
    return 0.5 * both + spar.inertia[0] + spar.mass * spar.center[1] ** 2


def demand(record: Record, vehicle: SimulatedVehicle) -> float:
    """Compute the largest ratio of required torque to the limit of a drive of ``vehicle``; above 1 it is out of
    reach.

    The limit along the motion is the line from stall torque to no-load speed; in braking it is the stall torque (Fig.
    9).
    """
    drive = vehicle.drive
    driving = np.abs(record.torque) / drive.stall_torque
    along = record.torque * record.rate > 0.0
    return float(np.max(driving + np.where(along, np.abs(record.rate) / drive.no_load_speed, 0.0)))


def reachable_stroke(vehicle: SimulatedVehicle, stream: Stream, angle_of_attack: float) -> float:
    """Compute the half amplitude in rad of the largest sinusoidal stroke that the drives can follow (Gerdes Fig.
    16).

    Torque and speed of the exact stroke are compared with the drives' line at every instant; the amplitude is reduced
    by bisection. The voltage of the drives is their nominal one.
    """
    stiff, low, high = stiffened(vehicle), 0.0, stream.amplitude
    if demand(fly(stiff, stream, angle_of_attack), vehicle) <= 1.0:
        return high
    for _ in range(BISECTIONS):
        middle = 0.5 * (low + high)
        needed = demand(fly(stiff, stream._replace(amplitude=middle), angle_of_attack), vehicle)
        low, high = (middle, high) if needed <= 1.0 else (low, middle)
    return low
