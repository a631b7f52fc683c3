"""Table of the diagnostics of tables: one loop runs those that apply.

A diagnostic is a function `Context` -> findings. To add one, write the function, register its code, add a row.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Literal, NamedTuple

from logs.identification.diagnostics import Context, estimates, model_structure, signals
from logs.identification.findings import Finding

Stage = Literal["data", "regression", "model", "comparison"]
"""data: the maneuvers before any fit; regression, model: one result of that kind; comparison: all results"""


class Check(NamedTuple):
    """One row."""

    codes: tuple[str, ...]
    """-; that it may report"""
    stages: tuple[Stage, ...]
    run: Callable[[Context], tuple[Finding, ...]]


CHECKS: tuple[Check, ...] = (
    Check(("sign", "unit"), ("data",), signals.gravity),
    Check(("unit",), ("data",), signals.airspeed_constant),
    Check(("unit",), ("data",), signals.input_sizes),
    Check(("sign", "unit"), ("data",), signals.kinematic_consistency),
    Check(("frozen_signal",), ("model", "regression"), signals.frozen_signals),
    Check(("outliers",), ("model",), signals.outliers),
    Check(("missing_samples",), ("model",), signals.missing_samples),
    Check(("noisy_input",), ("model",), signals.noisy_inputs),
    Check(("zoh_input",), ("model",), estimates.stepwise_inputs),
    Check(("short_record",), ("model",), estimates.short_records),
    Check(("poor_fit",), ("model", "regression"), model_structure.poor_fit),
    Check(("lack_of_fit",), ("model",), model_structure.lack_of_fit),
    Check(("operating_point",), ("model",), model_structure.operating_points),
    Check(("trim_assumed", "trim_from_vane"), ("model",), model_structure.assumed_trim),
    Check(("unusual_sign",), ("model", "regression"), estimates.unusual_signs),
    Check(("few_independent_samples",), ("regression",), estimates.few_independent_samples),
    Check(("disagreement",), ("comparison",), estimates.disagreements),
)


def diagnose(stage: Stage, context: Context) -> tuple[Finding, ...]:
    """The findings of all diagnostics of a ``stage``."""
    return tuple(finding for check in CHECKS if stage in check.stages for finding in check.run(context))
