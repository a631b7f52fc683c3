"""The short-period mode of a flight: two methods, their intervals, and whether they agree."""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from logs.identification.data import Aircraft, FlightData
from logs.identification.delta import propagate
from logs.identification.modes.equation_error import DerivativeFit, equation_error, failed, likely_lag
from logs.identification.modes.longitudinal import LONGITUDINAL, TAIL, TAIL_LAG, UNITS, matrices, modes_matrix
from logs.identification.modes.output_error import Problem, flown_regressors, output_error
from logs.identification.preparing.manoeuvre import Reference, find_manoeuvres, lagged, reference_of
from logs.identification.results import Array, Estimate, Unidentified, estimate, estimates

FITTED_OUTPUTS = (0, 1, 2)
"""-; of `output_error.OUTPUTS`: q, a_x and a_z. The AHRS's pitch is the gyro integrated: it adds nothing"""
TAIL_PASSES = 3
WIDEST = 1.0
"""-; of the value: a frequency with a wider half interval is not identified"""


class Mode(NamedTuple):
    """The short-period mode by one method."""

    method: str
    """-; equation error or output error"""
    frequency: Estimate | None
    """rad/s; undamped natural frequency, None where not identified"""
    damping: Estimate | None
    """-; damping ratio; above 1 the mode does not oscillate"""
    time_constants: tuple[Estimate, ...]
    """s; the two of a mode that does not oscillate, else empty"""
    eigenvalues: tuple[complex, ...]
    """1/s; of the whole model"""
    derivatives: tuple[Estimate, ...]
    """the model's parameters"""
    unidentified: tuple[Unidentified, ...]
    """what this method does not give, and why"""


class ModesResult(NamedTuple):
    """The short period of a flight."""

    modes: tuple[Mode, ...]
    """one per method"""
    agree: bool | None
    """-; None where a method gave nothing"""
    statement: str
    """-; one sentence on the agreement"""
    reference: Reference
    """the flight condition"""
    manoeuvres: int
    """-; how many inputs were used"""
    wing_period: float
    """s; mean in the manoeuvres"""
    notes: tuple[str, ...] = ()
    """-; what the log does not tell and was taken from elsewhere"""


def short_period_of(system: Array) -> tuple[float, float]:
    """Undamped natural frequency (rad/s) and damping ratio of the faster pair of eigenvalues of ``system`` (n, n).

    A damping ratio above 1 belongs to two real eigenvalues; both numbers pass smoothly through 1.

    Raises:
        ValueError: one of the two is positive and the other negative: no mode of second order.
    """
    fast = faster_pair(system)
    product, total = (fast[0] * fast[1]).real, (fast[0] + fast[1]).real
    if product <= 0:
        raise ValueError("the faster eigenvalues have different signs: a divergence, no short-period mode")
    return math.sqrt(product), -total / (2 * math.sqrt(product))


def faster_pair(system: Array) -> Array:
    """The two eigenvalues of greatest modulus; a complex pair is not torn apart."""
    roots = np.linalg.eigvals(system)
    order = np.argsort(-np.abs(roots))
    first = roots[order[0]]
    if abs(first.imag) > 1e-9:
        pair: Array = np.array([first, np.conj(first)])
        return pair
    real = [root for root in roots[order[1:]] if abs(root.imag) <= 1e-9]
    return np.array([first, real[0]])


def _time_constants(system: Array) -> Array:
    pair = faster_pair(system)
    constants: Array = np.sort(-1 / pair.real)
    return constants


def mode_of(method: str, fit: DerivativeFit, reference: Reference, aircraft: Aircraft) -> Mode:
    """The mode that a method's derivatives have, errors by the delta method."""
    if fit.failure:
        return _nothing(method, fit.failure)

    def system(values: Array) -> Array:
        return modes_matrix(matrices(fit.names, values, reference, aircraft), fit.names)

    derivatives = estimates({n: UNITS[n] for n in fit.names}, fit.values, fit.covariance, fit.degrees)
    eigenvalues = tuple(complex(root) for root in np.linalg.eigvals(system(fit.values)))
    try:
        both, errors = propagate(lambda v: np.array(short_period_of(system(v))), fit.values, fit.covariance)
    except ValueError as error:
        return _nothing(method, str(error))._replace(eigenvalues=eigenvalues, derivatives=derivatives)
    frequency = estimate("short_period_frequency", "rad/s", both[0], errors[0], fit.degrees)
    damping = estimate("short_period_damping", "-", both[1], errors[1], fit.degrees)
    if not np.all(np.isfinite(errors)) or frequency.low < (1 - WIDEST) * frequency.value:
        why = "the interval of its frequency reaches zero: fly more or larger elevator inputs"
        return _nothing(method, why)._replace(eigenvalues=eigenvalues, derivatives=derivatives)
    constants: tuple[Estimate, ...] = ()
    if both[1] >= 1:
        values, deviations = propagate(lambda v: _time_constants(system(v)), fit.values, fit.covariance)
        constants = tuple(
            estimate(f"time_constant_{i + 1}", "s", values[i], deviations[i], fit.degrees) for i in range(2)
        )
    return Mode(method, frequency, damping, constants, eigenvalues, derivatives, ())


def _nothing(method: str, why: str) -> Mode:
    return Mode(method, None, None, (), (), (), (Unidentified("short_period", why),))


def identify_modes(
    data: FlightData,
    aircraft: Aircraft,
    names: tuple[str, ...] = LONGITUDINAL,
    outputs: tuple[int, ...] = FITTED_OUTPUTS,
) -> ModesResult:
    """The short period of a flight by frequency-domain equation error and by output error.

    Raises:
        BadInput: no usable elevator manoeuvre.
    """
    manoeuvres = find_manoeuvres(data, aircraft)
    reference = reference_of(data, manoeuvres)
    problem = Problem(manoeuvres, reference, aircraft, names, outputs)
    first, second = _both_fits(problem) if aircraft.tail_time_constant is not None else _with_unknown_tail(problem)
    modes = (
        mode_of("output error", second, reference, aircraft),
        mode_of("equation error, frequency domain", first, reference, aircraft),
    )
    agree, statement = _agreement(modes)
    period = float(np.mean([m.period for m in manoeuvres]))
    return ModesResult(modes, agree, statement, reference, len(manoeuvres), period, data.notes)


def _both_fits(problem: Problem) -> tuple[DerivativeFit, DerivativeFit]:
    """Equation error, and output error that starts from it."""
    derivatives = tuple(name for name in problem.names if name not in TAIL)
    first = equation_error(problem.manoeuvres, problem.reference, problem.aircraft, derivatives)
    if first.failure:
        return first, failed(problem.names, f"no starting values: {first.failure}")
    start = np.concatenate((first.values, np.zeros(len(problem.names) - len(derivatives))))
    second = output_error(problem, start)
    if second.failure:
        return first, second
    clean = flown_regressors(problem, second)
    return equation_error(problem.manoeuvres, problem.reference, problem.aircraft, derivatives, clean), second


def _with_unknown_tail(problem: Problem) -> tuple[DerivativeFit, DerivativeFit]:
    """Both fits with the tail's time constant as one more parameter, linearised anew about what was found."""
    derivatives = tuple(name for name in problem.names if name not in TAIL)
    constant = likely_lag(problem.manoeuvres, problem.reference, problem.aircraft, derivatives)
    for _ in range(TAIL_PASSES):
        aircraft = problem.aircraft._replace(tail_time_constant=constant)
        manoeuvres = tuple(lagged(m, aircraft) for m in problem.manoeuvres)
        names = (*derivatives, TAIL_LAG)
        first, second = _both_fits(problem._replace(manoeuvres=manoeuvres, aircraft=aircraft, names=names))
        if second.failure:
            break
        second.values[-1] += constant
        constant = max(float(second.values[-1]), 0.0)
    return first, second


def _agreement(modes: tuple[Mode, ...]) -> tuple[bool | None, str]:
    """Whether frequency and damping differ by less than the intervals of their difference allow."""
    a, b = modes
    if a.frequency is None or b.frequency is None or a.damping is None or b.damping is None:
        return None, "no comparison: " + "; ".join(
            f"{m.method}: {m.unidentified[0].reason}" for m in modes if m.unidentified
        )
    apart = [
        f"{one.name} differs by {one.value - other.value:+.3g} {one.unit}, more than {allowed:.2g} {one.unit}"
        for one, other in ((a.frequency, b.frequency), (a.damping, b.damping))
        if abs(one.value - other.value) > (allowed := math.hypot(one.high - one.value, other.high - other.value))
    ]
    if apart:
        return False, "the two methods disagree: " + "; ".join(apart)
    return True, "the two methods agree within the 95 % interval of their difference"
