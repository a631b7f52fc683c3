"""Manual flight as the flight computer does it: stick inputs to actuator commands, compiled.

Only what the outputs depend on in MANUAL: rates and limits of the loops that follow the sticks, tail mixer, stroke
generator and quantization on the wire. `avionics.mixing`, `avionics.tasks` and `avionics.link.codec` are the
reference, and a test compares the two. Failsafes are not part of it.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from sim_bridge.compiled import inlined
from sim_bridge.vectors import Floats

PERIOD = 0.005
"""s; of a tick of the flight computer"""
VERTICAL_EVERY, ATTITUDE_EVERY, ATTITUDE_PHASE = 4, 2, 1
"""ticks; period of the throttle loop, period and phase of the pitch and roll loops"""

# Columns of the memory of one vehicle.
THROTTLE, ELEVATOR, ROLL, TAIL_ELEVATOR, TAIL_RUDDER, PHASE, FREQUENCY, ENVELOPE, AMPLITUDE = range(9)
MEMORY = 9

# Columns of an actuator command.
WING_LEFT, WING_RIGHT, MOTOR, TAIL_UP, TAIL_RIGHT = range(5)
COMMAND = 5

# Columns of the sticks.
PITCH_STICK, ROLL_STICK, YAW_STICK, THROTTLE_STICK = range(4)


class ManualGains(NamedTuple):
    """Parameters of the flight computer that act in MANUAL."""

    throttle_rate: float
    """1/s"""
    elevator_trim: float
    """rad"""
    elevator_min: float
    """rad; of the pitch loop"""
    elevator_max: float
    """rad; of the pitch loop, and per unit of the stick"""
    rudder_share: float
    """rad; rudder at full roll command"""
    yaw_share: float
    """rad; rudder at full yaw stick"""
    asymmetry_share: float
    """-; stroke asymmetry at full roll command"""
    tail_min: float
    """rad; elevator limits of the tail mixer, as the next"""
    tail_max: float
    rudder_max: float
    """rad"""
    servo_rate: float
    """rad/s"""
    motor: bool
    """whether a motor turns a crank; otherwise each wing has a position servo"""
    throttle_cut: float
    """-; throttle below which the wings glide"""
    throttle_points: Floats
    """-; throttle at the points of the frequency map, rising"""
    frequency_points: Floats
    """Hz"""
    amplitude_points: Floats
    """rad"""
    frequency_rate: float
    """Hz/s"""
    start_time: float
    """s"""
    mean_angle: float
    """rad"""
    glide_angle: float
    """rad"""
    travel_min: float
    """rad"""
    travel_max: float
    """rad"""
    full_deflection: float
    """rad; angle of a control of 1 on the wire"""


@inlined
def _clip(value: float, low: float, high: float) -> float:
    return min(max(value, low), high)


@inlined
def _slew(previous: float, target: float, rate: float, dt: float) -> float:
    return _clip(target, previous - rate * dt, previous + rate * dt)


@inlined
def _interpolate(x: float, xs: Floats, ys: Floats) -> float:
    """Linear interpolation, constant outside the range."""
    last = xs.shape[0] - 1
    if x <= xs[0]:
        return float(ys[0])
    for i in range(1, last + 1):
        if x <= xs[i]:
            return float(ys[i - 1] + (ys[i] - ys[i - 1]) * (x - xs[i - 1]) / (xs[i] - xs[i - 1]))
    return float(ys[last])


@inlined
def control(gains: ManualGains, tick: int, sticks: Floats, memory: Floats, command: Floats) -> None:
    """Compute the ``command`` (5,) of the flight computer's ``tick`` from the ``sticks`` (4,); update ``memory``."""
    if tick % VERTICAL_EVERY == 0:
        target = _clip(sticks[THROTTLE_STICK], 0.0, 1.0)
        memory[THROTTLE] = _slew(memory[THROTTLE], target, gains.throttle_rate, VERTICAL_EVERY * PERIOD)
    if tick % ATTITUDE_EVERY == ATTITUDE_PHASE:
        elevator = gains.elevator_trim + gains.elevator_max * sticks[PITCH_STICK]
        memory[ELEVATOR] = _clip(elevator, gains.elevator_min, gains.elevator_max)
        memory[ROLL] = _clip(sticks[ROLL_STICK], -1.0, 1.0)
    _mix_tail(gains, sticks[YAW_STICK], memory)
    _stroke(gains, _clip(memory[THROTTLE], 0.0, 1.0), memory, command)
    command[TAIL_UP], command[TAIL_RIGHT] = memory[TAIL_ELEVATOR], memory[TAIL_RUDDER]
    for i in range(COMMAND):
        scale = 1.0 if i == MOTOR else gains.full_deflection
        command[i] = float(np.float32(_clip(command[i] / scale, -1.0, 1.0))) * scale


@inlined
def _mix_tail(gains: ManualGains, yaw_stick: float, memory: Floats) -> None:
    """Tail mixer, see `avionics.mixing.tail.step`."""
    rudder = gains.rudder_share * memory[ROLL] + gains.yaw_share * yaw_stick
    rudder = _clip(rudder, -gains.rudder_max, gains.rudder_max)
    elevator = _clip(memory[ELEVATOR], gains.tail_min, gains.tail_max)
    memory[TAIL_ELEVATOR] = _slew(memory[TAIL_ELEVATOR], elevator, gains.servo_rate, PERIOD)
    memory[TAIL_RUDDER] = _slew(memory[TAIL_RUDDER], rudder, gains.servo_rate, PERIOD)


@inlined
def _stroke(gains: ManualGains, throttle: float, memory: Floats, command: Floats) -> None:
    """Stroke generator, see `avionics.mixing.flapping.step`."""
    flapping = throttle >= gains.throttle_cut and throttle > 0.0
    requested = _interpolate(throttle, gains.throttle_points, gains.frequency_points) if flapping else 0.0
    if gains.motor:
        memory[PHASE] = (memory[PHASE] + 2.0 * math.pi * requested * PERIOD) % (2.0 * math.pi)
        command[WING_LEFT], command[WING_RIGHT] = 0.0, 0.0
        command[MOTOR] = throttle if flapping else 0.0
        return
    before = memory[ENVELOPE]
    envelope = _slew(before, 1.0 if flapping else 0.0, 1.0 / gains.start_time, PERIOD)
    memory[FREQUENCY] = _frequency(gains, memory[FREQUENCY], before, envelope, requested)
    turned = memory[PHASE] + 2.0 * math.pi * memory[FREQUENCY] * PERIOD
    memory[PHASE] = turned % (2.0 * math.pi) if envelope > 0.0 else 0.0
    if flapping:
        memory[AMPLITUDE] = _interpolate(throttle, gains.throttle_points, gains.amplitude_points)
    memory[ENVELOPE] = envelope
    mean = gains.glide_angle + (gains.mean_angle - gains.glide_angle) * envelope
    swing = memory[AMPLITUDE] * envelope * math.sin(memory[PHASE])
    asymmetry = gains.asymmetry_share * memory[ROLL]
    command[WING_LEFT] = _clip(mean + swing * (1.0 + asymmetry), gains.travel_min, gains.travel_max)
    command[WING_RIGHT] = _clip(mean + swing * (1.0 - asymmetry), gains.travel_min, gains.travel_max)
    command[MOTOR] = 0.0


@inlined
def _frequency(gains: ManualGains, last: float, before: float, envelope: float, requested: float) -> float:
    if envelope <= 0.0:
        return 0.0
    if before <= 0.0:
        return requested
    return _slew(last, requested, gains.frequency_rate, PERIOD) if requested > 0.0 else last
