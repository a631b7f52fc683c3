"""Diagnostics: checks of data, models and results; each returns findings from one `Context`."""

from __future__ import annotations

from collections.abc import Mapping
from typing import NamedTuple

from logs.identification.data.experiment import Experiment
from logs.identification.results import EstimationResult


class Context(NamedTuple):
    """A diagnostic reads what it needs and reports nothing if that is missing."""

    experiments: tuple[Experiment, ...]
    """the fitted maneuvers as measured"""
    constants: Mapping[str, float] = {}
    """SI; of the map"""
    inputs: tuple[str, ...] = ()
    """-; signals that drive the model"""
    signals: tuple[str, ...] = ()
    """-; outputs of a model, or signals in the regressors"""
    zoh_inputs: tuple[str, ...] = ()
    """-; inputs that are constant between samples"""
    result: EstimationResult | None = None
    linear: bool = False
    """-; the model is linear about one operating point"""
    averaged: bool = False
    """-; the signals are stroke averages, whose noise is not white"""
    results: tuple[EstimationResult, ...] = ()
    """all results of the map, to be compared"""
