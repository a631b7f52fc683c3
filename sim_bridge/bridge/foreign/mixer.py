"""A plane's outputs -> our actuators, by the flight vehicle's own mixing: throttle is flapping, the rest is the tail.

The aileron is the roll command of the vehicle's tail mixer (`avionics.mixing.tail`): its share of rudder, and its
share of stroke asymmetry where the wings roll it. The rudder channel adds to that.
"""

from __future__ import annotations

from typing import NamedTuple

from avionics.messages import ActuatorCommand, FlapCommand
from avionics.mixing import flapping, tail
from avionics.vehicles.loader import FlightVehicle
from sim_bridge.bridge.foreign.outputs import Outputs


class Gains(NamedTuple):
    """Parameters of the mixer."""

    flapping: flapping.Gains
    """throttle to stroke"""
    tail: tail.Gains
    """shares and travel"""
    elevator_trim: float
    """rad; elevator of level flight, at the middle of its channel"""


class State(NamedTuple):
    """State of the mixer."""

    flapping: flapping.State = flapping.State()
    tail: tail.State = tail.State()


def gains_of(vehicle: FlightVehicle) -> Gains:
    """Return the mixer's parameters from those of the flight vehicle."""
    return Gains(vehicle.gains.flapping, vehicle.gains.tail, vehicle.gains.pitch.elevator_trim)


def step(
    gains: Gains, state: State, time_us: int, dt: float, outputs: Outputs
) -> tuple[State, FlapCommand, ActuatorCommand]:
    """Advance by ``dt`` s; disarmed wings glide to rest and the tail still moves."""
    asked = tail.TailCommand(
        _elevator(gains, outputs.elevator), outputs.aileron, 0.0, 0.0, _rudder(gains, outputs.rudder), 0
    )
    tail_state, moved = tail.step(gains.tail, state.tail, dt, asked)
    throttle = outputs.throttle if outputs.armed else 0.0
    flap_state, flap, stroke = flapping.step(gains.flapping, state.flapping, time_us, dt, throttle, moved.asymmetry)
    command = ActuatorCommand(time_us, *stroke, moved.elevator, moved.rudder, outputs.armed)
    return State(flap_state, tail_state), flap, command


def elevator_output(gains: Gains, elevator: float) -> float:
    """Return the output, -1 to 1, for an elevator angle in rad: the inverse of the mixer."""
    travel = (
        gains.tail.elevator_max if elevator > gains.elevator_trim else gains.tail.elevator_min
    ) - gains.elevator_trim
    return min(max((elevator - gains.elevator_trim) / abs(travel), -1.0), 1.0)


def _elevator(gains: Gains, control: float) -> float:
    """Return the elevator angle in rad: linear from the trim to the end of the travel on either side."""
    end = gains.tail.elevator_max if control > 0.0 else gains.tail.elevator_min
    return gains.elevator_trim + abs(control) * (end - gains.elevator_trim)


def _rudder(gains: Gains, control: float) -> float:
    return gains.tail.rudder_max * control
