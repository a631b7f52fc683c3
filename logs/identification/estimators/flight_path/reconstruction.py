"""Flight-path reconstruction: are the measured rates, forces, flow angles, attitude and altitude those of one motion?

Klein & Morelli, Aircraft System Identification, 2006, chapter 10; Jategaonkar, Flight Vehicle System Identification,
2006, chapter 10. Measured rates and specific forces drive the kinematics, whose outputs are fitted to the measured
ones by output error: Gauss-Newton on the sensors' biases and scales and the first states of every record.

Two error sources are covered. Residuals are colored: their tapered autocovariance
(`statistics.residual_autocorrelation`) weighs the sensitivities. Input noise is integrated into a random walk as slow
as the record is long, which no autocovariance of that record shows: the adjoint of the kinematics carries it to the
parameters exactly.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import NamedTuple

import numpy as np

from logs.identification.data.experiment import Experiment
from logs.identification.data.lever_arm import air_data_of
from logs.identification.estimators.flight_path.diagnostics import contradiction, unread_among
from logs.identification.estimators.flight_path.errors import covariance_of, degrees_of, with_held
from logs.identification.estimators.flight_path.fit import Fit, fitted, independent, vague_among
from logs.identification.estimators.flight_path.records import Problem, free_states, records_of
from logs.identification.estimators.flight_path.sensors import (
    LONGITUDINAL_INPUTS,
    UNITS,
    Parameter,
    Places,
    parameter,
    usual_parameters,
    velocity_at,
)
from logs.identification.models.rigid_body import INPUTS, STATE_UNITS, STATES
from logs.identification.results import Array, Estimate, Unidentified, estimate
from logs.identification.statistics.whiteness import whiteness_of

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
    """as the input, by its name; standard deviation of the white noise; where None, `noise_level` tells"""
    gusts: bool = False
    """-; the air may move: an airspeed that a constant follows better, as one that is held, contradicts nothing"""


USUAL = Setup()


class Remainder(NamedTuple):
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
    """as the output, by its name; (N,), NaN where it was not measured"""
    whiteness: tuple[Remainder, ...]


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
    """-; why nothing is told, empty where it is: no optimum, or signals that are not those of one motion"""


def reconstruct(experiments: Sequence[Experiment], setup: Setup = USUAL) -> Reconstruction:
    """Errors of the sensors and the flight path from ``experiments`` flown with the same sensors.

    Signals: p, q, r (rad/s), a_x, a_y, a_z (m/s^2, specific force) without gaps, ``airspeed`` (m/s), and what there
    is of alpha, beta (rad; atan2(w, u), asin(v / V)), phi, theta, psi (rad), altitude, north, east (m), climb_rate
    (m/s), with NaN where not measured. The air moves steadily and level.

    Raises:
        InputError: an input or the airspeed is missing or has gaps, or a record is short or uneven.
    """
    records, channels = records_of(experiments, setup.longitudinal)
    asked, refused = _asked(channels, setup)
    problem = Problem(records, channels, asked, free_states(channels, setup.longitudinal), setup.places)
    held: tuple[Parameter, ...] = ()
    while True:
        problem, dependent, failure = independent(problem)
        refused += dependent
        if failure:
            return _failed(refused, failure)
        fit = fitted(problem)
        if fit is None:
            return _failed(refused, _unsettled(channels))
        covariance = covariance_of(problem, fit.values, fit.deviation, fit.paths, fit.slopes, setup.input_noise)
        vague = vague_among(problem, covariance)
        if not vague and "alpha" not in channels and any(np.min(path.states[:, 0]) <= 0 for path in fit.paths):
            return _failed(
                refused, "the motion found flies backwards: without alpha these records tell no flight path"
            )
        vague = vague or unread_among(problem, fit, covariance)
        if not vague:
            odd = "" if setup.gusts else contradiction(problem, fit, setup.input_noise)
            if odd:  # all numbers rest on all signals
                return _failed(refused, odd)
            wider = with_held(problem, held, fit.values, fit.deviation, fit.paths, covariance)
            return _told(problem, fit, wider, refused)
        refused.append(vague)
        held += tuple(p for p in problem.parameters if p.name == vague.name)
        problem = problem._replace(parameters=tuple(p for p in problem.parameters if p.name != vague.name))


def _unsettled(channels: tuple[str, ...]) -> str:
    """Why no optimum was found, and what to do then."""
    why = "the reconstruction did not converge"
    if "phi" not in channels or "beta" in channels:
        return why
    why += ": without beta the airspeed alone tells how fast it flew sideways, and not whether to the left or right"
    return f"{why}; measure beta, take other stretches of the flight, or its longitudinal motion alone"


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


# --- what is told ---------------------------------------------------------------------------------------


def _told(problem: Problem, fit: Fit, covariance: Array, refused: list[Unidentified]) -> Reconstruction:
    degrees = degrees_of(problem, fit.paths)
    count = len(problem.parameters)
    errors = np.sqrt(np.diag(covariance))[:count]
    rows = zip(problem.parameters, fit.values.errors, errors, strict=True)
    found = [estimate(p.name, p.unit, float(value), float(error), degrees) for p, value, error in rows]
    sure = [k for k, p in enumerate(problem.parameters) if errors[k] <= p.limit]
    refused = refused + [_resting(p, errors[k]) for k, p in enumerate(problem.parameters) if k not in sure]
    correlation = (covariance[:count, :count] / np.outer(errors, errors))[np.ix_(sure, sure)]
    parameters = tuple(found[k] for k in sure)
    tracks = tuple(_track(problem, fit, index) for index in range(len(problem.records)))
    return Reconstruction(parameters, tuple(refused), correlation, tracks, "")


def _resting(asked: Parameter, error: float) -> Unidentified:
    """Why an error is not told that the records would tell if others were zero."""
    return Unidentified(
        asked.name,
        f"it rests on errors held at zero, with which it is told to {error:.2g} {asked.unit} (standard error)",
    )


def _track(problem: Problem, fit: Fit, index: int) -> Track:
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


def _whiteness(name: str, residuals: Array) -> Remainder:
    """Autocorrelation over the samples that were measured."""
    known = residuals[np.isfinite(residuals)]
    tested = whiteness_of(known, lags=min(WHITE_LAGS, max(len(known) // 4, 1)))
    share = 0.0 if tested.failure else tested.share_outside
    return Remainder(name, UNITS[name], float(np.std(known)), share, share <= WHITE_SHARE)
