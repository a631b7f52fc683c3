"""Stabilization tasks: pitch and roll loops."""

from __future__ import annotations

from typing import Final

from avionics import control_laws, topics
from avionics.guidance import excitation as excitation_input
from avionics.guidance.modes import AIRBORNE
from avionics.messages import (
    Failsafe,
    Mode,
)
from avionics.stabilization import pitch as pitch_loop
from avionics.stabilization import roll as roll_loop
from avionics.state import AutopilotState
from wingbeat.records import constructor
from wingbeat.topic import Publish

IMU_FAULT, MANUAL = int(Failsafe.IMU_FAULT), Mode.MANUAL


def loops_closed(s: AutopilotState) -> bool:
    """Return whether the attitude loops are active.

    They are inactive on the ground, before launch, in MANUAL, and without an IMU.
    """
    blind = s.modes.failsafe & IMU_FAULT
    return s.modes.stage in AIRBORNE and s.modes.mode != MANUAL and not blind


_new_pitch_measured: Final = constructor(pitch_loop.Measured)
_new_roll_measured: Final = constructor(roll_loop.Measured)


def pitch(s: AutopilotState, publish: Publish) -> None:
    """Advance the pitch loop: pitch setpoint to elevator."""
    gains, state, time_us, dt = s.gains.pitch, s.pitch_loop, s.clock.time_us, s.clock.dt_100
    law, attitude = control_laws.PITCH[gains.law], s.attitude
    measured = _new_pitch_measured(
        attitude.pitch, attitude.pitch_rate, s.wing.frequency, attitude.roll, s.air.airspeed
    )
    setpoint = s.altitude_loop_status.pitch_setpoint
    if not loops_closed(s):
        stick = s.pilot.pitch if s.modes.armed and s.modes.mode == MANUAL else 0.0
        elevator = gains.elevator_trim + gains.elevator_max * stick
        s.pitch_loop, s.pitch_loop_status = law.follow(gains, state, time_us, dt, elevator, measured)
    elif excitation_input.frozen(s.excitation):
        s.pitch_loop, s.pitch_loop_status = law.hold_trim(gains, state, time_us, dt, setpoint, measured)
    else:
        s.pitch_loop, s.pitch_loop_status = law.step(gains, state, time_us, dt, setpoint, measured)
    publish(topics.PITCH_LOOP, s.pitch_loop_status)


def roll(s: AutopilotState, publish: Publish) -> None:
    """Advance the roll loop: roll setpoint to roll command."""
    gains, state, time_us, setpoint = s.gains.roll, s.roll_loop, s.clock.time_us, s.heading_loop_status.roll_setpoint
    law = control_laws.ROLL[gains.law]
    measured = _new_roll_measured(s.attitude.roll, s.attitude.roll_rate, s.air.airspeed)
    if not loops_closed(s):
        stick = s.pilot.roll if s.modes.armed and s.modes.mode == MANUAL else 0.0
        s.roll_loop, s.roll_loop_status = law.follow(s.clock.time_us, stick)
    elif excitation_input.roll_frozen(s.excitation):
        s.roll_loop, s.roll_loop_status = law.hold_trim(gains, state, time_us, setpoint, measured)
    else:
        s.roll_loop, s.roll_loop_status = law.step(gains, state, time_us, s.clock.dt_100, setpoint, measured)
    publish(topics.ROLL_LOOP, s.roll_loop_status)
