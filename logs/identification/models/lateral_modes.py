"""Dutch roll, roll and spiral mode of a fitted lateral model, with the errors of everything.

Of the eigenvalues of sideslip, roll rate, yaw rate and bank the complex pair is the Dutch roll, the faster of the two
real ones the roll mode, the slower the spiral (Etkin, Dynamics of Atmospheric Flight, 1972, ch. 9.6). Where those two
are a complex pair as well, slower than the Dutch roll, they are the lateral phugoid. Errors by the delta method.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from functools import partial

import numpy as np

from logs.identification.findings import Finding, not_estimated
from logs.identification.models.modes import Oscillation, computed, oscillation, over, pair_of
from logs.identification.results import Array, Estimate
from logs.identification.statistics.covariance import ParameterUncertainty, propagate

DUTCH_ROLL, ROLL, SPIRAL, LATERAL_PHUGOID = "dutch_roll", "roll", "spiral", "lateral_phugoid"
TURNING = 1e-9
"""1/s; imaginary part of an eigenvalue that counts as real"""
System = Callable[[Array], Array]


LateralModes = tuple[tuple[Estimate, ...], tuple[Finding, ...]]
"""frequency (rad/s), damping ratio, period, time and cycles to half of what oscillates; time constants (s) of roll;
time to half or to double (s) of the spiral; and the modes that are withheld"""


def lateral_modes(system: System, values: Array, spread: ParameterUncertainty) -> LateralModes:
    """The modes of the ``system`` (4, 4) of sideslip, roll rate, yaw rate and bank that ``values`` (p,) make.

    ``spread`` is that of the parameters.
    """
    roots = np.linalg.eigvals(system(values)).astype(complex)
    if len(roots) != 4:
        why = "it takes sideslip, roll rate, yaw rate and bank among the model's states"
        return (), (*(not_estimated(kind, why) for kind in (DUTCH_ROLL, ROLL, SPIRAL)),)
    pairs = int(np.sum(roots.imag > TURNING))
    if pairs == 0:
        why = "no eigenvalues of the fitted model are a complex pair: it does not oscillate"
        return (), (*(not_estimated(kind, why) for kind in (DUTCH_ROLL, ROLL, SPIRAL)),)
    found = [_oscillation(DUTCH_ROLL, 0, system, values, spread)]
    if pairs == 2:
        found.append(_oscillation(LATERAL_PHUGOID, 1, system, values, spread))
        return _collected(found, [])
    rates = [computed(partial(_decay, system, place), values, spread) for place in (0, 1)]
    return _collected(found, [_constant(ROLL, rates[0]), _halving(SPIRAL, rates[1])])


def _collected(pairs: list[Oscillation | Finding], single: list[Estimate | Finding]) -> LateralModes:
    """All of it, sorted into what is known and what is not."""
    estimates: list[Estimate] = []
    for pair in pairs:
        estimates += pair.estimates if isinstance(pair, Oscillation) else ()
    estimates += [one for one in single if isinstance(one, Estimate)]
    return tuple(estimates), tuple(one for one in (*pairs, *single) if isinstance(one, Finding))


def _oscillation(
    kind: str, place: int, system: System, values: Array, spread: ParameterUncertainty
) -> Oscillation | Finding:
    """The complex pair that is the ``place``-th fastest."""

    def pair(at: Array) -> Array:
        roots = np.linalg.eigvals(system(at)).astype(complex)
        turning = roots[roots.imag > TURNING]
        chosen = turning[np.argsort(-np.abs(turning))][min(place, len(turning) - 1)] if len(turning) else roots[0]
        return np.array(pair_of(chosen, chosen.conjugate()))

    return oscillation(kind, *propagate(pair, values, spread))


def _decay(system: System, place: int, at: Array) -> float:
    """By how much (1/s) the ``place``-th fastest of the modes that do not oscillate decays."""
    roots = np.linalg.eigvals(system(at)).astype(complex)
    still = roots[np.abs(roots.imag) <= TURNING].real
    return float(-still[np.argsort(-np.abs(still))][place]) if len(still) > place else math.nan


def _constant(kind: str, rate: Estimate) -> Estimate | Finding:
    """The time in which a mode falls to 1/e."""
    found = over(f"{kind}_time_constant", "s", 1.0, rate)
    return not_estimated(kind, _neutral(rate)) if found is None or rate.value < 0 else found


def _halving(kind: str, rate: Estimate) -> Estimate | Finding:
    """The time in which a mode halves or doubles."""
    change = "half" if rate.value > 0 else "double"
    return over(f"{kind}_time_to_{change}", "s", math.log(2), rate) or not_estimated(kind, _neutral(rate))


def _neutral(rate: Estimate) -> str:
    if rate.high < 0:
        return "it grows: no mode that subsides"
    return f"its decay, {rate.value:.2g} ({rate.low:.2g} to {rate.high:.2g}) 1/s, may be none"
