"""What inputs do between their samples: held, on a line, or a course that the samples do not show."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from math import hypot

import numpy as np

from logs.identification.data.experiment import Experiment
from logs.identification.estimators.equation_error import CoefficientRegression
from logs.identification.results import Array, estimate

FELT = 0.3
"""-; standard errors by which another course between samples moves a number, from which on it is said. Where the
course was ramps or an actuator's lag the number was off by one to four times as much"""
FURTHEST_TURN = 1.0
"""rad; that a motion may turn from sample to sample where the inputs between them are not known: at 1.3 an equivalent
system was 10 % off and a damping half of what it is, at 2.5 all was"""
LEAST_RUN = 16
"""-; samples on end with every input"""
JUMP, STILL = 0.2, 0.03
"""-; of an input's range: what it changes by from one sample to the next, and beside that, where it was held"""


def jumps(values: Array) -> bool:
    """Whether an input (N,) changes between two samples and rests beside, as one that is held and not moved does."""
    known = values[np.isfinite(values)]
    if len(known) < LEAST_RUN or not np.ptp(known) > 0:
        return False
    changes = np.abs(np.diff(known)) / float(np.ptp(known))
    places = np.flatnonzero(changes[1:-1] > JUMP) + 1
    return len(places) > 0 and bool(np.all(changes[places - 1] < STILL) and np.all(changes[places + 1] < STILL))


def jumping(lines: Sequence[str], experiments: tuple[Experiment, ...]) -> tuple[str, ...]:
    """What is said of inputs that jump between samples and are flown as lines.

    A command that is held from its sample on acts half a sample later than the line to the next one, and at once.
    """
    names = [name for name in lines if any(name in one.signals and jumps(one.signals[name]) for one in experiments)]
    if not names:
        return ()
    one, told = len(names) == 1, ", ".join(f'"{name}"' for name in names)
    flown = "and was flown as a line" if one else "and were flown as lines"
    return (
        f"{', '.join(names)} {'jumps' if one else 'jump'} from one sample to the next, {flown} between them;"
        f" if held, give hold = [{told}]",
    )


def coarse(names: Sequence[str], experiments: tuple[Experiment, ...], least: float = JUMP) -> dict[str, float]:
    """Inputs that move so far from one sample to the next that the line may be no course of theirs, and how far.

    That is by more than ``least`` of their range, held ones apart. Ramps of one to three samples between 3-2-1-1
    levels, at 10 Hz and 2.8 rad/s, left M_q and M_delta 1 to 20 % off, outside their intervals, with the delay free
    or not; the same ramps at 25 Hz a quarter of that.
    """
    found = {}
    for name in names:
        series = [np.asarray(one.signals[name]) for one in experiments if name in one.signals]
        largest = max((_largest_change(one) for one in series), default=0.0)
        if largest > least and not any(map(jumps, series)):
            found[name] = largest
    return found


def said_coarse(found: Mapping[str, float], intervals: str) -> tuple[str, ...]:
    """One line of inputs whose course between samples matters, and what that is to the ``intervals``."""
    if not found:
        return ()
    one, reach = len(found) == 1, 100.0 * max(found.values())
    counts = "its range from one sample to the next, and counts as a line between them"
    if not one:
        counts = "their range from one sample to the next, and count as lines between them"
    return (
        f"{', '.join(found)} {'moves' if one else 'move'} by up to {reach:.0f} % of {counts}: {intervals};"
        f" record {'it' if one else 'them'} faster",
    )


def _largest_change(values: Array) -> float:
    """From one measured sample of an input (N,) to the next one measured, as a share of its range."""
    known = values[np.isfinite(values)]
    span = float(np.ptp(known)) if len(known) > 1 else 0.0
    return float(np.max(np.abs(np.diff(known)))) / span if span else 0.0


def _changes(result: CoefficientRegression, otherwise: CoefficientRegression) -> dict[str, float]:
    """What each coefficient changes by with another course between samples; nothing where that gave none."""
    others = {} if otherwise.failure else {one.name: one.value for one in otherwise.estimates}
    return {one.name: one.value - others.get(one.name, one.value) for one in result.estimates}


def felt(result: CoefficientRegression, otherwise: CoefficientRegression) -> bool:
    """Whether another course between samples moves any coefficient notably, beside its standard error."""
    changes = _changes(result, otherwise)
    return any(abs(changes[one.name]) > FELT * one.standard_error for one in result.estimates)


def with_between(
    result: CoefficientRegression, otherwise: CoefficientRegression, unseen: bool
) -> CoefficientRegression:
    """The regression with intervals that hold what is not known of the course between samples.

    That is what the values change by where the averages beside a slope are made of lines and not of cubics, or cubics
    and not lines; twice as much where a control's course is ``unseen`` and neither.
    """
    changes = _changes(result, otherwise)
    share = 2.0 if unseen else 1.0
    kept = tuple(
        estimate(
            one.name, one.unit, one.value,
            hypot(one.standard_error, share * changes[one.name]),
            float(result.degrees[result.names.index(one.name)]),
        )
        for one in result.estimates
    )  # fmt: skip
    return result._replace(estimates=kept)
