"""Equation error in the frequency domain on plain records: the short period's two equations, each a regression.

Grauer Eq. 20 and 21; Klein & Morelli, Aircraft System Identification, 2006, ch. 7. Derivatives are central
differences, so that an equation is its integral over two samples; what they are regressed on goes through the mean
that a central difference is of a rate. Of inputs that is exact, of held ones and of lines, whole samples late or
parts of one. Of motions it is Simpson's (1/6, 2/3, 1/6), and what the exact mean of the fitted equations' own motion
(`between_samples`) is beyond Simpson's of it: an input that is held bends the motion where it changes, and no
parabola follows that. The force that a_z tells is one of an instant: beside it stand the inputs of that instant,
which a held one keeps until it changes. Noise in the regressors would shrink their coefficients: the fitted
equations, flown with the measured inputs, are the instruments of the next pass (Young, Recursive Estimation and
Time-Series Analysis, 1984, ch. 8), which need no other method's model.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import NamedTuple

import numpy as np

from logs.identification.data.experiment import Experiment
from logs.identification.data.fourier import in_band
from logs.identification.data.resampling import whole_records
from logs.identification.estimators.equation_error import Settings, default_frequencies, equations
from logs.identification.estimators.least_squares import CovarianceKind, Fit, Piece, linear_of, regress_records
from logs.identification.estimators.regressors import Design, Record, common_step
from logs.identification.models.intersample import Acting, ExactMotion, acting_of, fly
from logs.identification.models.modes import Mode, mode_of_system, nothing
from logs.identification.results import Array
from logs.identification.statistics.parameter_uncertainty import Spread
from wingbeat.errors import InputError

METHOD = "equation error"
STATES = ("alpha", "q")
LONGEST_GAP = 5
"""-; samples that are bridged"""
LEAST_SAMPLES = 32
PASSES = 3
"""-; with the fitted equations' own motion as instruments"""
HIGHEST = 0.125
"""-; of the sampling rate: above it central differences are noise"""
RUNS_AWAY = 3.0
"""-; powers of e by which a motion may grow over a record and still be an instrument"""
LITTLE = 0.5
"""-; of the response in the band, under which an equation explains nothing"""


class Asked(NamedTuple):
    """What is to be fitted."""

    inputs: tuple[str, ...]
    """-; names of signals; none for a free motion"""
    held: Mapping[str, float] = {}
    """SI; derivatives that are not free, by name: Z_q, M_delta_e, ..."""
    airspeed: float | None = None
    """m/s; with it a measured a_z tells the forces, else the slope of alpha does"""
    arm: float = 0.0
    """m; of the accelerometers forward of the centre of mass"""
    delay: float = 0.0
    """s; by which the inputs act later than they are told"""
    delay_error: float = 0.0
    """s; standard error of that delay"""
    frequencies: Array | None = None
    """Hz; (F,), by the regressors when None"""
    hold: tuple[str, ...] = ()
    """-; inputs that are held from each sample to the next; what stands beside them was read before they changed"""


class _Equation(NamedTuple):
    """One equation, solved."""

    names: tuple[str, ...]
    """-; (k,), free derivatives"""
    values: Array
    covariance: Array
    degrees: float
    rows: Array
    """(k, N); the derivatives as sums over the samples"""
    residuals: Array
    """(N,); in the band"""
    explained: float
    """-; of the response in the band"""


def frequency_equation_error(experiments: tuple[Experiment, ...], asked: Asked) -> Mode:
    """The short period of ``experiments`` in which alpha and q (and a_z) were measured."""
    try:
        records = _records(experiments, asked)
        step = common_step(records)
    except InputError as error:
        return nothing(METHOD, str(error))
    if step <= 0 or sum(len(one.time) for one in records) < LEAST_SAMPLES:
        return nothing(METHOD, f"it takes {LEAST_SAMPLES} samples of alpha, q and the inputs on end")
    try:
        return _solved(records, asked)
    except (np.linalg.LinAlgError, InputError) as error:
        why = str(error) if isinstance(error, InputError) else "the records do not excite alpha, q and inputs apart"
        return nothing(METHOD, why)


def _records(experiments: tuple[Experiment, ...], asked: Asked) -> tuple[Experiment, ...]:
    """Whole stretches of what the equations need.

    Raises:
        InputError: alpha or q was not measured, or no stretch is long enough.
    """
    needed = [*STATES, *(("a_z",) if _by_force(experiments, asked) else ()), *asked.inputs]
    absent = [name for name in needed if any(name not in one.signals for one in experiments)]
    if absent:
        raise InputError(f"it takes {' and '.join(absent)} measured")
    found: list[Experiment] = []
    for one in experiments:
        try:
            found += whole_records(one, needed, LONGEST_GAP * one.step, (LEAST_SAMPLES - 1) * one.step)
        except InputError:
            continue
    if not found:
        raise InputError(f"no {LEAST_SAMPLES} samples on end have {', '.join(needed)}")
    return tuple(found)


def _by_force(experiments: tuple[Experiment, ...], asked: Asked) -> bool:
    """Whether a_z tells the force: it is measured throughout, and the airspeed known."""
    return asked.airspeed is not None and all(
        "a_z" in one.signals and bool(np.any(np.isfinite(one.signals["a_z"]))) for one in experiments
    )


def _solved(records: tuple[Experiment, ...], asked: Asked) -> Mode:
    found = _both(records, asked)
    if isinstance(found, str):
        return nothing(METHOD, found)
    names, values, covariance = tuple(n for one in found for n in one.names), _values(found), _joint(found)
    if asked.delay_error > 0:
        later = _both(records, asked._replace(delay=asked.delay + asked.delay_error))
        if isinstance(later, str):
            return nothing(METHOD, f"the delay is not sure enough: {asked.delay_error:.2g} s later {later}")
        moved = _values(later) - values
        covariance = covariance + np.outer(moved, moved)
    spread = Spread(covariance, min(one.degrees for one in found))
    told = spread.estimates({name: _unit(name) for name in names}, values)
    return mode_of_system(METHOD, lambda v: _system(names, v, asked), values, spread, told)


def _both(records: tuple[Experiment, ...], asked: Asked) -> tuple[_Equation, _Equation] | str:
    """Both equations with their own motion as instruments, or why they give nothing."""
    force, frequencies = _by_force(records, asked), _frequencies(records, asked)
    flown: list[ExactMotion] | None = None
    for _ in range(PASSES):
        tried = tuple(_equation(axis, records, asked, frequencies, flown, "white") for axis in "ZM")
        flown = _flown(records, asked, tried) or flown
    if flown is None:
        return "the motion of its equations runs away: nothing takes the noise of alpha and q out of them"
    first, second = (_equation(axis, records, asked, frequencies, flown, "autocorrelated") for axis in "ZM")
    sides = ("force" if force else "slope of alpha", "pitch acceleration")
    for side, one in zip(sides, (first, second), strict=True):
        if one.explained < LITTLE:
            return f"its equation explains less than half of the {side} in the band"
    return first, second


def _values(pair: tuple[_Equation, _Equation]) -> Array:
    """Derivatives (k,) of both equations."""
    return np.concatenate([one.values for one in pair])


def _unit(name: str) -> str:
    return "1/s" if name.startswith("Z") or name == "M_q" else "1/s^2"


def _system(names: tuple[str, ...], values: Array, asked: Asked) -> Array:
    """Matrix A (2, 2) of alpha and q."""
    told = dict(asked.held) | dict(zip(names, values.tolist(), strict=True))
    z_alpha, z_q, m_alpha, m_q = (told.get(name, 0.0) for name in ("Z_alpha", "Z_q", "M_alpha", "M_q"))
    return np.array([[z_alpha, 1.0 + z_q], [m_alpha, m_q]])


# --- the equations --------------------------------------------------------------------------------------


def _smooth_mean(values: Array) -> Array:
    """(N - 2, ...); what a central difference makes of a rate, of its values where they go in parabolas (Simpson)."""
    return np.asarray((values[:-2] + 4 * values[1:-1] + values[2:]) / 6)


def _slope(values: Array, step: float) -> Array:
    return np.asarray((values[2:] - values[:-2]) / (2 * step))


class _Moved(NamedTuple):
    """A motion and its inputs as both equations take them."""

    states: Array
    """(N, 2); alpha and q at the samples"""
    acting: Acting
    bends: Array
    """(N - 2, 2); what the mean of a motion is more than Simpson's"""
    jumps: Array
    """(N - 2,); what Simpson's mean of the pitch acceleration at the samples is more than the slope of q"""

    def mean(self) -> Array:
        """(N - 2, 2); of the motion, as a central difference has it."""
        mean: Array = _smooth_mean(self.states) + self.bends
        return mean


def _measured(one: Experiment, asked: Asked, flown: ExactMotion | None) -> _Moved:
    states = np.column_stack([np.asarray(one.signals[name], dtype=np.float64) for name in STATES])
    acting = acting_of(_inputs(one, asked), one.step, asked.delay, _held_places(asked))
    if flown is None:
        return _Moved(states, acting, np.zeros((len(states) - 2, 2)), np.zeros(len(states) - 2))
    return _Moved(states, acting, *_beyond(flown, one.step))


def _beyond(flown: ExactMotion, step: float) -> tuple[Array, Array]:
    """Bends and jumps of `_Moved`, of the flown motion."""
    over_two = (flown.means[:-1] + flown.means[1:]) / 2
    bends: Array = over_two - _smooth_mean(flown.states)
    jumps: Array = _smooth_mean(flown.rates[:, 1]) - _slope(flown.states[:, 1], step)
    return bends, jumps


def _inputs(one: Experiment, asked: Asked) -> Array:
    """(N, k); as told."""
    return np.array([one.signals[name] for name in asked.inputs], dtype=np.float64).reshape(-1, len(one.time)).T


def _held_places(asked: Asked) -> list[int]:
    return [place for place, name in enumerate(asked.inputs) if name in asked.hold]


def _averaged(axis: str, moved: _Moved, force: bool) -> Array:
    """(N - 2, 2 + inputs); regressors as they stand beside the response of an axis."""
    if axis == "Z" and force:  # the force of an instant: one and the same mean of both sides
        return _smooth_mean(np.column_stack((moved.states, moved.acting.before)))
    over = moved.acting.means
    return np.column_stack((moved.mean(), (over[:-1] + over[1:]) / 2))


def _response(axis: str, one: Experiment, asked: Asked, moved: _Moved) -> Array:
    """Pitch acceleration, or what turns the path: a_z / V, else the slope of alpha less q."""
    alpha, q = moved.states.T
    if axis == "M":
        return _slope(q, one.step)
    if _by_force((one,), asked) and asked.airspeed is not None:
        turning = _slope(q, one.step) + moved.jumps
        felt = _smooth_mean(np.asarray(one.signals["a_z"], dtype=np.float64)) + asked.arm * turning
        return np.asarray(felt / asked.airspeed)
    return _slope(alpha, one.step) - moved.mean()[:, 1]


def _design(
    axis: str, records: tuple[Experiment, ...], asked: Asked, flown: list[ExactMotion] | None, clean: bool = False
) -> Design:
    """One equation, its held derivatives taken off the response; ``clean`` with the ``flown`` motion's regressors."""
    names = tuple(f"{axis}_{name}" for name in (*STATES, *asked.inputs))
    free = [place for place, name in enumerate(names) if name not in asked.held]
    held = np.array([asked.held.get(name, 0.0) for name in names])
    rows, force = [], _by_force(records, asked)
    flights: list[ExactMotion] | list[None] = flown or [None] * len(records)
    for one, flight in zip(records, flights, strict=True):
        moved = _measured(one, asked, flight)
        whole = _averaged(axis, moved, force)
        response = _response(axis, one, asked, moved) - whole @ held
        if clean and flight is not None:
            whole = _averaged(axis, moved._replace(states=flight.states), force)
        rows.append(Record(one.name, whole[:, free], response, np.ones(len(whole))))
    units = tuple("" for _ in free)
    return Design(axis, "", tuple(names[place] for place in free), units, records[0].step, tuple(rows))


def _frequencies(records: tuple[Experiment, ...], asked: Asked) -> Array:
    """Of all equations; where nobody says, up to where the regressors have had their variance."""
    if asked.frequencies is not None:
        return asked.frequencies
    whole = asked._replace(held={})
    found = default_frequencies(_design("M", records, whole, None))
    kept = found[found <= HIGHEST / records[0].step]
    return kept if len(kept) else found[:1]


def _equation(
    axis: str,
    records: tuple[Experiment, ...],
    asked: Asked,
    frequencies: Array,
    flown: list[ExactMotion] | None,
    kind: CovarianceKind,
) -> _Equation:
    """Least squares in the band, or with the ``flown`` motions for instruments."""
    settings = Settings(intercept="each", frequencies=frequencies)
    design = _design(axis, records, asked, flown)
    if not design.names:
        return _Equation((), np.zeros(0), np.zeros((0, 0)), np.inf, np.zeros((0, 0)), np.zeros(0), 1.0)
    made = equations(design, "frequency", settings)
    pieces, count = made.pieces, len(made.names) - len(design.names)
    if flown is not None:
        clean = equations(_design(axis, records, asked, flown, clean=True), "frequency", settings).pieces
        pairs = zip(pieces, clean, strict=True)
        pieces = tuple(Piece(p.regressors, c.instruments, p.response, p.used) for p, c in pairs)
    scaled, scale = _scaled(pieces)
    fit = regress_records(scaled, kind)
    rows = np.hstack([one[0].T for one in linear_of(scaled)[1]])[count:] / scale[count:, None]
    residuals = _banded(pieces, fit, scale, frequencies, design.step)
    response = _in_band([piece.response for piece in pieces], frequencies, design.step)
    values, covariance = fit.values / scale, fit.covariance / np.outer(scale, scale)
    explained = 1.0 - float(residuals @ residuals) / max(float(response @ response), 1e-300)
    degrees = float(fit.degrees_each[count:].min())
    return _Equation(design.names, values[count:], covariance[count:, count:], degrees, rows, residuals, explained)


def _scaled(pieces: tuple[Piece, ...]) -> tuple[tuple[Piece, ...], Array]:
    """The pieces with columns of unit size, and the sizes."""
    size = np.linalg.norm(np.vstack([piece.regressors for piece in pieces]), axis=0)
    scale = np.where(size > 0, size, 1.0)
    own = np.linalg.norm(np.vstack([piece.instruments for piece in pieces]), axis=0)
    share = np.where(own > 0, own, 1.0)
    return tuple(Piece(p.regressors / scale, p.instruments / share, p.response, p.used) for p in pieces), scale


def _banded(pieces: tuple[Piece, ...], fit: Fit, scale: Array, frequencies: Array, step: float) -> Array:
    """Residuals (N,) of all pieces in the band."""
    left = [piece.response - piece.regressors @ (fit.values / scale) for piece in pieces]
    return _in_band(left, frequencies, step)


def _in_band(columns: list[Array], frequencies: Array, step: float) -> Array:
    return np.concatenate([in_band((one - one.mean())[:, None], frequencies, step)[:, 0] for one in columns])


def _joint(pair: tuple[_Equation, ...]) -> Array:
    """Covariance of both equations: what noise they share by the correlation of their residuals."""
    first, second = pair
    size, split = len(first.values) + len(second.values), len(first.values)
    covariance = np.zeros((size, size))
    covariance[:split, :split], covariance[split:, split:] = first.covariance, second.covariance
    if not split or split == size:
        return covariance
    lengths = np.linalg.norm(first.residuals) * np.linalg.norm(second.residuals)
    shared = float(first.residuals @ second.residuals) / max(float(lengths), 1e-300)
    alike = [one.rows / np.maximum(np.linalg.norm(one.rows, axis=1, keepdims=True), 1e-300) for one in pair]
    errors = [np.sqrt(np.maximum(np.diag(one.covariance), 0.0)) for one in pair]
    cross = shared * (alike[0] @ alike[1].T) * np.outer(*errors)
    covariance[:split, split:], covariance[split:, :split] = cross, cross.T
    return covariance


def _flown(records: tuple[Experiment, ...], asked: Asked, pair: tuple[_Equation, ...]) -> list[ExactMotion] | None:
    """The records' motions by the fitted equations; None where they run away."""
    names = tuple(name for one in pair for name in one.names)
    values = np.concatenate([one.values for one in pair])
    told = dict(asked.held) | dict(zip(names, values.tolist(), strict=True))
    a = _system(names, values, asked)
    b = np.array([[told.get(f"{axis}_{name}", 0.0) for name in asked.inputs] for axis in "ZM"]).reshape(2, -1)
    longest = max(float(one.time[-1] - one.time[0]) for one in records)
    if not np.all(np.isfinite(a)) or float(np.linalg.eigvals(a).real.max()) * longest > RUNS_AWAY:
        return None
    return [fly(a, b, _start(one, asked), _from_first(one, asked), one.step) for one in records]


def _start(one: Experiment, asked: Asked) -> Array:
    """(2,); at rest where inputs move it, else from the first sample, about where it ends."""
    if asked.inputs:
        return np.zeros(2)
    states = np.column_stack([np.asarray(one.signals[name], dtype=np.float64) for name in STATES])
    return np.asarray(states[0] - states[-len(states) // 5 :].mean(axis=0))


def _from_first(one: Experiment, asked: Asked) -> Acting:
    """Inputs from their first values."""
    given = _inputs(one, asked)
    return acting_of(given - given[:1], one.step, asked.delay, _held_places(asked))
