"""Diagnostics of the sampling: inputs between samples, motions faster than the samples, short records."""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np

from logs.identification.data.experiment import Experiment
from logs.identification.diagnostics.context import Context
from logs.identification.findings import Entry, Finding, register
from logs.identification.results import Array

LEAST_RUN = 16
"""-; samples in a row with every input"""
STEP_CHANGE, REST = 0.2, 0.03
"""-; of an input's range: change between two samples, and the changes next to it, of an input held by a computer"""
FASTEST_TURN = 1.0
"""rad; phase that a mode may turn between two samples if the input between them is unknown"""
LEAST_PERIODS = 4.9
"""-; of the mode in all records together (Klein & Morelli 2006, ch. 9: record length of SIDPAC)"""

register({
    "zoh_input": Entry(
        "{subject} changes in steps but is interpolated linearly",
        "A command of a computer is constant between samples (zero-order hold).",
        "set zoh_inputs = [...] if it is constant between samples",
    ),
    "sampling": Entry(
        "{subject} changes by {percent:.0f} % of its range between samples; intervals widened",
        "The input is sampled too slowly: a line and a cubic between its samples give different estimates.",
        "record at a higher rate",
    ),
    "aliased_mode": Entry(
        "a mode at {value:.3g} rad/s has only {samples:.1f} samples in a period",
        "The mode is faster than half the sampling rate, or too fast for an input unknown between samples.",
        "record at a higher rate",
    ),
    "short_record": Entry(
        "the records hold {value:.2g} periods of the mode (recommended: {limit:.2g})",
        "Frequency and damping of a short record have wide intervals that may be too narrow still.",
        "record longer, or several maneuvers",
    ),
})  # fmt: skip


def jumps(values: Array) -> bool:
    """Whether an input (N,) changes in steps between two samples and rests before and after, as with a hold."""
    known = values[np.isfinite(values)]
    if len(known) < LEAST_RUN or not np.ptp(known) > 0:
        return False
    changes = np.abs(np.diff(known)) / float(np.ptp(known))
    places = np.flatnonzero(changes[1:-1] > STEP_CHANGE) + 1
    return len(places) > 0 and bool(np.all(changes[places - 1] < REST) and np.all(changes[places + 1] < REST))


def largest_change(name: str, experiments: Sequence[Experiment]) -> float:
    """Largest change of an input between two measured samples, as a fraction of its range; 0 of a held one."""
    largest = 0.0
    for one in experiments:
        values = np.asarray(one.signals.get(name, np.zeros(0)), dtype=np.float64)
        if jumps(values):
            return 0.0
        known = values[np.isfinite(values)]
        span = float(np.ptp(known)) if len(known) > 1 else 0.0
        largest = max(largest, float(np.max(np.abs(np.diff(known)))) / span if span else 0.0)
    return largest


def coarse_inputs(names: Sequence[str], experiments: Sequence[Experiment], least: float = STEP_CHANGE) -> list[str]:
    """Inputs whose course between samples is unknown: they change by more than ``least`` of their range."""
    return [name for name in names if largest_change(name, experiments) > least]


def sampling_finding(name: str, experiments: Sequence[Experiment]) -> Finding:
    """The finding of an input whose course between samples changes the estimates."""
    change = largest_change(name, experiments)
    return Finding("sampling", "warning", name, change, STEP_CHANGE, {"percent": 100.0 * change})


def aliased_mode(frequency: float, step: float) -> Finding:
    """Why a mode of ``frequency`` (rad/s), sampled every ``step`` s, has no number."""
    samples = 2.0 * math.pi / (frequency * step)
    return Finding("aliased_mode", "withheld", "", frequency, math.pi / step, {"samples": samples})


def stepwise_inputs(context: Context) -> tuple[Finding, ...]:
    """Inputs that change in steps but are interpolated linearly."""
    lines = [name for name in context.inputs if name not in context.zoh_inputs]
    return tuple(
        Finding("zoh_input", "warning", name)
        for name in lines
        if any(name in one.signals and jumps(one.signals[name]) for one in context.experiments)
    )


def short_records(context: Context) -> tuple[Finding, ...]:
    """Records that hold less than `LEAST_PERIODS` of the mode found."""
    derived = () if context.result is None else context.result.derived
    frequency = next((one.value for one in derived if one.name == "short_period_frequency"), 0.0)
    length = sum(float(one.time[-1] - one.time[0]) for one in context.experiments)
    periods = frequency * length / (2.0 * math.pi)
    if 0.0 < periods < LEAST_PERIODS:
        return (Finding("short_record", "warning", "", periods, LEAST_PERIODS),)
    return ()
