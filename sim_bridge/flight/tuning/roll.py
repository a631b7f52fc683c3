"""Roll loop: roll command, the rudder's share of it and its servo, the dihedral, sampled at 100 Hz."""

from __future__ import annotations

from typing import Any

from avionics import control_laws
from sim_bridge.flight.tuning import attitude
from sim_bridge.flight.tuning.aircraft import Aircraft, lateral, loop_delay
from sim_bridge.tuning import blocks
from sim_bridge.tuning.loop import Process, Terms, pick


def system(aircraft: Aircraft) -> Any:
    """Build the open system: roll_asked to roll, roll_rate and yaw_rate."""
    parts = [lateral(aircraft), blocks.delay(loop_delay(attitude.RATE), "roll_asked", "roll_command")]
    return blocks.joined(parts, ["roll_asked"], ["roll", "roll_rate", "yaw_rate"])


def process(aircraft: Aircraft) -> Process:
    """Build the process of the roll loop."""
    whole = system(aircraft)
    measured = pick(whole, "roll_asked", "roll", "roll_rate")
    return Process(pick(whole, "roll_asked", "roll"), measured, setpoint_weight=setpoint_weight(aircraft))


def closed(aircraft: Aircraft) -> Any:
    """Close the roll loop: roll_setpoint to roll and yaw_rate."""
    signals = ("roll_setpoint", "roll", "roll_rate", "roll_asked")
    loop = blocks.controller(terms(aircraft), signals, setpoint_weight(aircraft))
    return blocks.joined([system(aircraft), loop], ["roll_setpoint"], ["roll", "yaw_rate"])


def setpoint_weight(aircraft: Aircraft) -> float:
    """Return the setpoint weight of the vehicle's control law."""
    return control_laws.ROLL[aircraft.gains.roll.law].setpoint_weight


def terms(aircraft: Aircraft) -> Terms:
    """Return the gains of the loop at the airspeed of the model."""
    return attitude.terms(aircraft.gains.roll, aircraft.model.airspeed)


def tuned(aircraft: Aircraft) -> Aircraft:
    """Design the roll loop.

    Raises:
        InputError: no gains meet the margins.
    """
    gains = attitude.designed(aircraft, process(aircraft), aircraft.gains.roll)
    return aircraft._replace(gains=aircraft.gains._replace(roll=gains))
