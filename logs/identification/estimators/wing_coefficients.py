"""What the wings' coefficients depend on, and by how much (Grauer et al. 2011, Eq. 17 to 20).

Stepwise regression chooses among speeds, angles, their squares and products; a term stays where it makes the
coefficient at instants that were left out better predicted, and tells a thousandth of its variance at least. (Klein &
Morelli's five thousandths would leave out the heave speed of Eq. 17, which tells three.)

How to fly for it: in steady flight the speeds are functions of the wing's angle and rate, and three strokes of it
cannot tell C_L_vx from C_L_0, nor v_z from the wing's rate. Sweep the elevator about the short period's frequency and
swing the throttle, so that v_x varies by some 0.3 m/s, v_z by 0.8 m/s and omega_y by 0.4 rad/s (standard deviations)
beside the strokes; four seconds then give C_L_0 and C_L_vx four times as well as three strokes do.
"""

from __future__ import annotations

from typing import NamedTuple

from logs.identification.estimators.stepwise import Rules, Step, stepwise_regression
from logs.identification.findings import not_estimated
from logs.identification.models.inverse_dynamics import COEFFICIENTS, STATES, WingCoefficients, product_units
from logs.identification.results import EstimationResult, linear_result
from wingbeat.errors import InputError

RULES = Rules(stop="PRESS", least_gain=0.001, most_terms=8)
CANDIDATES = (*STATES, *product_units())
LEAST_R_SQUARED = 0.5
"""-; a model that tells less of its coefficient is none"""


class AeroResult(NamedTuple):
    """Aerodynamic model of the wings from one or several records."""

    models: tuple[EstimationResult, ...]
    """C_L, C_T and C_m, each by its title; parameters are named by coefficient and term: C_L_0, C_L_v_x"""
    records: tuple[str, ...]
    """-; what it was taken from"""
    notes: tuple[str, ...]
    """-; what was not measured and was taken from elsewhere"""


def identify_coefficients(
    records: tuple[WingCoefficients, ...], candidates: tuple[str, ...] = CANDIDATES, rules: Rules = RULES
) -> AeroResult:
    """Structure and parameters of C_L, C_T and C_m from all records of ``records`` together.

    Raises:
        InputError: no record, a candidate that is no signal, records of different sampling intervals.
    """
    if not records:
        raise InputError("there is no record of the wings' motion to identify coefficients from")
    notes = tuple(dict.fromkeys(note for one in records for note in one.notes))
    models = tuple(_model(records, name, candidates, rules) for name in COEFFICIENTS)
    return AeroResult(models, tuple(one.experiment.name for one in records), notes)


def _model(
    records: tuple[WingCoefficients, ...], name: str, candidates: tuple[str, ...], rules: Rules
) -> EstimationResult:
    outcome = stepwise_regression(tuple(one.experiment for one in records), name, candidates, rules)
    model, r_squared = outcome.model, coefficient_r_squared(outcome.steps)
    failure = outcome.failure or model.failure
    if not failure and r_squared < LEAST_R_SQUARED:
        failure = f"the chosen terms tell {100 * r_squared:.0f} % of its variance"
    found = tuple(one._replace(name=named(name, one.name)) for one in model.estimates)
    lost = tuple(one._replace(subject=named(name, one.subject)) for one in model.withheld)
    return linear_result(
        "stepwise", () if failure else found, (not_estimated(name, failure),) if failure else lost, subject="aero",
        steps=outcome.steps, samples=model.samples, title=name, response=name,
    )  # fmt: skip


def coefficient_terms(model: EstimationResult) -> tuple[str, ...]:
    """Terms of one of C_L, C_T, C_m in the order of their entry, without the constant; empty without estimates."""
    return model.steps[-1].terms if model.estimates else ()


def coefficient_r_squared(steps: tuple[Step, ...]) -> float:
    """Fraction of the variance that the terms chosen in ``steps`` explain."""
    return steps[-1].statistics.r_squared if steps else 0.0


def named(coefficient: str, term: str) -> str:
    """What the parameter of ``term`` is called: C_L_0 of the constant, C_L_v_x."""
    return f"{coefficient}_{'0' if term == 'intercept' else term}"
