"""The fit of each section of a map other than [modes] and [aero], and the example map of every subject."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import Any

from logs.identification.results import EstimationResult
from logs.identification.sources.table.config import EXAMPLE
from logs.identification.sources.table.maneuvers import Cut
from logs.identification.tables import benches, flight_paths, servos, strokes
from logs.identification.tables import load_cell_tests as stands
from logs.identification.tables.subjects import (
    AERO,
    ALL,
    MODES,
    PATH,
    POWER,
    SERVO,
    STAND,
    STROKE,
    TORQUE_SPEED,
    TWIST,
)

SectionFit = Callable[[Any, Cut, Mapping[str, float], float | None], list[EstimationResult]]
"""(section, maneuvers, constants, longest gap that is interpolated (s)) -> results"""

SECTION_FITS: dict[str, SectionFit] = {
    PATH: flight_paths.path_fit,
    STROKE: strokes.stroke_fits,
    STAND: stands.stand_fits,
    TORQUE_SPEED: benches.torque_speed_fit,
    TWIST: benches.twist_fits,
    SERVO: servos.servo_fit,
    POWER: servos.power_fit,
}
EXAMPLES: dict[str, str] = {
    MODES: EXAMPLE, AERO: EXAMPLE, ALL: EXAMPLE,
    PATH: flight_paths.EXAMPLE,
    STROKE: strokes.EXAMPLE,
    STAND: stands.EXAMPLE,
    TORQUE_SPEED: benches.TORQUE_SPEED_EXAMPLE,
    TWIST: benches.TWIST_EXAMPLE,
    SERVO: servos.SERVO_EXAMPLE,
    POWER: servos.POWER_EXAMPLE,
}  # fmt: skip
"""by subject; output of `wingbeat identify --map-example SUBJECT`"""
