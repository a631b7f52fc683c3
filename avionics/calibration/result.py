"""Common results of the calibrations: progress, parameters and residual."""

from __future__ import annotations

from collections.abc import Iterable
from typing import NamedTuple


class Took(NamedTuple):
    """Result of adding one sample."""

    note: str = ""
    """-; notice in one line, empty if none"""
    complete: bool = False
    """-; True once the samples are sufficient for the solution"""
    cancelled: str = ""
    """-; reason of a cancellation, else empty"""


NOTHING_NEW = Took()


class Setting(NamedTuple):
    """Parameter set by a calibration."""

    section: str
    """-; section of the vehicle file"""
    key: str
    """-; key in the section"""
    place: int
    """-; index in a list, -1 for a single number"""
    value: float
    """value in the unit of the parameter"""


class Result(NamedTuple):
    """Result of a calibration."""

    settings: tuple[Setting, ...]
    """-; parameters to set"""
    residual: float
    """RMS residual of the result, in ``unit``"""
    unit: str
    """-; unit of the residual"""
    samples: int
    """-; number of samples used"""


def triple(section: str, key: str, values: Iterable[float]) -> tuple[Setting, ...]:
    """Return the settings of a parameter with three numbers."""
    return tuple(Setting(section, key, place, float(value)) for place, value in enumerate(values))
