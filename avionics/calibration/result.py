"""What every calibration gives: word of its progress, and parameters with a residual."""

from __future__ import annotations

from collections.abc import Iterable
from typing import NamedTuple


class Took(NamedTuple):
    """What became of one more sample."""

    note: str = ""
    """-; one line for people, empty when there is nothing to say"""
    complete: bool = False
    """-; enough was gathered: solve now"""
    cancelled: str = ""
    """-; why it cannot go on; empty while it can"""


NOTHING_NEW = Took()


class Setting(NamedTuple):
    """One parameter that a calibration sets."""

    section: str
    """-; of the vehicle file"""
    key: str
    """-; in the section"""
    place: int
    """-; in a list, -1 for a single number"""
    value: float
    """in the parameter's unit"""


class Result(NamedTuple):
    """What a calibration found."""

    settings: tuple[Setting, ...]
    """-; parameters to set"""
    residual: float
    """RMS of what the found values leave, in ``unit``"""
    unit: str
    """-; of the residual"""
    samples: int
    """-; that were used"""


def triple(section: str, key: str, values: Iterable[float]) -> tuple[Setting, ...]:
    """Settings of a parameter of three numbers."""
    return tuple(Setting(section, key, place, float(value)) for place, value in enumerate(values))
