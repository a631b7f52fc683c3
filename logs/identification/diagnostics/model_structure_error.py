"""What four states lack, among the errors of their derivatives: by what methods differ, and what a delay would move.

Methods weigh the same data differently: where the model is right they find the same but for noise (Hausman,
Econometrica 46, 1978). Beyond that it is what four states lack. A derivative may be anywhere between the two.
"""

from __future__ import annotations

import numpy as np

from logs.identification.estimators.flight.equation_error import DerivativeFit
from logs.identification.models.stroke_averaged import SHORT_PERIOD
from logs.identification.results import SURE, Array, student_factor
from logs.identification.statistics.parameter_uncertainty import LEAST_CLUSTERS

CALM = 0.97
"""-; of the pitch rate's power by the elevator, above which the air is calm enough for output error to be believed
before filter error: of the linear aircraft in calm air it was 0.986 and above, whatever the stroke modulated, of the
multibody Robo Raven 0.997 and above, of the Arizona 0.977 and above; in gusts of 0.3 m/s 0.96 and below"""


def with_differences(
    first: DerivativeFit, second: DerivativeFit, manoeuvres: int
) -> tuple[DerivativeFit, DerivativeFit]:
    """Both fits, and where they differ by more than their errors allow, each difference among the errors of both.

    Where wings have an inertia that shakes the body both had the frequency 1 to 3 % off the truth. Each derivative
    counts alone; the variance is that about the middle (about either end it would be d^2/3).
    """
    if first.failure or manoeuvres < LEAST_CLUSTERS:
        return first, second
    count = len(first.names)
    errors = [fit.spread.standard_errors()[0][:count] for fit in (first, second)]
    differences = first.values - second.values[:count]
    least = student_factor(manoeuvres - 1.0, 1 - (1 - SURE) / count) * np.hypot(*errors)
    if not np.any(np.abs(differences) > least):
        return first, second
    apart = np.append(differences, np.zeros(len(second.names) - count)) ** 2 / 12
    both = [np.diag(apart[: len(fit.names)]) for fit in (first, second)]
    wider = [fit._replace(spread=fit.spread.plus(more)) for fit, more in zip((first, second), both, strict=True)]
    return wider[0], wider[1]


def with_coarseness(by_filter: DerivativeFit, by_output: DerivativeFit) -> DerivativeFit:
    """Filter error's fit, in calm air with its way to output error's among the errors.

    A forecast of the next stroke lives on what the aircraft does within it, and there four states are coarsest: wings
    that twist, a wake that grows. Of the multibody aircraft in still air it found Z_q at half the truth and the
    frequency 4 % too high at the median of twenty flights, outside its interval in seven, where output error, which
    lives on whole manoeuvres, was right. Each derivative of the short period may be anywhere on its way alone, the
    others on theirs together: the variance about either end is d^2/3. Taken as one way of all the damping was held
    in 15 of the twenty: output error, too, has it too low, by 0.01. In gusts, where output error takes the air's
    work for the tail's, it says nothing.
    """
    if by_filter.failure or by_output.failure or by_output.explained < CALM:
        return by_filter
    found = dict(zip(by_output.names, by_output.values, strict=True))
    apart = np.array([found.get(n, v) - v for n, v in zip(by_filter.names, by_filter.values, strict=True)])
    return by_filter._replace(spread=by_filter.spread.plus(_each_alone(by_filter.names, apart) / 3.0))


def share_of_lack(delay: float, variance: float, sure: float) -> float:
    """Share (0 to 1) of a ``delay`` with the ``variance`` of its noise that counts as what a model lacks.

    None below ``sure`` standard errors; above, as far as its square exceeds twice its variance, from where on a model
    with it would forecast better (Akaike, IEEE Trans. Automatic Control 19(6), 1974).
    """
    if not delay**2 > sure**2 * variance > 0.0:
        return 0.0
    return 1.0 - 2.0 * variance / delay**2


def lacking(fit: DerivativeFit, lack: Array) -> DerivativeFit:
    """``fit`` with the ``lack`` (p,) of its model, or of another fit's to the same data, among its errors.

    All derivatives together may be off by it, or each of the short period alone: which of both is not known, and the
    covariance is the mean of theirs. What a delay does moves eigenvalues along the real axis and hardly changes the
    period: as the one way of all alone it was held in 61 of eighty fits to still flights, with each alone in 75.
    """
    if not len(lack):
        return fit
    covariance = (np.outer(lack, lack) + _each_alone(fit.names, lack)) / 2.0
    return fit._replace(spread=fit.spread.plus(covariance), lack=lack)


def _each_alone(names: tuple[str, ...], way: Array) -> Array:
    """Covariance (p, p) of who may be off by a ``way`` (p,): the short period's derivatives each alone, the others
    together, as which they make the phugoid."""
    alone = np.where([name in SHORT_PERIOD for name in names], way, 0.0)
    rest = way - alone
    return np.asarray(np.outer(rest, rest) + np.diag(alone**2), dtype=np.float64)
