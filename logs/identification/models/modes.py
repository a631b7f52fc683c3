"""A mode of motion of second order: what it is known by, with the errors of everything, and where it comes from."""

from __future__ import annotations

import math
from collections.abc import Callable
from functools import partial
from typing import Any, NamedTuple

import numpy as np

from logs.identification.data.maneuvers import Maneuver, Reference
from logs.identification.findings import Finding, not_estimated
from logs.identification.results import Array, Estimate, EstimationResult
from logs.identification.statistics.covariance import ParameterUncertainty, propagate

SHORT_PERIOD, PHUGOID = KINDS = ("short_period", "phugoid")
WIDEST = 1.0
"""-; of the value: a frequency with a wider half interval is not identified"""
HEAVY = "it falls to half within a quarter of a cycle: decay and drift are not told apart"
UNSURE = "the interval of its frequency reaches zero: fly more or larger inputs"
FORCED = "it is not seen to decay: a forced motion, such as flapping, is no mode"
LEAST_APART = 2.0
"""-; the short period's frequency over the phugoid's. Closer pairs are parts of one motion: at 1 Hz the free response
found a phugoid of 0.2 rad/s and a short period of 0.24 or 0.40 where 3.8 was true"""


class Oscillation(NamedTuple):
    """One mode of second order, whether it oscillates or not."""

    frequency: Estimate
    """rad/s; undamped natural frequency"""
    damping: Estimate
    """-; damping ratio; above 1 the mode does not oscillate"""
    period: Estimate | None
    """s; of the damped oscillation; None where the interval of the damping reaches 1"""
    time_to_half: Estimate | None
    """s; until the amplitude has halved, or doubled where the name says so; None where neither is sure"""
    cycles: Estimate | None
    """-; oscillations until then"""
    time_constants: tuple[Estimate, ...]
    """s; the two of a mode that does not oscillate, the shorter first, else empty"""

    @property
    def estimates(self) -> tuple[Estimate, ...]:
        """Every number that there is."""
        timing = (self.period, self.time_to_half, self.cycles)
        return (self.frequency, self.damping, *(e for e in timing if e is not None), *self.time_constants)


class Mode(NamedTuple):
    """The modes of motion by one method."""

    method: str
    """-; what reports call it"""
    short_period: Oscillation | None
    """None where not identified"""
    phugoid: Oscillation | None
    """None where not identified or not asked for"""
    eigenvalues: tuple[complex, ...]
    """1/s; of the whole model"""
    derivatives: tuple[Estimate, ...]
    """the model's parameters"""
    withheld: tuple[Finding, ...]
    """what this method does not give, and why"""
    divergence: tuple[Estimate, ...] = ()
    """s; time in which a real mode doubles and time constant of the one that decays beside it, where the faster two
    eigenvalues are these and no short period"""

    @property
    def frequency(self) -> Estimate | None:
        """Undamped natural frequency of the short period in rad/s, None where not identified."""
        return None if self.short_period is None else self.short_period.frequency

    @property
    def damping(self) -> Estimate | None:
        """Damping ratio of the short period, None where not identified."""
        return None if self.short_period is None else self.short_period.damping

    @property
    def time_constants(self) -> tuple[Estimate, ...]:
        """The two time constants in s of a short period that does not oscillate, else empty."""
        return () if self.short_period is None else self.short_period.time_constants

    def of_kind(self, kind: str) -> Oscillation | None:
        """The short period or the phugoid, by its name in `KINDS`."""
        return self.short_period if kind == SHORT_PERIOD else self.phugoid


class ModesResult(NamedTuple):
    """The modes of a flight or of a set of experiments by every method."""

    modes: tuple[Mode, ...]
    """one per method"""
    agree: bool | None
    """-; None where fewer than two methods gave a number"""
    statement: str
    """-; one sentence on the agreement"""
    reference: Reference | None
    """the flight condition, None where the records do not tell it"""
    manoeuvres: int
    """-; how many inputs or records were used"""
    wing_period: float | None
    """s; mean in the maneuvers, None without flapping wings"""
    maneuvers: tuple[Maneuver, ...] = ()
    """of a flight; empty of experiments"""
    results: tuple[EstimationResult, ...] = ()
    """of the methods with a physical model"""
    held_out: tuple[Maneuver, ...] = ()
    """whole flights that were not fitted, for the validation"""
    findings: tuple[Finding, ...] = ()
    flight: Any = None
    """`estimators.flight_modes.FlightProblem` that was fitted; None of experiments"""

    @property
    def notes(self) -> tuple[str, ...]:
        """What was replaced or decided, and what casts doubt on the modes; the statement has the disagreement."""
        return tuple(one.text for one in self.findings if one.code != "methods_disagree")


def nothing(method: str, why: str, kinds: tuple[str, ...] = (SHORT_PERIOD,)) -> Mode:
    """A method without a number, and why."""
    return Mode(method, None, None, (), (), tuple(not_estimated(kind, why) for kind in kinds))


def mode_of_result(title: str, result: EstimationResult) -> Mode:
    """The mode of a result whose numbers are ``<kind>_frequency`` and ``<kind>_damping``, if it has them."""
    pairs: dict[str, Oscillation | None] = dict.fromkeys(KINDS)
    rest = {one.name: one for one in (*result.estimates, *result.derived)}
    for kind in KINDS:
        if f"{kind}_frequency" in rest and f"{kind}_damping" in rest:
            frequency, damping = rest.pop(f"{kind}_frequency"), rest.pop(f"{kind}_damping")
            period, half, cycles = (
                rest.pop(f"{kind}_{name}", None) for name in ("period", "time_to_half", "cycles_to_half")
            )
            pairs[kind] = Oscillation(frequency, damping, period, half, cycles, ())
    short, slow = pairs.values()
    return Mode(title, short, slow, (), tuple(rest.values()), result.withheld)


def without_heavy(mode: Mode, most: float) -> Mode:
    """The mode, less what may be damped by more than ``most`` (-): of such a one decay and drift are not told apart.

    A short period that may be is taken for a part of a phugoid's decay: then neither is told.
    """
    heavy = [kind for kind in KINDS if (one := mode.of_kind(kind)) is not None and one.damping.high > most]
    if not heavy:
        return mode
    gone = [kind for kind in (KINDS if SHORT_PERIOD in heavy else heavy) if mode.of_kind(kind) is not None]
    missing = (*mode.withheld, *(not_estimated(kind, HEAVY) for kind in gone))
    if SHORT_PERIOD in heavy or mode.short_period is None:
        return nothing(mode.method, HEAVY)._replace(withheld=missing)
    return mode._replace(phugoid=None, withheld=missing)


def pair_of(first: complex, second: complex) -> tuple[float, float]:
    """Undamped natural frequency (rad/s) and damping ratio of two eigenvalues, a complex pair or both real.

    A damping ratio above 1 belongs to two real eigenvalues; both numbers pass smoothly through 1.

    Raises:
        ValueError: one of the two is positive and the other negative: no mode of second order.
    """
    product, total = (first * second).real, (first + second).real
    if product <= 0:
        raise ValueError("the eigenvalues have different signs: a divergence, no mode of second order")
    return math.sqrt(product), -total / (2 * math.sqrt(product))


def short_period_of(system: Array, fastest_phugoid: float = math.inf) -> tuple[float, float]:
    """Undamped natural frequency (rad/s) and damping ratio of the short period of ``system`` (n, n): `split_pairs`.

    Raises:
        ValueError: one of the two is positive and the other negative: no mode of second order.
    """
    try:
        return pair_of(*split_pairs(system, fastest_phugoid)[0])
    except ValueError as error:
        raise ValueError("the faster eigenvalues have different signs: a divergence, no short-period mode") from error


def phugoid_of(system: Array, fastest_phugoid: float = math.inf) -> tuple[float, float]:
    """Undamped natural frequency (rad/s) and damping ratio of the slower pair of a ``system`` (4, 4).

    Raises:
        ValueError: there is no slower pair, or its eigenvalues have different signs.
    """
    slow = split_pairs(system, fastest_phugoid)[1]
    if len(slow) != 2:
        raise ValueError("the model holds the speed constant")
    return pair_of(*slow)


def split_pairs(system: Array, fastest_phugoid: float = math.inf) -> tuple[Array, Array]:
    """The eigenvalues of the short period, and the others: the two of greatest modulus, complex pairs together.

    An oscillation faster than ``fastest_phugoid`` (rad/s) is the short period even if two real eigenvalues are
    faster.
    """
    roots = np.linalg.eigvals(system).astype(complex)
    roots = roots[np.argsort(-np.abs(roots), kind="stable")]
    oscillating = np.flatnonzero(np.abs(roots.imag) > 1e-9)
    if len(oscillating) == 2 and abs(roots[oscillating[0]]) > fastest_phugoid:
        chosen = np.isin(np.arange(len(roots)), oscillating)
        return roots[chosen], roots[~chosen]
    partner = 1 if abs(roots[0].imag) > 1e-9 else 1 + int(np.argmax(np.abs(roots[1:].imag) <= 1e-9))
    chosen = np.isin(np.arange(len(roots)), (0, partner))
    return roots[chosen], roots[~chosen]


def oscillation(kind: str, pair: Array, spread: ParameterUncertainty) -> Oscillation | Finding:
    """A mode from its ``pair`` (2,) of frequency (rad/s) and damping ratio and what they are worth.

    Times and cycles are monotone in the decay rate, the damped frequency and their ratio: the ends of their
    intervals are those of what they are computed from, so that a decay that may be none gives no time to half.
    """
    frequency, damping = spread.estimates({f"{kind}_frequency": "rad/s", f"{kind}_damping": "-"}, pair)
    if not np.all(np.isfinite(spread.standard_errors)) or frequency.low < (1 - WIDEST) * frequency.value:
        return not_estimated(kind, UNSURE)
    rate = computed(lambda p: float(p[0] * p[1]), pair, spread)
    half = over(f"{kind}_time_to_{_change(rate)}", "s", math.log(2), rate)
    constants = _time_constants(pair, spread) if pair[1] >= 1 else ()
    if damping.high >= 1 or damping.low <= -1:
        return Oscillation(frequency, damping, None, half, None, constants)
    turning = computed(lambda p: float(p[0] * math.sqrt(max(1 - p[1] ** 2, 1e-12))), pair, spread)
    ratio = computed(lambda p: float(p[1] / math.sqrt(max(1 - p[1] ** 2, 1e-12))), pair, spread)
    period = over(f"{kind}_period", "s", 2 * math.pi, turning)
    cycles = over(f"{kind}_cycles_to_{_change(rate)}", "-", math.log(2) / (2 * math.pi), ratio)
    return Oscillation(frequency, damping, period, half, cycles, constants)


def _change(rate: Estimate) -> str:
    return "half" if rate.value > 0 else "double"


def computed(of: Callable[[Array], float], values: Array, spread: ParameterUncertainty) -> Estimate:
    """The number that is ``of`` parameters ``values`` (p,), by the delta method; without name and unit."""
    value, worth = propagate(lambda p: np.array([of(p)]), values, spread)
    return worth.estimates({"": ""}, value)[0]


def over(name: str, unit: str, numerator: float, below: Estimate) -> Estimate | None:
    """``numerator`` / |``below``| with the ends of the interval of ``below``; None where that reaches zero."""
    if below.low <= 0 <= below.high:
        return None
    value = numerator / abs(below.value)
    low, high = sorted((numerator / abs(below.low), numerator / abs(below.high)))
    return Estimate(name, unit, value, value * abs(below.standard_error / below.value), low, high)


def _time_constants(pair: Array, spread: ParameterUncertainty) -> tuple[Estimate, ...]:
    def constants(p: Array) -> Array:
        root = math.sqrt(max(p[1] ** 2 - 1, 0.0))
        return np.array([1 / (p[0] * (p[1] + root)), 1 / (p[0] * (p[1] - root))])

    values, worth = propagate(constants, pair, spread)
    return worth.estimates({"time_constant_1": "s", "time_constant_2": "s"}, values)


def paired_mode(
    method: str,
    kinds: tuple[str, ...],
    pairs: Array,
    spread: ParameterUncertainty,
    parameters: tuple[Estimate, ...] = (),
) -> Mode:
    """Modes ``kinds`` of a method that fits frequency and damping of each of them itself, ``pairs`` (2 k,).

    ``spread`` of 2 k + n parameters has the pairs first; the fastest pair is the first of ``kinds``. A short period
    whose damping's interval holds zero is none: of a bird that shook at 4.7 Hz such methods told that as its mode.
    """
    if len(kinds) > 1 and np.max(pairs[::2]) < LEAST_APART * np.min(pairs[::2]):
        return nothing(
            method, "two modes are not told apart: what was found turns nearly as fast as the other", kinds
        )
    found: dict[str, Oscillation | None] = dict.fromkeys(KINDS)
    missing = []
    for kind, index in zip(kinds, np.argsort(-pairs[::2]), strict=True):
        chosen = slice(2 * index, 2 * index + 2)
        outcome = oscillation(kind, pairs[chosen], spread.part(chosen))
        if isinstance(outcome, Finding):
            missing.append(outcome)
        elif kind == SHORT_PERIOD and outcome.damping.low <= 0.0 <= outcome.damping.high:
            missing.append(not_estimated(kind, FORCED))
        else:
            found[kind] = outcome
    roots = tuple(root for pair in pairs.reshape(-1, 2).tolist() for root in eigenvalues_of(*pair))
    return Mode(method, found[SHORT_PERIOD], found[PHUGOID], roots, parameters, tuple(missing))


def eigenvalues_of(frequency: float, damping: float) -> list[complex]:
    """The two roots in 1/s of ``s^2 + 2 zeta omega s + omega^2``."""
    root = np.sqrt(complex(damping**2 - 1))
    return [complex(frequency * (-damping + sign * root)) for sign in (1, -1)]


PAIRS = ((SHORT_PERIOD, short_period_of), (PHUGOID, phugoid_of))


def mode_of_system(
    method: str,
    system: Callable[[Array], Array],
    values: Array,
    spread: ParameterUncertainty,
    derivatives: tuple[Estimate, ...] = (),
    fastest_phugoid: float = math.inf,
) -> Mode:
    """Short period and, of four states, phugoid of the ``system`` (n, n) that parameters ``values`` (p,) make.

    ``spread`` is that of the parameters; the errors of the modes follow by the delta method. ``fastest_phugoid``
    (rad/s) as of `split_pairs`.
    """
    eigenvalues = tuple(complex(root) for root in np.linalg.eigvals(system(values)))
    found: dict[str, Oscillation | None] = dict.fromkeys(KINDS)
    missing = []
    for kind, of in PAIRS[: len(eigenvalues) // 2]:
        outcome = _carried(kind, partial(of, fastest_phugoid=fastest_phugoid), system, values, spread)
        if isinstance(outcome, Finding):
            missing.append(outcome)
        else:
            found[kind] = outcome
    divergence = () if found[SHORT_PERIOD] else _divergence(system, values, spread)
    return Mode(method, found[SHORT_PERIOD], found[PHUGOID], eigenvalues, derivatives, tuple(missing), divergence)


def _divergence(
    system: Callable[[Array], Array], values: Array, spread: ParameterUncertainty
) -> tuple[Estimate, ...]:
    """Of the faster two eigenvalues, where one grows and the other decays; none where that is not sure."""

    def rates(parameters: Array) -> Array:
        roots = np.sort(split_pairs(system(parameters))[0].real)
        return np.array([roots[-1], -roots[0]])

    if np.any(np.abs(split_pairs(system(values))[0].imag) > 0) or not np.all(rates(values) > 0):
        return ()
    found, worth = propagate(rates, values, spread)
    growing, decaying = worth.estimates({"growing": "1/s", "decaying": "1/s"}, found)
    double = over("divergence_time_to_double", "s", math.log(2), growing)
    constant = over("decay_time_constant", "s", 1.0, decaying)
    return () if double is None else tuple(one for one in (double, constant) if one is not None)


def _carried(
    kind: str,
    of: Callable[[Array], tuple[float, float]],
    system: Callable[[Array], Array],
    values: Array,
    spread: ParameterUncertainty,
) -> Oscillation | Finding:
    try:
        pair, worth = propagate(lambda v: np.array(of(system(v))), values, spread)
    except ValueError as error:
        return not_estimated(kind, str(error))
    return oscillation(kind, pair, worth)
