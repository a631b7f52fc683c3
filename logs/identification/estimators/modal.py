"""What the methods that identify modes without a physical model have in common: refusals, `Mode` and registry row."""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import NamedTuple

from logs.identification.estimators.records import Records, records_of
from logs.identification.estimators.registry import Request
from logs.identification.findings import Entry, Finding, register
from logs.identification.models.modes import KINDS, SHORT_PERIOD, Mode, nothing, paired_mode, without_heavy
from logs.identification.results import Array, Estimate, EstimationResult
from logs.identification.statistics.covariance import ParameterUncertainty
from wingbeat.errors import InputError

register({
    "no_input": Entry("the input does not move in the records", "A method for driven motion needs a moving input."),
    "one_input_only": Entry(
        "{subject} moves as well: the method has one input", "Several inputs move; the method models one.",
        "use output error",
    ),
    "record_too_short": Entry(
        "the records are too short: {value:.3g} of {limit:.3g} {unit} needed",
        "The records have too few samples, frequencies or periods of the mode for the method.", "record longer",
    ),
    "little_explained": Entry(
        "the model explains {value:.0%} of the records' power, less than {limit:.0%}: turbulence, noise or an unknown"
        " lag", "The fit explains too little of the outputs' power.",
    ),
    "mode_not_identifiable": Entry(
        "the records do not determine frequency and damping", "The information matrix of the mode is singular."
    ),
    "mode_too_fast": Entry(
        "the frequency of {value:.3g} rad/s is above the input's bandwidth of {limit:.3g} rad/s",
        "The identified mode is faster than the input excites.", "use a faster input",
    ),
    "overdamped": Entry(
        "the damping ratio of {value:.2g} is too large for the method, which needs less than {limit:.2g}",
        "The method needs a visible oscillation.",
    ),
    "constant_output": Entry("an output is constant", "A constant output contains no motion."),
    "no_mode": Entry("{reason}", "The method found no oscillation that is a mode of the aircraft."),
    "no_prediction": Entry(
        "the method has no model to predict held-out data with", "Modal methods identify frequency and damping only."
    ),
})  # fmt: skip


class NotIdentified(Exception):
    """A method without a number, with the finding that is the reason."""

    def __init__(self, code: str, value: float | None = None, limit: float | None = None, **details: object) -> None:
        """`Finding` of the ``code``."""
        super().__init__(code)
        self.finding = Finding(code, "withheld", "", value, limit, details)


class ModalFit(NamedTuple):
    """Modes by one method."""

    pairs: Array
    """(2 k,); frequency (rad/s) and damping ratio of each mode"""
    spread: ParameterUncertainty
    """of parameters of which `pairs` are the first"""
    parameters: tuple[Estimate, ...] = ()
    """further numbers, such as delay and gains"""
    findings: tuple[Finding, ...] = ()


class ModalMethod(NamedTuple):
    """One method."""

    name: str
    """-; key of the registry"""
    title: str
    """-; heading in texts"""
    fit: Callable[[Records, tuple[str, ...]], ModalFit]
    """raises `NotIdentified`"""
    inputs: bool
    """-; whether it models the response to one input"""
    max_damping: float = math.inf
    """-; upper end of a damping's interval, above which the method is biased"""

    def mode(self, records: Records, kinds: tuple[str, ...] = (SHORT_PERIOD,)) -> Mode:
        """Modes ``kinds`` of the ``records``."""
        return self._identify(records, kinds)[0]

    def mode_with_findings(self, records: Records, kinds: tuple[str, ...]) -> tuple[Mode, tuple[Finding, ...]]:
        """Modes ``kinds`` of the ``records``, and what the method reports about them."""
        mode, fit, _ = self._identify(records, kinds)
        return mode, fit.findings if fit else ()

    def result(self, request: Request) -> EstimationResult:
        """Modes ``options["kinds"]`` of the experiments of a ``request``.

        Raises:
            InputError: no output, unknown kinds or signals, or no record is long enough.
        """
        kinds = tuple(request.options.get("kinds", (SHORT_PERIOD,)))
        if not kinds or not set(kinds) <= set(KINDS):
            raise InputError(f"{self.name}: kinds are {' and '.join(KINDS)}")
        first = request.inputs[0] if request.inputs else None
        records = records_of(request.experiments, first, request.outputs, request.inputs[1:])
        mode, fit, finding = self._identify(records, kinds)
        found = [pair for kind in kinds if (pair := mode.of_kind(kind)) is not None]
        findings = fit.findings if fit else ()
        if finding is not None:
            findings = (*findings, *(finding._replace(subject=kind) for kind in kinds))
        else:
            reasons = {one.subject: {"reason": one.text} for one in mode.withheld}
            findings = (*findings, *(Finding("no_mode", "withheld", n, details=d) for n, d in reasons.items()))
        if request.held_out:
            findings = (*findings, Finding("no_prediction", "info"))
        return EstimationResult(
            self.name, "modes", status="converged" if found else "not identifiable",
            estimates=tuple(one for pair in found for one in (pair.frequency, pair.damping)),
            derived=(*(one for pair in found for one in pair.estimates[2:]), *(mode.derivatives if found else ())),
            samples=sum(len(record.outputs) for record in records.pieces), findings=findings,
        )  # fmt: skip

    def _identify(self, records: Records, kinds: tuple[str, ...]) -> tuple[Mode, ModalFit | None, Finding | None]:
        try:
            if self.inputs and records.other_inputs:
                raise NotIdentified("one_input_only")
            fit = self.fit(records, kinds)
        except NotIdentified as refused:
            finding = refused.finding
            if finding.code == "one_input_only":
                finding = finding._replace(subject=", ".join(records.other_inputs))
            return nothing(self.title, finding.text, kinds), None, finding
        mode = paired_mode(self.title, kinds, fit.pairs, fit.spread, fit.parameters)
        return (mode if math.isinf(self.max_damping) else without_heavy(mode, self.max_damping)), fit, None
