"""Equation error in the frequency domain for the short period: two equations, each a regression.

Grauer Eq. 20 and 21; Klein & Morelli, Aircraft System Identification, 2006, ch. 7. Each equation is its integral over
one sampling interval: differences of alpha and q, and the means of motion and inputs between the samples. The means
of the inputs are exact, held or linear and delayed. The fitted equations are simulated with the measured inputs: the
simulated motion is the instrument of the next pass, since noise in the regressors would attenuate their coefficients
(Young, Recursive Estimation and Time-Series Analysis, 1984, ch. 8), and its exact means replace those of a cubic.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import NamedTuple

import numpy as np
from scipy.linalg import expm

from logs.identification.data.experiment import Experiment
from logs.identification.data.resampling import in_band, whole_records
from logs.identification.estimators.equation_error import Settings, default_frequencies, equations
from logs.identification.estimators.least_squares import regress_records
from logs.identification.estimators.regressors import SMOOTH, Design, Record, common_step
from logs.identification.models.modes import Mode, mode_of_system, nothing
from logs.identification.results import Array
from logs.identification.statistics.covariance import ParameterUncertainty
from sim_bridge.compiled import njit
from wingbeat.errors import InputError

METHOD = "equation error"
STATES = ("alpha", "q")
LONGEST_GAP = 5
"""-; missing samples in a row that are interpolated"""
MIN_SAMPLES = 32
PASSES = 4
HIGHEST = 0.125
"""-; of the sampling rate: above it differences are noise"""
MAX_GROWTH = 3.0
"""-; exponent by which a simulated motion may grow over a record and still be an instrument"""
MIN_EXPLAINED = 0.5
"""-; of the response in the band"""
SAME = 1e-9
"""-; of a step: times closer to a sample are at it"""


class Acting(NamedTuple):
    """Inputs that act in each step, before the change in it and after."""

    fraction: float
    """-; of the step, before the change"""
    early: tuple[Array, Array]
    """(N - 1, k) each; at the start of the step, and just before the change"""
    later: tuple[Array, Array]
    """(N - 1, k) each; just after the change, and just before the end of the step"""
    before: Array
    """(N, k); at the samples, just before a change there"""

    @property
    def means(self) -> Array:
        """Mean (N - 1, k) over each step."""
        early, later = ((one + other) / 2 for one, other in (self.early, self.later))
        mean: Array = self.fraction * early + (1.0 - self.fraction) * later
        return mean


class Motion(NamedTuple):
    """Motion of a linear system."""

    states: Array
    """(N, n)"""
    means: Array
    """(N - 1, n); of the states over each step"""
    rates: Array
    """(N, n); of the states at the samples, just before a change of the inputs there"""


Motions = list[Motion] | list[None]


class EquationSettings(NamedTuple):
    """What is to be fitted."""

    inputs: tuple[str, ...]
    """-; names of signals; none for a free motion"""
    fixed: Mapping[str, float] = {}
    """SI; derivatives with a fixed value, by name: Z_q, M_delta_e, ..."""
    airspeed: float | None = None
    """m/s; with it a measured a_z is the response of the force equation, else the derivative of alpha"""
    arm: float = 0.0
    """m; of the accelerometers forward of the center of mass"""
    delay: float = 0.0
    """s; of the inputs"""
    delay_error: float = 0.0
    """s; standard error of that delay"""
    frequencies: Array | None = None
    """Hz; (F,), by the regressors if None"""
    zoh_inputs: tuple[str, ...] = ()
    """-; inputs with a zero-order hold; the others are linear between samples"""


class _Equation(NamedTuple):
    """One equation, solved."""

    names: tuple[str, ...]
    """-; (k,), free derivatives"""
    values: Array
    covariance: Array
    degrees: float
    explained: float
    """-; fraction of the response's power in the band"""


def frequency_equation_error(experiments: tuple[Experiment, ...], settings: EquationSettings) -> Mode:
    """The short period of ``experiments`` in which alpha and q (and a_z) were measured."""
    try:
        records = _records(experiments, settings)
        common_step(records)
        first = _solved(records, settings)
        values, covariance = _joint(first)
        if settings.delay_error > 0:
            later = _solved(records, settings._replace(delay=settings.delay + settings.delay_error))
            moved = _joint(later)[0] - values
            covariance = covariance + np.outer(moved, moved)
    except InputError as error:
        return nothing(METHOD, str(error))
    except np.linalg.LinAlgError:
        return nothing(METHOD, "the records do not excite alpha, q and inputs apart")
    names = tuple(name for one in first for name in one.names)
    spread = ParameterUncertainty(covariance, min(one.degrees for one in first))
    units = {name: "1/s" if name.startswith("Z") or name == "M_q" else "1/s^2" for name in names}
    derivatives = spread.estimates(units, values)
    return mode_of_system(METHOD, lambda v: _system(names, v, settings)[0], values, spread, derivatives)


def _records(experiments: tuple[Experiment, ...], settings: EquationSettings) -> tuple[Experiment, ...]:
    """Contiguous records of the signals that the equations need.

    Raises:
        InputError: one of them was not measured, or no record is long enough.
    """
    needed = [*STATES, *(("a_z",) if _by_force(experiments, settings) else ()), *settings.inputs]
    absent = [name for name in needed if any(name not in one.signals for one in experiments)]
    if absent:
        raise InputError(f"it takes {' and '.join(absent)} measured")
    found: list[Experiment] = []
    for one in experiments:
        try:
            found += whole_records(one, needed, LONGEST_GAP * one.step, (MIN_SAMPLES - 1) * one.step)
        except InputError:
            continue
    if not found:
        raise InputError(f"no {MIN_SAMPLES} samples on end have {', '.join(needed)}")
    return tuple(found)


def _by_force(experiments: tuple[Experiment, ...], settings: EquationSettings) -> bool:
    """Whether a_z is the response of the force equation: it is measured throughout, and the airspeed known."""
    return settings.airspeed is not None and all(
        "a_z" in one.signals and bool(np.any(np.isfinite(one.signals["a_z"]))) for one in experiments
    )


def _solved(records: tuple[Experiment, ...], settings: EquationSettings) -> tuple[_Equation, _Equation]:
    """Both equations, with their own simulated motion as instrument.

    Raises:
        InputError: the simulated motion diverges, or an equation explains too little.
    """
    motions: Motions = [None] * len(records)
    frequencies = settings.frequencies
    if frequencies is None:
        found = default_frequencies(_design("M", records, settings._replace(fixed={}), motions, instrument=False))
        frequencies = (
            found[found <= HIGHEST / records[0].step] if found[0] <= HIGHEST / records[0].step else found[:1]
        )
    for _ in range(PASSES):
        pair = [_equation(axis, records, settings, frequencies, motions) for axis in "ZM"]
        motions = _simulated(records, settings, pair) or motions
    if motions[0] is None:
        raise InputError("the motion of its equations runs away: noise in alpha and q has no instrument")
    first, second = (_equation(axis, records, settings, frequencies, motions) for axis in "ZM")
    for side, one in (("force", first), ("pitch acceleration", second)):
        if one.explained < MIN_EXPLAINED:
            raise InputError(
                f"its equation explains {one.explained:.0%} of the {side}, less than {MIN_EXPLAINED:.0%}"
            )
    return first, second


def _joint(pair: tuple[_Equation, _Equation]) -> tuple[Array, Array]:
    """Derivatives (k,) of both equations and their covariance; the noise of the two is independent."""
    values = np.concatenate([one.values for one in pair])
    covariance, split = np.zeros((len(values),) * 2), len(pair[0].values)
    covariance[:split, :split], covariance[split:, split:] = (one.covariance for one in pair)
    return values, covariance


def _system(names: tuple[str, ...], values: Array, settings: EquationSettings) -> tuple[Array, Array]:
    """Matrices A (2, 2) and B (2, k) of alpha and q."""
    known = dict(settings.fixed) | dict(zip(names, values.tolist(), strict=True))
    z_alpha, z_q, m_alpha, m_q = (known.get(name, 0.0) for name in ("Z_alpha", "Z_q", "M_alpha", "M_q"))
    b = [[known.get(f"{axis}_{name}", 0.0) for name in settings.inputs] for axis in "ZM"]
    return np.array([[z_alpha, 1.0 + z_q], [m_alpha, m_q]]), np.array(b).reshape(2, -1)


def _design(
    axis: str, records: tuple[Experiment, ...], settings: EquationSettings, motions: Motions, *, instrument: bool
) -> Design:
    """One equation with its fixed derivatives subtracted; as ``instrument`` with the simulated motion alone.

    A linear functional of the motion, a mean or a rate, is the exact one of the simulated motion plus a finite
    difference formula for the rest.
    """
    names = tuple(f"{axis}_{name}" for name in (*STATES, *settings.inputs))
    free = [place for place, name in enumerate(names) if name not in settings.fixed]
    values = np.array([settings.fixed.get(name, 0.0) for name in names])
    force, rows = axis == "Z" and _by_force(records, settings), []
    for one, motion in zip(records, motions, strict=True):
        states = np.column_stack([np.asarray(one.signals[name], dtype=np.float64) for name in STATES])
        acting = acting_inputs(_inputs(one, settings), one.step, settings.delay, _zoh_columns(settings))
        base = Motion(*(np.zeros((len(states) - n, 2)) for n in (0, 1, 0))) if motion is None else motion
        rest = np.zeros_like(states) if instrument else states - base.states
        rates = base.rates[:, 1] + np.gradient(rest[:, 1], one.step)
        if force:
            columns = np.column_stack((base.states + rest, acting.before))
            response = (np.asarray(one.signals["a_z"], dtype=np.float64) + settings.arm * rates) / (
                settings.airspeed or 1.0
            )
        else:
            means = base.means + _interval_mean(rest)
            columns = np.column_stack((means, acting.means))
            response = np.diff(states[:, 0 if axis == "Z" else 1]) / one.step
            response = response - (means[:, 1] if axis == "Z" else 0.0)
        inner = slice(1, -1)
        rest_of = response - columns @ values
        rows.append(Record(one.name, columns[inner][:, free], rest_of[inner], np.ones(len(rest_of) - 2)))
    units = tuple("" for _ in free)
    return Design(axis, "", tuple(names[place] for place in free), units, records[0].step, tuple(rows))


def _interval_mean(values: Array) -> Array:
    """Mean (N - 1, m) of ``values`` (N, m) over each sampling interval, by the cubic through four samples."""
    padded = np.vstack((2 * values[:1] - values[1:2], values, 2 * values[-1:] - values[-2:-1]))
    count = len(values) - 1
    return np.asarray(sum(weight * padded[k : k + count] for k, weight in enumerate(SMOOTH)))


def _equation(
    axis: str, records: tuple[Experiment, ...], settings: EquationSettings, frequencies: Array, motions: Motions
) -> _Equation:
    """Least squares in the band, with the simulated motion as instrument if there is one."""
    spectral = Settings(intercept="each", frequencies=frequencies)
    design = _design(axis, records, settings, motions, instrument=False)
    if not design.names:
        return _Equation((), np.zeros(0), np.zeros((0, 0)), np.inf, 1.0)
    made = equations(design, "frequency", spectral)
    pieces, count = made.blocks, len(made.names) - len(design.names)
    if motions[0] is not None:
        clean = equations(_design(axis, records, settings, motions, instrument=True), "frequency", spectral).blocks
        pieces = tuple(p._replace(instruments=c.instruments) for p, c in zip(pieces, clean, strict=True))
    fit = regress_records(pieces)
    left = np.split(fit.residuals, np.cumsum([len(piece.response) for piece in pieces])[:-1])
    power = [
        sum(float(np.sum(in_band((one - one.mean())[:, None], frequencies, design.step) ** 2)) for one in columns)
        for columns in (left, [piece.response for piece in pieces])
    ]
    explained = 1.0 - power[0] / max(power[1], 1e-300)
    degrees = float(fit.degrees)
    return _Equation(design.names, fit.values[count:], fit.covariance[count:, count:], degrees, explained)


def _simulated(
    records: tuple[Experiment, ...], settings: EquationSettings, pair: list[_Equation]
) -> list[Motion] | None:
    """Motions of the records by the fitted equations; None if they diverge."""
    names = tuple(name for one in pair for name in one.names)
    a, b = _system(names, np.concatenate([one.values for one in pair]), settings)
    longest = max(float(one.time[-1] - one.time[0]) for one in records)
    if not np.all(np.isfinite(a)) or float(np.linalg.eigvals(a).real.max()) * longest > MAX_GROWTH:
        return None
    motions = []
    for one in records:
        inputs = _inputs(one, settings)
        acting = acting_inputs(inputs - inputs[:1], one.step, settings.delay, _zoh_columns(settings))
        states = np.column_stack([np.asarray(one.signals[name], dtype=np.float64) for name in STATES])
        start = np.zeros(2) if settings.inputs else states[0] - states[-len(states) // 5 :].mean(axis=0)
        motions.append(simulate(a, b, start, acting, one.step))
    return motions


def _inputs(one: Experiment, settings: EquationSettings) -> Array:
    """Inputs (N, k) as recorded."""
    return np.array([one.signals[name] for name in settings.inputs], dtype=np.float64).reshape(-1, len(one.time)).T


def _zoh_columns(settings: EquationSettings) -> list[int]:
    return [place for place, name in enumerate(settings.inputs) if name in settings.zoh_inputs]


# --- motion between samples, exactly ------------------------------------------------------------------------
# A delayed input changes, or bends, once within each step; before and after it is a constant or a line, so that the
# motion and its integral are matrix exponentials (Van Loan, IEEE Trans. Automatic Control 23, 1978).


def acting_inputs(inputs: Array, step: float, delay: float, zoh_columns: list[int]) -> Acting:
    """The ``inputs`` (N, k), every ``step`` s, as they act ``delay`` s later.

    ``zoh_columns`` have a zero-order hold. Before the first sample and after the last they are constant.
    """
    whole = int(np.floor(delay / step + SAME))
    fraction = max(delay / step - whole, 0.0)
    linear = np.ones(inputs.shape[1])
    linear[zoh_columns] = 0.0
    index = np.arange(len(inputs)) - whole
    old, now, coming = (inputs[np.clip(index + k, 0, len(inputs) - 1)] for k in (-1, 0, 1))
    start = old + (now - old) * (1.0 - fraction) * linear
    end = now + (coming - now) * (1.0 - fraction) * linear
    changing = old + (now - old) * linear
    return Acting(fraction, (start[:-1], changing[:-1]), (now[:-1], end[:-1]), start)


def simulate(a: Array, b: Array, start: Array, acting: Acting, step: float) -> Motion:
    """Motion from ``start`` (n,) of ``x' = a x + b u``, ``a`` (n, n) and ``b`` (n, k), with ``acting`` inputs."""
    n = len(a)
    blocks = [_exponential(a, b, part * step) for part in (acting.fraction, 1.0 - acting.fraction)]
    forced = [
        np.hstack((first, last - first)) @ block[: 2 * n, 2 * n :].T
        for block, (first, last) in zip(blocks, (acting.early, acting.later), strict=True)
    ]
    early, later = (block[:n, :n] for block in blocks)
    states = np.vstack((start, forced[0][:, :n] @ later.T + forced[1][:, :n]))
    _accumulate(np.ascontiguousarray(later @ early), states)
    middle = states[:-1] @ early.T + forced[0][:, :n]
    integrals = states[:-1] @ blocks[0][n : 2 * n, :n].T + middle @ blocks[1][n : 2 * n, :n].T
    means = (integrals + forced[0][:, n:] + forced[1][:, n:]) / step
    return Motion(states, means, states @ a.T + acting.before @ b.T)


def _exponential(a: Array, b: Array, length: float) -> Array:
    """Transition (2 n + 2 k, 2 n + 2 k) of states, their integrals, inputs and their increments over ``length`` s."""
    n, k = b.shape
    block = np.zeros((2 * n + 2 * k, 2 * n + 2 * k))
    block[:n, :n], block[:n, 2 * n : 2 * n + k] = a * length, b * length
    block[n : 2 * n, :n] = np.eye(n) * length
    block[2 * n : 2 * n + k, 2 * n + k :] = np.eye(k)
    return np.asarray(expm(block))


@njit(cache=True)
def _accumulate(transition: Array, states: Array) -> None:
    """Accumulate the ``states`` (N, n), which contain the increments of each step, by the ``transition`` (n, n)."""
    count, n = states.shape
    for row in range(1, count):
        for i in range(n):
            for j in range(n):
                states[row, i] += transition[i, j] * states[row - 1, j]
