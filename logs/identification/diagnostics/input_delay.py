"""Inputs that were recorded late or early: found by the equivalent system's delay, or by the model's own equations.

Output error that begins without the delay follows such inputs nowhere, or to another mode.
"""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from logs.identification.data.experiment import Experiment
from logs.identification.diagnostics.agreement import contradiction
from logs.identification.estimators.equivalent_system import METHOD as EQUIVALENT
from logs.identification.estimators.initial_values import best_delay
from logs.identification.models.modes import KINDS, Mode, ModesResult
from logs.identification.sources.table.config import DELAY, ModesSection, OutputError
from logs.identification.sources.table.maneuvers import Cut
from logs.identification.tables.models import LONGEST_DELAY, chosen_model
from logs.identification.tables.output_errors import driven
from logs.identification.tables.results import TableFit

FOLLOWED, EXPLAINED = 0.95, 0.5
"""-; R^2 of every output from which on a delay is not looked for; what squares a delay leaves that is suspected"""
LATE_SAMPLES = 2.0
"""-; by fewer an input may come late that was read before or after the outputs of its row"""


def suspected_delay(
    table: TableFit, wanted: OutputError, found: Cut, constants: Mapping[str, float], fill: float | None
) -> float:
    """By how much (s) the inputs seem late where output error follows too little; 0 where that explains little."""
    followed = [one.r_squared for one in table.outputs if np.isfinite(one.r_squared)]
    if wanted.delay.fixed != 0.0 or (table.fitted.estimates and min(followed, default=1.0) > FOLLOWED):
        return 0.0
    chosen = chosen_model(wanted, constants, found.fitted)
    flown = driven(found.fitted, chosen, fill).experiments
    delay, share = best_delay(chosen.model, chosen.parameters, flown, constants, chosen.linear)
    least = LATE_SAMPLES * max(one.step for one in found.fitted)
    return delay if share < EXPLAINED and abs(delay) > least else 0.0


def delay_beside(result: ModesResult, experiments: tuple[Experiment, ...]) -> float:
    """By how much (s) the equivalent system finds the input late, surely and by samples, where output error, the
    first of the modes, has no mode or another one; 0 elsewhere, and beyond what output error looks at."""
    first, other = result.modes[0], next((one for one in result.modes if one.method == EQUIVALENT), None)
    if other is None or not tells(other) or (tells(first) and not contradiction(first, other)):
        return 0.0
    delay = next((one for one in other.derivatives if one.name == DELAY), None)
    if delay is None or delay.low <= 0.0 <= delay.high or not abs(delay.value) < LONGEST_DELAY:
        return 0.0
    return delay.value if abs(delay.value) > LATE_SAMPLES * max(one.step for one in experiments) else 0.0


def known_delay(asked: ModesSection, fits: list[TableFit]) -> float:
    """By how much (s) the inputs act late, as the map tells or output error finds it; 0 where neither does."""
    if asked.delay.fixed is not None:
        return asked.delay.fixed
    return next((one.value for fit in fits for one in fit.fitted.estimates if one.name == DELAY), 0.0)


def counted_from_record(mode: Mode, delay: float) -> Mode:
    """The mode with its equivalent system's delay counted from when the input was recorded."""
    if mode.method != EQUIVALENT or not delay:
        return mode
    told = tuple(
        one._replace(value=one.value + delay, low=one.low + delay, high=one.high + delay)
        if one.name == DELAY
        else one
        for one in mode.derivatives
    )
    return mode._replace(derivatives=told)


def lateness(late: float, told: bool, inputs: str) -> str:
    """What is said of inputs that are ``late`` (s): by the equivalent system where that has ``told`` it."""
    when = "before it was" if late < 0.0 else "later than"
    finds = "equivalent system finds that" if told else "the model's equations fit far better if"
    return f'{finds} {inputs} acts {abs(late):.2g} s {when} recorded: with delay = "free" output error may find it'


def tells(mode: Mode) -> bool:
    """Whether the method gives a mode."""
    return any(mode.of_kind(kind) is not None for kind in KINDS)
