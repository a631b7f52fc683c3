"""Result of the identification from tables: one `EstimationResult` for each fit of the map, and the modes."""

from __future__ import annotations

from collections.abc import Mapping
from typing import NamedTuple

from logs.identification.data.experiment import Experiment
from logs.identification.findings import Finding
from logs.identification.models.modes import ModesResult
from logs.identification.results import Estimate, EstimationResult


class TableIdentification(NamedTuple):
    """Everything that was identified from one or several tables."""

    files: tuple[str, ...]
    experiments: tuple[str, ...]
    """-; names of the maneuvers that were fitted"""
    held_out: tuple[str, ...]
    """-; names of those that were only predicted"""
    fits: tuple[EstimationResult, ...]
    modes: ModesResult | None
    """by every method; None if not requested"""
    findings: tuple[Finding, ...] = ()
    """on the data and on the results together"""
    missing: tuple[Finding, ...] = ()
    """sections or fits of the map (subject) without a result"""
    records: tuple[Experiment, ...] = ()
    """the maneuvers, fitted ones first"""
    inputs: tuple[str, ...] = ()
    """-; signals that the map calls inputs"""
    constants: Mapping[str, float] = {}
    """SI; of the map"""
    delays: tuple[Estimate, ...] = ()
    """s; measured delays of signals, by name"""
