"""Modes by every method that needs no physical model, and whether the methods agree."""

from __future__ import annotations

from logs.identification.data.experiment import Experiment
from logs.identification.diagnostics.agreement import agreement
from logs.identification.estimators.equivalent_system import EQUIVALENT_SYSTEM
from logs.identification.estimators.era import ERA
from logs.identification.estimators.free_response import FREE_RESPONSE
from logs.identification.estimators.modal import Records, records_of
from logs.identification.estimators.spectrum import SPECTRUM
from logs.identification.findings import note
from logs.identification.models.modes import PHUGOID, SHORT_PERIOD, Mode, ModesResult

METHODS = (EQUIVALENT_SYSTEM, ERA, FREE_RESPONSE, SPECTRUM)


def modes_of_experiments(
    experiments: tuple[Experiment, ...],
    input_name: str | None,
    output_names: tuple[str, ...],
    kinds: tuple[str, ...] | None = None,
    known: tuple[Mode, ...] = (),
    others: tuple[str, ...] = (),
) -> ModesResult:
    """Short period, phugoid or both (``kinds``) of ``experiments`` by every method that applies.

    ``input_name`` is None for a free motion; ``others`` are further inputs. ``kinds`` of `modes.KINDS`; None selects
    the phugoid if a speed or height is among the outputs and no angular rate, angle of attack or acceleration, else
    the short period. ``known`` are modes by other methods, to compare with.

    Raises:
        InputError: an unknown signal, or no record is long enough.
    """
    records = records_of(experiments, input_name, output_names, others)
    pairs = [method.mode_with_findings(records, kinds or _likely(records)) for method in METHODS]
    modes = (*known, *(mode for mode, _ in pairs))
    agree, statement = agreement(modes)
    reported = [note(f"{mode.method}: {one.text}") for mode, findings in pairs for one in findings]
    findings = (*map(note, records.notes), *reported)
    return ModesResult(modes, agree, statement, None, len(records.pieces), None, findings=findings)


def modes_of_records(records: Records, kinds: tuple[str, ...]) -> tuple[Mode, ...]:
    """The methods without a physical model, one after the other."""
    return tuple(method.mode(records, kinds) for method in METHODS)


def _likely(records: Records) -> tuple[str, ...]:
    if records.slow:
        return (SHORT_PERIOD, PHUGOID) if records.fast else (PHUGOID,)
    return (SHORT_PERIOD,)
