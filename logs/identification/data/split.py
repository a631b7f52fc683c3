"""Split into training and validation data.

Maneuvers of one flight share weather, trim and errors of the sensors: validation by another maneuver of the same
flight is too favorable. So whole flights are held out (Jategaonkar, Flight Vehicle System Identification, 2006,
chapter 11), maneuvers only if there is a single flight.
"""

from __future__ import annotations

from collections.abc import Collection, Mapping, Sequence
from typing import NamedTuple, Protocol, TypeVar

import numpy as np

from logs.identification.data.experiment import Experiment
from logs.identification.data.flight import JoinedFlight
from wingbeat.errors import InputError

SHARE = 1 / 3
"""-; held out by default"""


class FromFlight(Protocol):
    """A maneuver of one of several flights."""

    @property
    def flight(self) -> JoinedFlight | None:
        """None if there is only one."""


M = TypeVar("M", bound=FromFlight)


class Split(NamedTuple):
    """Training and validation experiments."""

    training: tuple[Experiment, ...]
    validation: tuple[Experiment, ...]
    note: str
    """-; what was held out, one clause"""


def split(flights: Mapping[str, Sequence[Experiment]], share: float = SHARE, seed: int = 0) -> Split:
    """Hold out a ``share`` of the flights (at least one, not all), or of the only flight's maneuvers.

    The same ``seed`` and names of flights or maneuvers give the same split in any order.

    Raises:
        InputError: the share is not between 0 and 1, or there is but one manoeuvre.
    """
    if not 0 < share < 1:
        raise InputError(f"a share of {share:g} to hold back is not between 0 and 1")
    flown = {name: tuple(experiments) for name, experiments in flights.items() if experiments}
    if len(flown) > 1:
        held = drawn(sorted(flown), share, seed)
        names = sorted(flown)
        parts = [tuple(e for name in names if (name in held) is side for e in flown[name]) for side in (False, True)]
        return Split(
            parts[0], parts[1], f"held back: {len(held)} of {len(flown)} flights ({', '.join(sorted(held))})"
        )
    manoeuvres = [e for experiments in flown.values() for e in experiments]
    if len(manoeuvres) < 2:
        raise InputError("a single manoeuvre cannot be split: fit it and fly another to try the model on")
    return _of_one_flight(manoeuvres, share, seed)


def _of_one_flight(manoeuvres: list[Experiment], share: float, seed: int) -> Split:
    names = sorted(e.name for e in manoeuvres)
    if len(set(names)) < len(names):
        raise InputError("two manoeuvres of the flight have the same name")
    held = drawn(names, share, seed)
    parts = [tuple(e for e in manoeuvres if (e.name in held) is side) for side in (False, True)]
    told = f"held back: {len(held)} of {len(names)} manoeuvres ({', '.join(sorted(held))})"
    return Split(parts[0], parts[1], told + " of the only flight, whose weather and trim they share")


def by_flight(manoeuvres: Sequence[M], held: Collection[str]) -> tuple[tuple[M, ...], tuple[M, ...]]:
    """The maneuvers of the flights that are fitted, and those of the flights ``held`` out.

    Raises:
        InputError: a flight held out has no usable manoeuvre, or all are.
    """
    names = [one.flight.name if one.flight is not None else "" for one in manoeuvres]
    lost = [name for name in held if name not in names]
    if lost:
        raise InputError(f"{lost[0]} is held out and has no complete elevator manoeuvre flown with flapping wings")
    if set(names) <= set(held):
        raise InputError("every flight with a usable manoeuvre is held out: none is left to fit")
    pairs = list(zip(manoeuvres, names, strict=True))
    return tuple(one for one, name in pairs if name not in held), tuple(one for one, name in pairs if name in held)


def drawn(names: list[str], share: float = SHARE, seed: int = 0) -> set[str]:
    """The ``share`` of the names that is held out: at least one, not all."""
    count = min(max(round(share * len(names)), 1), len(names) - 1)
    order = np.random.default_rng(seed).permutation(len(names))
    return {names[int(index)] for index in order[:count]}
