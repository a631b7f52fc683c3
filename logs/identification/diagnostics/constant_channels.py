"""Channels that do not move: an output held at one number says nothing of the motion, and no search should seek it.

With an angle of attack that was one number throughout a search ran away and said so of its start values; a pitch rate
that froze left q c/(2V), which moves by the airspeed alone, with a C_m_q of -306.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence

import numpy as np

from logs.identification.data.experiment import Experiment
from logs.identification.estimators.terms import parse
from logs.identification.results import Array, Unidentified
from logs.identification.sources.table.config import Regression
from logs.identification.sources.table.maneuvers import file_of
from logs.identification.tables.regressions import product_of
from logs.identification.tables.results import TableFit
from wingbeat.errors import InputError

LEAST = 1e-9
"""-; of a signal's size, by which it moves: less is the rounding of its unit"""
OF_AIR = ("V", "rho", "qbar", "altitude", "thrust")
"""what regressors are made dimensionless by"""
MADE_OF = {"C_l": "p", "C_m": "q", "C_n": "r"}
"""the rate whose slope a moment is made of, where no angular acceleration was measured"""
WRONG = "leave it out, or is it the wrong column?"


def refuse_still(names: Iterable[str], experiments: tuple[Experiment, ...]) -> None:
    """Refuse outputs that are one number in each manoeuvre.

    Raises:
        InputError: one of them is.
    """
    for name in names:
        series = [one.signals[name] for one in experiments if name in one.signals]
        if any(map(_measured, series)) and not any(map(_moves, series)):
            raise InputError(
                f"{_not_moving(name, experiments)}; an output held still says nothing of the motion: {WRONG}"
            )


def without_still(
    asked: Regression, experiments: tuple[Experiment, ...]
) -> tuple[Regression, tuple[Unidentified, ...]]:
    """The regression without terms of signals that are one number throughout, and those terms.

    Raises:
        InputError: the response is one number, or no term is left.
    """
    still = {
        name for name in experiments[0].signals
        if _measured(whole := _whole(name, experiments)) and not _moves(whole)
    }  # fmt: skip
    refuse_still({asked.response} & still, experiments)
    rate = MADE_OF.get(asked.response, "")
    if rate in still and not {asked.response, f"{rate}_dot"} & set(experiments[0].signals):
        raise InputError(f"{asked.response} is made of {rate}, and {_not_moving(rate, experiments)}")
    lost = {}
    for name in dict.fromkeys((*asked.regressors, *asked.always)):
        symbols = [one for one in _symbols(name, experiments) if one not in OF_AIR]
        if symbols and set(symbols) <= still:
            lost[name] = Unidentified(name, f"{_not_moving(symbols[0], experiments)}: {WRONG}")
    kept = tuple(name for name in asked.regressors if name not in lost)
    if lost and not kept:
        raise InputError("; ".join(one.reason for one in lost.values()))
    always = tuple(name for name in asked.always if name not in lost)
    return asked._replace(regressors=kept, always=always), tuple(lost.values())


def with_still(
    fit: TableFit, lost: tuple[Unidentified, ...], names: Sequence[str], experiments: tuple[Experiment, ...]
) -> TableFit:
    """The fit with the terms that were ``lost``, and what is said of signals that moved in some manoeuvres only.

    ``names`` are outputs or regressors.
    """
    symbols = dict.fromkeys(
        symbol for name in names for symbol in _symbols(name, experiments) if symbol not in OF_AIR
    )
    notes = []
    for one in experiments:
        moving = [name for name in symbols if name in one.signals and _moves(one.signals[name])]
        for name in symbols if moving else ():
            elsewhere = any(name in other.signals and _moves(other.signals[name]) for other in experiments)
            if name not in moving and elsewhere and _measured(one.signals.get(name, np.zeros(0))):
                notes.append(f"{name} does not move in {one.name}, and does elsewhere: did it freeze?")
    fitted = fit.fitted._replace(
        unidentified=(*fit.fitted.unidentified, *lost), notes=(*fit.fitted.notes, *notes)
    )  # fmt: skip
    return fit._replace(fitted=fitted)


def _symbols(name: str, experiments: tuple[Experiment, ...]) -> tuple[str, ...]:
    """Signals in an output or a regressor."""
    signals = experiments[0].signals
    return (name,) if name in signals else tuple(one for one in parse(product_of(name)).powers if one in signals)


def _whole(name: str, experiments: tuple[Experiment, ...]) -> Array:
    return np.concatenate([np.asarray(one.signals[name]) for one in experiments if name in one.signals])


def _measured(values: Array) -> bool:
    return bool(np.any(np.isfinite(values)))


def _moves(values: Array) -> bool:
    known = values[np.isfinite(values)]
    return len(known) > 0 and float(np.ptp(known)) > LEAST * float(np.max(np.abs(known)))


def _not_moving(name: str, experiments: tuple[Experiment, ...]) -> str:
    files = dict.fromkeys(file_of(one) for one in experiments)
    return f"{name} does not move in {', '.join(files)}"
