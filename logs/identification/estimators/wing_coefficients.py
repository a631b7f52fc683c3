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
from logs.identification.models.inverse_dynamics import COEFFICIENTS, STATES, WingCoefficients, product_units
from logs.identification.results import Estimate, Unidentified
from wingbeat.errors import InputError

RULES = Rules(stop="PRESS", least_gain=0.001, most_terms=8)
CANDIDATES = (*STATES, *product_units())
LEAST_R_SQUARED = 0.5
"""-; a model that tells less of its coefficient is none"""


class CoefficientModel(NamedTuple):
    """One of C_L, C_T, C_m as a sum of terms."""

    name: str
    """-; of the coefficient"""
    terms: tuple[str, ...]
    """-; without the constant, in the order in which they entered"""
    estimates: tuple[Estimate, ...]
    """named as the coefficient and its term: C_L_0, C_L_v_x"""
    unidentified: tuple[Unidentified, ...]
    steps: tuple[Step, ...]
    """of the choice of terms"""
    r_squared: float
    """-; share of the coefficient's variance that the model tells"""
    samples: int
    """-; used"""


class AeroResult(NamedTuple):
    """Aerodynamic model of the wings from one or several records."""

    models: tuple[CoefficientModel, ...]
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
) -> CoefficientModel:
    outcome = stepwise_regression(tuple(one.experiment for one in records), name, candidates, rules)
    model, told = outcome.model, outcome.steps[-1].statistics.r_squared if outcome.steps else 0.0
    failure = outcome.failure or model.failure
    if not failure and told < LEAST_R_SQUARED:
        failure = f"the chosen terms tell {100 * told:.0f} % of its variance"
    if failure:
        return CoefficientModel(name, (), (), (Unidentified(name, failure),), outcome.steps, told, model.samples)
    return CoefficientModel(
        name,
        outcome.terms,
        tuple(one._replace(name=named(name, one.name)) for one in model.estimates),
        tuple(Unidentified(named(name, one.subject), one.text) for one in model.withheld),
        outcome.steps,
        told,
        model.samples,
    )


def named(coefficient: str, term: str) -> str:
    """What the parameter of ``term`` is called: C_L_0 of the constant, C_L_v_x."""
    return f"{coefficient}_{'0' if term == 'intercept' else term}"
