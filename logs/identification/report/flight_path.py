"""Plots of a reconstructed flight path."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from logs.identification.data.experiment import Experiment
from logs.identification.estimators.flight_path import WRAPPED, FlightPath, unwrapped
from logs.identification.estimators.gps_aided import ATTITUDE, VELOCITIES
from logs.identification.models.rigid_body import UNITS
from logs.identification.report.document import LINE, MEASURED, MODEL, POINTS, Chapter, Plot, Series
from logs.identification.sources.flight_path import PathResult

PLOTTED = ("airspeed", "alpha", "beta", "phi", "theta", "psi", "altitude")
MAX_RECORDS = 6
"""-; records whose motion is plotted"""
CAPTION = "Reconstructed motion; flow angles and airspeed at the center of mass. Points are measured."

LOG_CAPTION = "Reconstructed motion, with the flight computer's attitude and the fixes of the GPS."


def path_chapter(records: Sequence[Experiment], path: FlightPath) -> Chapter | None:
    """The motion of the first records; None if there is none."""
    pairs = list(zip(records, path.motions, strict=True)) if path.motions else []
    parts = tuple(Chapter(one.name, plots=_plots(one, motion)) for one, motion in pairs[:MAX_RECORDS])
    left = f" The first {MAX_RECORDS} of {len(pairs)} records." if len(pairs) > MAX_RECORDS else ""
    return Chapter("Flight path", (CAPTION + left,), parts=parts) if parts else None


def log_chapter(result: PathResult) -> Chapter | None:
    """The motion of a log."""
    if result.by_attitude is not None:
        return path_chapter(*result.by_attitude)
    if result.by_velocities is None:
        return None
    flight, fit = result.by_velocities
    time = flight.time[flight.at]
    columns = [(name, "rad", np.unwrap(flight.attitude[flight.at, k]), fit.motion[:, 3 + k], LINE)
               for k, name in enumerate(ATTITUDE)]  # fmt: skip
    columns += [
        (name, "m/s", flight.velocity[:, k], fit.predicted[:, k], POINTS) for k, name in enumerate(VELOCITIES)
    ]
    plots = []
    for name, unit, measured, model, style in columns:
        recorded = Series("recorded", time, measured, MEASURED, style)
        lines = (recorded, Series("reconstructed", time, model, MODEL, LINE))
        plots.append(Plot("", "time", "s", name, unit, lines))
    return Chapter("Flight path", (LOG_CAPTION,), plots=tuple(plots))


def _plots(record: Experiment, motion: Experiment) -> tuple[Plot, ...]:
    plots = []
    for name in PLOTTED:
        measured = np.asarray(record.signals.get(name, np.full(1, np.nan)), dtype=np.float64)
        if np.any(np.isfinite(measured)):
            points = unwrapped(measured) if name in WRAPPED else measured
            lines = (
                Series("measured", record.time, points, MEASURED, POINTS),
                Series("reconstructed", motion.time, np.asarray(motion.signals[name]), MODEL, LINE),
            )
            plots.append(Plot("", "time", "s", name, UNITS[name], lines))
    return tuple(plots)
