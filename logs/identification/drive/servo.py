"""What a fit of the drives hands back, whichever of Gerdes' equations it is of."""

from __future__ import annotations

from typing import NamedTuple

from logs.identification.results import Estimate, Unidentified


class ServoModel(NamedTuple):
    """One fitted servo model."""

    estimates: tuple[Estimate, ...]
    """what the data gives"""
    unidentified: tuple[Unidentified, ...]
    """what it does not, and why"""
    centre_current: float
    """A; C_D, added to the current of one servo (0 for the torque)"""
    centre_voltage: float
    """V; C_E, added to the voltage (0 for the torque)"""
    residual: float
    """N m or W; standard deviation"""
    samples: int
    """-; bursts or strokes"""


class ServoResult(NamedTuple):
    """Torque and power model of the drive servos; None for one that was not asked for."""

    torque: ServoModel | None
    power: ServoModel | None
