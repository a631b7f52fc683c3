"""Methods without a physical model: their records, refusals, modes and results."""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from logs.identification.data.experiment import Experiment, longest_run, runs
from logs.identification.data.signal_errors import noise_with_steps
from logs.identification.estimators.registry import Request
from logs.identification.findings import Entry, Finding, register
from logs.identification.models.modes import KINDS, SHORT_PERIOD, Mode, nothing, paired_mode, without_heavy
from logs.identification.results import Array, Estimate, EstimationResult
from logs.identification.statistics.covariance import ParameterUncertainty
from wingbeat.errors import InputError
from wingbeat.text import pluralize

LEAST_SAMPLES = 16
LONGEST_GAP = 3
"""-; samples; a gap up to that is bridged by a straight line, at a longer one the record is cut"""
AT_REST = 0.03
"""-; of the input's range: what remains of it when it rests"""
MOVED = 6.0
"""-; deviations of its noise, from which on an input has moved"""
LEAST_MOVE = 0.01
"""rad, of an angle; a smaller movement excites little"""
LONGEST_SPIKE = 2
"""-; samples in all that an input may be elsewhere and is said to rest"""
FAST_UNITS, SLOW_UNITS = ("rad/s", "m/s^2"), ("m/s", "m")
"""rates and accelerations; speeds and heights: where only these and the pitch ring, it is the phugoid that rings"""


class Record(NamedTuple):
    """One maneuver, or one free motion, without gaps."""

    name: str
    """-; what it is called in reports"""
    step: float
    """s"""
    input: Array | None
    """(N,); minus its first value; None where the motion is free"""
    outputs: Array
    """(N, m); minus their means"""
    free_from: int
    """-; first sample after the input has come to rest, N where it does not"""


class Records(NamedTuple):
    """Everything that one set of modes is found from."""

    pieces: tuple[Record, ...]
    names: tuple[str, ...]
    """-; of the m outputs"""
    units: tuple[str, ...]
    """SI; of the m outputs"""
    smooth_input: bool = False
    """-; the input is band-limited, as an average is; else it is linear between samples"""
    airspeed: float | None = None
    """m/s; mean of the signal V, None if it was not measured"""
    notes: tuple[str, ...] = ()
    """-; what was bridged or left out, one clause each"""
    other_inputs: tuple[str, ...] = ()
    """-; inputs beside the one in the pieces, that move as well"""

    @property
    def fast(self) -> bool:
        """Whether an output shows the short period."""
        return any(unit in FAST_UNITS for unit in self.units) or "alpha" in self.names

    @property
    def slow(self) -> bool:
        """Whether one shows the phugoid far more."""
        return any(unit in SLOW_UNITS for unit in self.units)


def records_of(
    experiments: tuple[Experiment, ...],
    input_name: str | None,
    output_names: tuple[str, ...],
    others: tuple[str, ...] = (),
    *,
    smooth_input: bool = False,
) -> Records:
    """The longest stretch of each experiment on which inputs and outputs were measured.

    A motion is free once the ``others``, inputs beside ``input_name``, rest as well.

    Raises:
        InputError: a signal that is named is not there, or no experiment is long enough.
    """
    if not output_names:
        raise InputError("no output is named: modes need at least one")
    pieces, notes = [], []
    moving: set[str] = set()
    for experiment in experiments:
        columns, note = _without_gaps(_columns(experiment, input_name, (*output_names, *others)))
        notes += [f"{experiment.name}: {note}"] if note else []
        if len(columns) < LEAST_SAMPLES:
            continue
        m, end = len(output_names), len(output_names) + len(others)
        record = _record(experiment, np.delete(columns, np.s_[m:end], axis=1), input_name is not None)
        moved = {name: given for name, given in zip(others, columns[:, m:end].T, strict=True) if _moves(given)}
        pieces.append(record._replace(free_from=max((record.free_from, *map(rest_of, moved.values())))))
        moving |= moved.keys()
    if not pieces:
        raise InputError(f"no record of {', '.join(output_names)} has {LEAST_SAMPLES} samples in a row")
    units = tuple(experiments[0].units.get(name, "") for name in output_names)
    other_inputs = tuple(name for name in others if name in moving)
    return Records(
        tuple(pieces), output_names, units, smooth_input, _airspeed(experiments), tuple(notes), other_inputs
    )


def _airspeed(experiments: tuple[Experiment, ...]) -> float | None:
    """Mean of the signal V in m/s, None if it was not measured."""
    measured = [np.asarray(one.signals["V"]) for one in experiments if "V" in one.signals]
    known = np.concatenate(measured or [np.zeros(0)])
    known = known[np.isfinite(known)]
    return float(known.mean()) if len(known) else None


def _columns(experiment: Experiment, input_name: str | None, output_names: tuple[str, ...]) -> Array:
    """Outputs and, last, the input where there is one: (N, m) or (N, m + 1)."""
    names = (*output_names, *(() if input_name is None else (input_name,)))
    for name in names:
        if name not in experiment.signals:
            raise InputError(f"{experiment.name}: no signal {name!r}; there are {', '.join(experiment.signals)}")
    return np.column_stack([np.asarray(experiment.signals[name], dtype=float) for name in names])


def _without_gaps(columns: Array) -> tuple[Array, str]:
    """The longest stretch (M, k) of ``columns`` without a long gap, its short ones bridged; and what was done."""
    whole = np.all(np.isfinite(columns), axis=1)
    if np.all(whole):
        return columns, ""
    bridged, count = columns.copy(), 0
    gaps = [run for run in runs(~whole) if run.stop - run.start <= LONGEST_GAP]
    for run in (run for run in gaps if run.start > 0 and run.stop < len(whole)):
        share = (np.arange(run.start, run.stop) - run.start + 1)[:, None] / (run.stop - run.start + 1)
        bridged[run] = (1 - share) * columns[run.start - 1] + share * columns[run.stop]
        whole[run], count = True, count + run.stop - run.start
    kept = bridged[longest_run(whole)]
    lost = int(np.count_nonzero(~whole))
    told = [f"{pluralize(count, 'missing sample')} bridged"] if count else []
    if lost:
        others = f"the other {lost}" if count else f"{lost} missing samples"
        told.append(f"the longest stretch without {others} taken: {len(kept)} of {len(columns)} samples")
    return kept, ", ".join(told)


def _record(experiment: Experiment, columns: Array, driven: bool) -> Record:
    outputs = columns[:, :-1] if driven else columns
    given = columns[:, -1] - columns[0, -1] if driven else None
    return Record(experiment.name, experiment.step, given, outputs - outputs.mean(axis=0), rest_of(given))


def away(values: Array, place: float) -> NDArray[np.bool_]:
    """-; (N,), whether an input is away from a ``place`` where it may rest by more than its noise.

    A channel that is told in steps has no noise between neighbors: less than `LEAST_MOVE` is such a step.
    """
    return np.asarray(np.abs(values - place) > max(MOVED * noise_with_steps(values), LEAST_MOVE))


def _moves(values: Array) -> bool:
    """Whether an input (N,) leaves its usual place for longer than a spike lasts."""
    return int(np.count_nonzero(away(values, float(np.median(values))))) > LONGEST_SPIKE


def rest_of(given: Array | None) -> int:
    """First sample after which the input ``given`` (N,) stays where it ends; N where it never does."""
    if given is None:
        return 0
    span = float(np.ptp(given))
    moving = np.flatnonzero(np.abs(given - given[-1]) > AT_REST * span)
    return int(moving[-1]) + 1 if len(moving) else 0


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
