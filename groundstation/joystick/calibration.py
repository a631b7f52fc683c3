"""Calibration of a device: measured ranges, assignment of sticks, and the settings that result."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from typing import NamedTuple

from groundstation.joystick.actions import Assignments
from groundstation.joystick.axes import MIN_TRAVEL, Axis
from groundstation.joystick.device import DeviceInfo, Reading
from groundstation.joystick.settings import Settings
from wingbeat.errors import InputError

DEFAULT_DEADZONE = 0.03
"""-; of the sticks of a device without settings"""
IDENTIFIED = 0.5
"""-; least deflection of the axis that a moved stick is on, as a fraction of its travel"""
END_MARGIN = 0.02
"""-; of the travel, that is taken off each end so that every stick reaches full deflection"""


class Ranges(NamedTuple):
    """Least and greatest raw value of every axis."""

    low: tuple[float, ...]
    high: tuple[float, ...]

    def extended(self, reading: Reading) -> Ranges:
        """Return the ranges that include ``reading``."""
        return Ranges(tuple(map(min, self.low, reading.axes)), tuple(map(max, self.high, reading.axes)))

    def moved(self) -> tuple[int, ...]:
        """Return the axes with a travel of twice `MIN_TRAVEL` or more."""
        pairs = enumerate(zip(self.low, self.high, strict=True))
        return tuple(number for number, (low, high) in pairs if high - low >= 2.0 * MIN_TRAVEL)


def start_ranges(reading: Reading) -> Ranges:
    """Return the ranges of one reading."""
    return Ranges(reading.axes, reading.axes)


class Assignment(NamedTuple):
    """The axis that a stick is on."""

    axis: int
    reversed: bool
    """whether the raw value decreases in the positive direction of the stick"""


def identify_stick(
    ranges: Ranges, center: Reading, moved: Reading, excluded: Iterable[int] = ()
) -> Assignment | None:
    """Return the axis that differs most between two readings, relative to its travel; None if none moved clearly.

    ``excluded`` axes are assigned already.
    """
    candidates = [number for number in ranges.moved() if number not in set(excluded)]
    travel = {
        number: (moved.axes[number] - center.axes[number]) / (0.5 * (ranges.high[number] - ranges.low[number]))
        for number in candidates
    }
    axis = max(travel, key=lambda number: abs(travel[number]), default=None)
    if axis is None or abs(travel[axis]) < IDENTIFIED:
        return None
    return Assignment(axis, travel[axis] < 0.0)


def build_settings(
    info: DeviceInfo,
    ranges: Ranges,
    center: Reading,
    assignments: Mapping[str, Assignment],
    previous: Settings | None = None,
) -> Settings:
    """Build the settings of a device from what was measured; curves, buttons and switches are those of ``previous``.

    The throttle centers itself if ``center``, read with every stick released and a throttle without a spring at its
    lower end, is not at an end of its travel. A switch on an axis that is now a stick is dropped.

    Raises:
        InputError: the centered value of an axis is at its end, or it has too little travel.
    """
    before = {} if previous is None else previous.axes()
    axes = {
        stick: _axis(stick, assignment, ranges, center, before.get(stick))
        for stick, assignment in assignments.items()
    }
    actions = Assignments() if previous is None else previous.assignments
    used = {axis.axis for axis in axes.values()}
    switches = {number: switch for number, switch in actions.switches.items() if number not in used}
    return Settings(
        info.name,
        info.guid,
        axes["roll"],
        axes["pitch"],
        axes.get("yaw"),
        axes["throttle"],
        _is_centered(ranges, center, assignments["throttle"].axis),
        actions._replace(switches=switches),
    )


def _axis(stick: str, assignment: Assignment, ranges: Ranges, center: Reading, before: Axis | None) -> Axis:
    number = assignment.axis
    low, high = ranges.low[number], ranges.high[number]
    margin = END_MARGIN * (high - low)
    low, high = low + margin, high - margin
    middle = center.axes[number]
    if stick == "throttle" and not _is_centered(ranges, center, number):
        middle = 0.5 * (low + high)
    if min(high - middle, middle - low) < MIN_TRAVEL:
        raise InputError(f"{stick}: axis {number} has its center at its end ({low:.2f}, {middle:.2f}, {high:.2f})")
    deadzone, expo = (DEFAULT_DEADZONE, 0.0) if before is None else (before.deadzone, before.expo)
    low, middle, high = (round(value, 4) for value in (low, middle, high))
    return Axis(number, low, middle, high, assignment.reversed, deadzone, expo)


def _is_centered(ranges: Ranges, center: Reading, number: int) -> bool:
    """Whether an axis rests in the middle half of its travel."""
    low, high = ranges.low[number], ranges.high[number]
    return abs(center.axes[number] - 0.5 * (low + high)) < 0.25 * (high - low)
