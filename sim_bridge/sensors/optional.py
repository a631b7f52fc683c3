"""The table of sensors that a vehicle may lack; it is read without numba, which the flight computer does not load."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, NamedTuple, Protocol

from sim_bridge.observation import Observation
from sim_bridge.sensors.noise import SensorSeed
from sim_bridge.sensors.rangefinder import Rangefinder, RangefinderSpec
from sim_bridge.sensors.torque_cell_spec import TorqueCellSpec

TORQUE_RATE = 100.0
"""Hz; that of the power sensor"""
RANGE_RATE = 50.0
"""Hz"""


class OptionalSensor(Protocol):
    """A sensor that a vehicle may lack."""

    @property
    def errors(self) -> Any:
        """Errors of this unit for the whole flight, a NamedTuple in SI."""

    def read(self, observation: Observation) -> Any:
        """Return the sample of this tick, a field of `SensorFrame`, or None."""


class OptionalRow(NamedTuple):
    """One row of the table of optional sensors."""

    section: str
    """of the vehicle file"""
    spec: type[Any]
    """keys of the section"""
    build: Callable[[Any, SensorSeed], OptionalSensor]
    rate: float
    """Hz"""
    stream: int
    """number of its random stream: a new sensor takes the next free one, so that the noise of the others stays"""
    field: str
    """of `SensorFrame`"""
    fault: str = ""
    """name of the fault that silences it; empty for none"""


def _torque_cell(spec: TorqueCellSpec, seed: SensorSeed) -> OptionalSensor:
    from sim_bridge.sensors.torque_cell import TorqueCell  # loads numba

    return TorqueCell(spec, seed)


OPTIONAL: tuple[OptionalRow, ...] = (
    OptionalRow("torque_cell", TorqueCellSpec, _torque_cell, TORQUE_RATE, 6, "torque"),
    OptionalRow("rangefinder", RangefinderSpec, Rangefinder, RANGE_RATE, 9, "rangefinder", "rangefinder_lost"),
)  # fmt: skip
