"""Stick deflections and their MAVLink message, MANUAL_CONTROL."""

from __future__ import annotations

from typing import Any, NamedTuple

from avionics.link.dialect import mavlink

FULL_SCALE = 1000
"""-; MANUAL_CONTROL at full deflection"""


class Sticks(NamedTuple):
    """The pilot's sticks."""

    roll: float
    """-; -1 left to 1 right"""
    pitch: float
    """-; -1 stick forward (nose down) to 1 stick back (nose up)"""
    yaw: float
    """-; -1 left to 1 right"""
    throttle: float
    """-; 0 to 1"""


def manual_control(system: int, sticks: Sticks) -> Any:
    """Build the MANUAL_CONTROL message for this system; x is positive with the stick forward.

    The button mask is 0: buttons are translated to commands on the ground, a mask might trigger functions twice.
    """
    x, y, z, r = (round(FULL_SCALE * value) for value in (-sticks.pitch, sticks.roll, sticks.throttle, sticks.yaw))
    return mavlink.MAVLink_manual_control_message(system, x, y, z, r, 0)
