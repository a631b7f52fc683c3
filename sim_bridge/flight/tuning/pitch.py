"""Pitch loop: elevator, its servo, the notch at the flapping frequency, sampled at 100 Hz."""

from __future__ import annotations

from typing import Any

from avionics import control_laws
from sim_bridge.flight.tuning import attitude
from sim_bridge.flight.tuning.aircraft import Aircraft, longitudinal, loop_delay
from sim_bridge.tuning import blocks
from sim_bridge.tuning.loop import Process, Terms, pick


def system(aircraft: Aircraft) -> Any:
    """Build the open system: elevator_command (and throttle) to pitch, climb, and the measured variables."""
    gains, frequency = aircraft.gains.pitch, aircraft.model.frequency
    width = gains.notch_width
    parts = [
        longitudinal(aircraft),
        blocks.delay(loop_delay(attitude.RATE), "elevator_command", "elevator"),
        blocks.notch(frequency, width, "pitch", "pitch_seen"),
        blocks.notch(frequency, width, "pitch_rate", "rate_notched"),
        blocks.lag(gains.rate_lag, "rate_notched", "rate_seen"),
    ]
    inputs = ["elevator_command", "throttle"] if aircraft.model.drive is not None else ["elevator_command"]
    return blocks.joined(parts, inputs, ["pitch", "climb", "pitch_seen", "rate_seen"])


def process(aircraft: Aircraft) -> Process:
    """Build the process of the pitch loop."""
    whole = system(aircraft)
    command = "elevator_command"
    measured = pick(whole, command, "pitch_seen", "rate_seen")
    return Process(pick(whole, command, "pitch"), measured, setpoint_weight=setpoint_weight(aircraft))


def closed(aircraft: Aircraft) -> Any:
    """Close the pitch loop: pitch_setpoint and throttle to pitch and climb."""
    signals = ("pitch_setpoint", "pitch_seen", "rate_seen", "elevator_command")
    loop = blocks.controller(terms(aircraft), signals, setpoint_weight(aircraft))
    return blocks.joined([system(aircraft), loop], ["pitch_setpoint", "throttle"], ["pitch", "climb"])


def setpoint_weight(aircraft: Aircraft) -> float:
    """Return the setpoint weight of the vehicle's control law."""
    return control_laws.PITCH[aircraft.gains.pitch.law].setpoint_weight


def terms(aircraft: Aircraft) -> Terms:
    """Return the gains of the loop at the airspeed of the model."""
    return attitude.terms(aircraft.gains.pitch, aircraft.model.airspeed)


def tuned(aircraft: Aircraft) -> Aircraft:
    """Design the pitch loop.

    Raises:
        InputError: no gains meet the margins.
    """
    gains = attitude.designed(aircraft, process(aircraft), aircraft.gains.pitch)
    return aircraft._replace(gains=aircraft.gains._replace(pitch=gains))
