"""Flight-path reconstruction: are the measured rates, forces, flow angles, attitude and altitude those of one motion?

Klein & Morelli, Aircraft System Identification, 2006, chapter 10; Jategaonkar, Flight Vehicle System Identification,
2006, chapter 10. Measured rates and specific forces drive the kinematics, whose outputs are fitted to the measured
ones by output error: Gauss-Newton on the sensors' biases and scales and the first states of every record.

The errors answer for two things. Residuals are coloured: their autocovariance, tapered (`regression.colour`), weighs
the sensitivities. And the noise of the inputs is integrated into a wander as slow as the record is long, which no
autocovariance of that record shows whole: by the adjoint of the kinematics it is carried to the parameters exactly.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from logs.identification.experiment import Experiment
from logs.identification.kinematics.flight_errors import covariance_of, degrees_of
from logs.identification.kinematics.flight_records import (
    Path,
    Problem,
    Slopes,
    Values,
    first_guess,
    free_states,
    path_of,
    records_of,
    slopes_of,
)
from logs.identification.kinematics.flight_sensors import (
    LONGITUDINAL_INPUTS,
    UNITS,
    Parameter,
    Places,
    parameter,
    usual_parameters,
    velocity_at,
)
from logs.identification.kinematics.rigid_motion import INPUTS, STATE_UNITS, STATES
from logs.identification.preparing.lever_arm import air_data_of
from logs.identification.results import Array, Estimate, Unidentified, estimate

ITERATIONS = 50
CONVERGED = 0.02
"""-; largest step, in standard errors"""
DEPENDENT = 1e-9
"""-; smallest eigenvalue of the information, scaled to a diagonal of 1, at which its unknowns are told apart"""
SHARED = 0.05
"""-; of the largest entry, above which an unknown belongs to a combination that is not told apart"""
WHITE_LAGS = 40
WHITE_SHARE = 0.1
"""-; of the lags, that may lie outside the 95 % band of white residuals"""


class Setup(NamedTuple):
    """What is asked for."""

    longitudinal: bool = False
    """-; u, w, theta and altitude alone, from q, a_x and a_z: flight with level wings"""
    also: tuple[str, ...] = ()
    """-; errors beyond the usual ones: scale_q, bias_theta, scale_airspeed, ..."""
    known: tuple[str, ...] = ()
    """-; usual errors that are taken to be zero"""
    places: Places = Places()
    input_noise: Mapping[str, float] | None = None
    """standard deviation of the white noise by input; where None, `noise_level` tells"""


USUAL = Setup()


class Whiteness(NamedTuple):
    """What the residuals of one output have left."""

    name: str
    unit: str
    deviation: float
    """as the unit; standard deviation"""
    outside: float
    """-; share of the autocorrelation's first lags outside the 95 % band of white noise"""
    white: bool


class Track(NamedTuple):
    """One record reconstructed."""

    motion: Experiment
    """u, v, w, airspeed, alpha, beta at the centre of mass, the other states, and the inputs freed of their errors
    (specific forces at the IMU's place)"""
    residuals: Mapping[str, Array]
    """by output, in its unit; (N,), NaN where it was not measured"""
    whiteness: tuple[Whiteness, ...]


class Reconstruction(NamedTuple):
    """The sensors' errors and the motion that all sensors agree on."""

    parameters: tuple[Estimate, ...]
    unidentified: tuple[Unidentified, ...]
    """asked for and held at zero"""
    correlation: Array
    """-; (p, p), of `parameters`"""
    tracks: tuple[Track, ...]
    """empty where it failed"""
    failure: str
    """-; why nothing is told, empty where it is"""


class _Fit(NamedTuple):
    """The optimum."""

    values: Values
    deviation: Array
    """(m,); of the outputs' residuals"""
    paths: list[Path]
    slopes: list[Slopes]
    information: Array
    """(p + R n, p + R n)"""


class _Dependent(NamedTuple):
    """Unknowns that the records do not tell apart."""

    dropped: str
    """the parameter to do without, empty where there is none among them"""
    others: tuple[str, ...]


def reconstruct(experiments: Sequence[Experiment], setup: Setup = USUAL) -> Reconstruction:
    """Errors of the sensors and the flight path from ``experiments`` flown with the same sensors.

    Signals: p, q, r (rad/s), a_x, a_y, a_z (m/s^2, specific force) without gaps, ``airspeed`` (m/s), and what there
    is of alpha, beta (rad; atan2(w, u), asin(v / V)), phi, theta, psi (rad), altitude, north, east (m), climb_rate
    (m/s), with NaN where not measured. The air moves steadily and level.

    Raises:
        BadInput: an input or the airspeed is missing or has gaps, or a record is short or uneven.
    """
    records, channels = records_of(experiments, setup.longitudinal)
    asked, refused = _asked(channels, setup)
    problem = Problem(records, channels, asked, free_states(channels, setup.longitudinal), setup.places)
    while True:
        problem, dependent, failure = _independent(problem)
        refused += dependent
        if failure:
            return _failed(refused, failure)
        fit = _fitted(problem)
        if fit is None:
            return _failed(refused, "the reconstruction did not converge")
        covariance = covariance_of(problem, fit.values, fit.deviation, fit.paths, fit.slopes, setup.input_noise)
        vague = _vague(problem, covariance)
        if not vague and "alpha" not in channels and any(np.min(path.states[:, 0]) <= 0 for path in fit.paths):
            return _failed(
                refused, "the motion found flies backwards: without alpha these records tell no flight path"
            )
        if not vague:
            return _told(problem, fit, covariance, refused)
        refused.append(vague)
        problem = problem._replace(parameters=tuple(p for p in problem.parameters if p.name != vague.name))


def _asked(channels: tuple[str, ...], setup: Setup) -> tuple[tuple[Parameter, ...], list[Unidentified]]:
    """The parameters to be found, the most needed first, and those that the channels rule out."""
    known, refused = [], []
    inputs = LONGITUDINAL_INPUTS if setup.longitudinal else INPUTS
    names = dict.fromkeys((*usual_parameters(setup.longitudinal), *setup.also))
    for name in names:
        asked = parameter(name)
        if asked is None:
            refused.append(Unidentified(name, "no such error is modelled"))
        elif name in setup.known:
            refused.append(Unidentified(name, "taken to be zero, as asked"))
        elif asked.kind == "wind" and not {"north", "east"} <= set(channels):
            refused.append(Unidentified(name, "north and east were not measured"))
        elif asked.channel not in (*inputs, *channels):
            refused.append(Unidentified(name, f"{asked.channel} was not measured"))
        else:
            known.append(asked)
    return tuple(known), refused


def _failed(refused: list[Unidentified], failure: str) -> Reconstruction:
    return Reconstruction((), tuple(refused), np.zeros((0, 0)), (), failure)


# --- the fit --------------------------------------------------------------------------------------------


def _paths(problem: Problem, values: Values) -> list[Path]:
    return [path_of(problem, values, index) for index in range(len(problem.records))]


def _linearised(problem: Problem, values: Values, paths: list[Path]) -> list[Slopes]:
    return [slopes_of(problem, values, index, path) for index, path in enumerate(paths)]


def _spread(problem: Problem, paths: list[Path]) -> Array:
    """Root mean square residual of every output; next to nothing is not taken for nothing."""
    squares = sum(np.sum(path.residuals**2, axis=0) for path in paths)
    spread: Array = np.sqrt(squares / np.sum([np.sum(r.used, axis=0) for r in problem.records], axis=0))
    return np.maximum(spread, 1e-9)


def _squares(paths: list[Path], deviation: Array) -> float:
    total = float(sum(np.sum((path.residuals / deviation) ** 2) for path in paths))
    return total if np.isfinite(total) else np.inf


def _columns(problem: Problem, index: int) -> NDArray[np.int64]:
    """Where the unknowns of record ``index`` stand among all."""
    count, free = len(problem.parameters), len(problem.free)
    return np.concatenate((np.arange(count), count + index * free + np.arange(free)))


def _normal(problem: Problem, deviation: Array, paths: list[Path], slopes: list[Slopes]) -> tuple[Array, Array]:
    """Information (P, P) and gradient (P,) of all unknowns."""
    size = len(problem.parameters) + len(problem.records) * len(problem.free)
    information, gradient = np.zeros((size, size)), np.zeros(size)
    for index, (path, slope) in enumerate(zip(paths, slopes, strict=True)):
        at = _columns(problem, index)
        flat = (slope.outputs / deviation[:, None]).reshape(-1, len(at))
        information[np.ix_(at, at)] += flat.T @ flat
        gradient[at] += flat.T @ (path.residuals / deviation).ravel()
    return information, gradient


def _advanced(problem: Problem, values: Values, step: Array) -> Values:
    count = len(problem.parameters)
    starts = values.starts.copy()
    starts[:, problem.free] += step[count:].reshape(len(problem.records), -1)
    return Values(values.errors + step[:count], starts)


def _fitted(problem: Problem) -> _Fit | None:
    """Gauss-Newton, the outputs' variances estimated anew after every step; None where it does not converge."""
    values = first_guess(problem)
    paths = _paths(problem, values)
    if not np.isfinite(_squares(paths, np.ones(len(problem.channels)))):
        return None
    deviation = _spread(problem, paths)
    for _ in range(ITERATIONS):
        slopes = _linearised(problem, values, paths)
        information, gradient = _normal(problem, deviation, paths, slopes)
        scale = np.sqrt(np.diag(information))
        step = np.linalg.solve(information / np.outer(scale, scale), gradient / scale) / scale
        errors = np.sqrt(np.diag(np.linalg.inv(information / np.outer(scale, scale)))) / scale
        if np.max(np.abs(step) / errors) < CONVERGED:
            return _Fit(values, deviation, paths, slopes, information)
        before, taken = _squares(paths, deviation), None
        for halving in range(10):
            trial = _advanced(problem, values, step * 0.5**halving)
            paths = _paths(problem, trial)
            if _squares(paths, deviation) <= before * (1 + 1e-9):
                taken = trial
                break
        if taken is None:
            return None
        values, deviation = taken, _spread(problem, paths)
    return None


# --- what cannot be told --------------------------------------------------------------------------------


def _independent(problem: Problem) -> tuple[Problem, list[Unidentified], str]:
    """The problem without parameters that the records do not tell from others, those, and why nothing is left."""
    refused: list[Unidentified] = []
    while True:
        values = first_guess(problem)
        paths = _paths(problem, values)
        if not all(np.all(np.isfinite(path.states)) for path in paths):
            return problem, refused, "the kinematics run away from the first guess: are the units SI, the axes FRD?"
        information, _ = _normal(problem, _spread(problem, paths), paths, _linearised(problem, values, paths))
        found = _dependent(problem, information)
        if found is None:
            return problem, refused, ""
        if not found.dropped:
            return problem, refused, f"the outputs do not tell the first {' and '.join(found.others)}"
        reason = "has no effect on the outputs measured"
        if found.others:
            reason = f"not to be told from {', '.join(found.others)} in these records"
        refused.append(Unidentified(found.dropped, reason))
        problem = problem._replace(parameters=tuple(p for p in problem.parameters if p.name != found.dropped))


def _dependent(problem: Problem, information: Array) -> _Dependent | None:
    """The unknowns of the weakest combination, where it is too weak; the last asked of its parameters is dropped."""
    names = [p.name for p in problem.parameters]
    names += [f"{STATES[state]} at the start" for _ in problem.records for state in problem.free]
    scale = np.sqrt(np.diag(information))
    dead = scale <= 1e-9 * np.max(scale)
    if np.any(dead):
        index = int(np.flatnonzero(dead)[0])
        return _Dependent(names[index], ()) if index < len(problem.parameters) else _Dependent("", (names[index],))
    values, vectors = np.linalg.eigh(information / np.outer(scale, scale))
    if values[0] > DEPENDENT:
        return None
    weights = np.abs(vectors[:, 0])
    together = [int(i) for i in np.flatnonzero(weights > SHARED * np.max(weights))]
    among = [i for i in together if i < len(problem.parameters)]
    dropped = names[among[-1]] if among else ""
    return _Dependent(dropped, tuple(dict.fromkeys(names[i] for i in together if names[i] != dropped)))


def _vague(problem: Problem, covariance: Array) -> Unidentified | None:
    """The parameter whose standard error exceeds its limit by most; None where all are within."""
    errors = np.sqrt(np.diag(covariance))
    excess = [float(error / p.limit) for p, error in zip(problem.parameters, errors, strict=False)]
    if not excess or max(excess) <= 1:
        return None
    index = int(np.argmax(excess))
    worst = problem.parameters[index]
    told = f"these records tell it no better than to {errors[index]:.2g} {worst.unit} (standard error)"
    return Unidentified(worst.name, told.replace(" - ", " "))


# --- what is told ---------------------------------------------------------------------------------------


def _told(problem: Problem, fit: _Fit, covariance: Array, refused: list[Unidentified]) -> Reconstruction:
    degrees = degrees_of(problem, fit.paths)
    count = len(problem.parameters)
    errors = np.sqrt(np.diag(covariance))[:count]
    rows = zip(problem.parameters, fit.values.errors, errors, strict=True)
    parameters = tuple(estimate(p.name, p.unit, float(value), float(error), degrees) for p, value, error in rows)
    correlation = covariance[:count, :count] / np.outer(errors, errors)
    tracks = tuple(_track(problem, fit, index) for index in range(len(problem.records)))
    return Reconstruction(parameters, tuple(refused), correlation, tracks, "")


def _track(problem: Problem, fit: _Fit, index: int) -> Track:
    record, path = problem.records[index], fit.paths[index]
    velocity = velocity_at(path.states, path.inputs, (0.0, 0.0, 0.0), problem.places.imu)
    signals = dict(zip(STATES, path.states.T, strict=True))
    signals |= dict(zip(("u", "v", "w"), velocity.T, strict=True))
    signals |= air_data_of(velocity)._asdict()
    signals |= dict(zip(INPUTS, path.inputs.T, strict=True))
    units = dict(zip(STATES, STATE_UNITS, strict=True)) | {name: UNITS[name] for name in signals if name in UNITS}
    columns = zip(problem.channels, path.residuals.T, record.used.T, strict=True)
    residuals = {name: np.where(used > 0, values, np.nan) for name, values, used in columns}
    whiteness = tuple(_whiteness(name, values) for name, values in residuals.items() if np.any(np.isfinite(values)))
    return Track(Experiment(record.name, record.time, signals, units), residuals, whiteness)


def _whiteness(name: str, residuals: Array) -> Whiteness:
    """Autocorrelation over the samples that were measured."""
    known = residuals[np.isfinite(residuals)]
    centred = known - np.mean(known)
    power = float(centred @ centred)
    lags = range(1, min(WHITE_LAGS, len(known) // 4) + 1)
    bound = 1.96 / np.sqrt(len(known))
    outside = [abs(centred[lag:] @ centred[:-lag]) > bound * power for lag in lags]
    share = float(np.mean(outside)) if outside else 0.0
    return Whiteness(name, UNITS[name], float(np.std(known)), share, share <= WHITE_SHARE)
