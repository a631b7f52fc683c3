"""The modes of records that any table may give: every method that the data allows, and where they disagree."""

from __future__ import annotations

from logs.identification.data.experiment import Experiment
from logs.identification.diagnostics.agreement import agreement
from logs.identification.estimators.equivalent_system import METHOD as EQUIVALENT
from logs.identification.estimators.equivalent_system import equivalent_system
from logs.identification.estimators.era import METHOD as REALIZATION
from logs.identification.estimators.era import realization
from logs.identification.estimators.free_response import free_response
from logs.identification.estimators.records import Records, records_of
from logs.identification.estimators.spectrum import METHOD as SPECTRUM
from logs.identification.estimators.spectrum import spectrum
from logs.identification.models.modes import PHUGOID, SHORT_PERIOD, Mode, ModesResult, nothing

METHODS = (equivalent_system, realization, free_response, spectrum)
SINGLE = {equivalent_system: EQUIVALENT, realization: REALIZATION, spectrum: SPECTRUM}
"""methods that know one input, by what reports call them: what another one moved they took for the first one's. With
a tenth of its power the equivalent system had the frequency 8 % too low, with an interval of 6 %"""


def modes_of_experiments(
    experiments: tuple[Experiment, ...],
    input_name: str | None,
    output_names: tuple[str, ...],
    kinds: tuple[str, ...] | None = None,
    known: tuple[Mode, ...] = (),
    others: tuple[str, ...] = (),
) -> ModesResult:
    """Short period, phugoid or both (``kinds``) of ``experiments`` by every method that applies.

    ``input_name`` is None where the motion is free all the time; ``others`` are inputs beside it. ``kinds`` of
    `mode.KINDS`; None takes the phugoid where a speed or a height is among the outputs and no angular rate, angle of
    attack or acceleration is, else the short period. ``known`` are modes by other methods, `mode.mode_of_system` of
    a fitted model, to compare with.

    Raises:
        InputError: a named signal is not there, or no record is long enough.
    """
    records = records_of(experiments, input_name, output_names, others)
    modes = (*known, *modes_of_records(records, kinds or _likely(records)))
    agree, statement = agreement(modes)
    return ModesResult(modes, agree, statement, None, len(records.pieces), None, records.notes)


def modes_of_records(records: Records, kinds: tuple[str, ...]) -> tuple[Mode, ...]:
    """The methods without a physical model, one after the other."""
    return tuple(
        _single(SINGLE[method], records, kinds) if records.beside and method in SINGLE else method(records, kinds)
        for method in METHODS
    )


def _single(name: str, records: Records, kinds: tuple[str, ...]) -> Mode:
    moved = f"{', '.join(records.beside)} {'move' if len(records.beside) > 1 else 'moves'} as well"
    return nothing(name, f"{moved}: it knows one input", kinds)


def _likely(records: Records) -> tuple[str, ...]:
    if records.slow:
        return (SHORT_PERIOD, PHUGOID) if records.fast else (PHUGOID,)
    return (SHORT_PERIOD,)
