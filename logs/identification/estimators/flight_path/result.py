"""A reconstructed flight path as any method's fit: the sensors' errors, measured beside told, the motion drawn."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from logs.identification.data.experiment import Experiment
from logs.identification.estimators.flight_path.reconstruction import Reconstruction, Setup, Track, reconstruct
from logs.identification.estimators.flight_path.sensors import UNITS, WRAPPED, usual_parameters
from logs.identification.models.rigid_body import INPUTS
from logs.identification.report.document import LINE, MEASURED, MODEL, POINTS, Chapter, Plot, Series
from logs.identification.results import Array, FitSeries, Fitted
from wingbeat.errors import InputError

METHOD = "flight path"
WHOLE = (
    "u' = a_x - g sin(theta) + r v - q w",
    "v' = a_y + g cos(theta) sin(phi) + p w - r u",
    "w' = a_z + g cos(theta) cos(phi) + q u - p v",
    "phi' = p + (q sin(phi) + r cos(phi)) tan(theta)",
    "theta' = q cos(phi) - r sin(phi)",
    "psi' = (q sin(phi) + r cos(phi)) / cos(theta)",
)
LONGITUDINAL = ("u' = a_x - g sin(theta) - q w", "w' = a_z + g cos(theta) + q u", "theta' = q")
SENSORS = "A sensor tells (1 + scale) times the truth plus its bias; the air moves steadily and level."
DRAWN = ("airspeed", "alpha", "beta", "phi", "theta", "psi", "altitude")
MOST_DRAWN = 6
"""-; records whose motion is drawn"""
MOTION = (
    "The motion that all sensors agree on, flow angles and airspeed at the centre of mass; points are as measured."
)


def fitted_path(
    experiments: Sequence[Experiment], found: Reconstruction, setup: Setup, held: Sequence[Experiment] = ()
) -> Fitted:
    """The fit of ``found`` from ``experiments``, and what its sensors' errors make of those ``held`` out.

    Signals as `flight_path.reconstruct` takes them. Held-out records have first states of their own, the sensors'
    errors are those found; their wind is that of the others.
    """
    equations = (*(LONGITUDINAL if setup.longitudinal else WHOLE), SENSORS)
    pairs = zip(experiments, found.tracks, strict=True) if found.tracks else ()
    series = [one for experiment, track in pairs for one in _series(experiment, track, held_out=False)]
    more, notes = predicted_path(found, setup, held) if held and not found.failure else ([], ())
    correlation = found.correlation if found.parameters else None
    return Fitted(METHOD, equations, found.parameters, found.unidentified, correlation, (*series, *more), notes)


def predicted_path(
    found: Reconstruction, setup: Setup, held: Sequence[Experiment]
) -> tuple[list[FitSeries], tuple[str, ...]]:
    """Measured, freed of the errors ``found``, beside the kinematics of records that these were not found from."""
    names = tuple(dict.fromkeys((*usual_parameters(setup.longitudinal), *setup.also)))
    series: list[FitSeries] = []
    notes: list[str] = []
    for one in held:
        freed = freed_of_errors(one, found)
        try:
            alone = reconstruct([freed], setup._replace(known=names))
        except InputError as error:
            notes.append(str(error))
            continue
        if alone.failure:
            notes.append(f"{one.name}: {alone.failure}")
        else:
            series += _series(freed, alone.tracks[0], held_out=True)
    return series, tuple(notes)


def freed_of_errors(experiment: Experiment, found: Reconstruction) -> Experiment:
    """The experiment's signals without the sensors' errors and the drift with the wind that were ``found``."""
    errors = {one.name: one.value for one in found.parameters}
    signals = dict(experiment.signals)
    for name in signals.keys() & UNITS.keys():
        drift = errors.get(f"wind_{name}", 0.0) * (experiment.time - experiment.time[0])
        scale, bias = errors.get(f"scale_{name}", 0.0), errors.get(f"bias_{name}", 0.0)
        signals[name] = (signals[name] - drift - bias) / (1.0 + scale)
    return experiment._replace(signals=signals)


def _series(experiment: Experiment, track: Track, held_out: bool) -> list[FitSeries]:
    """Each output as measured and as the fitted kinematics and sensors tell it."""
    series = []
    for name, left in track.residuals.items():
        measured = _unwrapped(name, experiment.signals.get(name, np.full(len(left), np.nan)))
        series.append(
            FitSeries(experiment.name, name, UNITS[name], experiment.time, measured, measured - left, held_out)
        )
    return series


def _unwrapped(name: str, values: Array) -> Array:
    whole = np.array(values, dtype=np.float64)
    known = np.isfinite(whole)
    if name in WRAPPED:
        whole[known] = np.unwrap(whole[known])
    return whole


def path_chapter(experiments: Sequence[Experiment], found: Reconstruction) -> Chapter | None:
    """The motion of the first records; None where there is none."""
    pairs = list(zip(experiments, found.tracks, strict=True)) if found.tracks else []
    parts = tuple(Chapter(one.name, plots=_plots(one, track)) for one, track in pairs[:MOST_DRAWN])
    left = f" The first {MOST_DRAWN} of {len(pairs)} records are drawn." if len(pairs) > MOST_DRAWN else ""
    return Chapter("Flight path", (MOTION + left,), parts=parts) if parts else None


def _plots(experiment: Experiment, track: Track) -> tuple[Plot, ...]:
    motion = track.motion
    plots = []
    for name in DRAWN:
        measured = experiment.signals.get(name)
        if measured is None or not np.any(np.isfinite(measured)):
            continue
        lines = (
            Series("measured", experiment.time, _unwrapped(name, measured), MEASURED, POINTS),
            Series("reconstructed", motion.time, np.asarray(motion.signals[name]), MODEL, LINE),
        )
        plots.append(Plot("", "time", "s", name, UNITS[name], lines))
    return tuple(plots)


def input_names(longitudinal: bool) -> tuple[str, ...]:
    """Signals that drive the kinematics and must have no gaps."""
    return ("q", "a_x", "a_z") if longitudinal else INPUTS
