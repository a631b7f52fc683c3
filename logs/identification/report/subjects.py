"""Chapters of single subjects: drive servos, wings, wing coefficients, flight path."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np

from logs.identification.data.experiment import Experiment
from logs.identification.data.flight import DriveData
from logs.identification.estimators.flapping_frequency import FrequencyResult
from logs.identification.estimators.flight_path import WRAPPED, FlightPath, unwrapped
from logs.identification.estimators.gps_aided import ATTITUDE, VELOCITIES
from logs.identification.estimators.servo_power import power_of
from logs.identification.estimators.stepwise import Step
from logs.identification.estimators.wing_coefficients import AeroResult, coefficient_r_squared
from logs.identification.models.rigid_body import UNITS
from logs.identification.report.methods import intervals, missing_remarks
from logs.identification.results import Array, EstimationResult
from logs.identification.sources.flight_path import PathResult
from logs.pages.document import (
    DASHED,
    LINE,
    MEASURED,
    MODEL,
    POINTS,
    Chapter,
    Plot,
    Series,
    Table,
)
from logs.pages.labels import REGRESSORS, sentence
from logs.strokes import interval_mean, stroke_cuts, stroke_means

TORQUE_MODEL = "Mean |torque| of both drives (Gerdes Eq. 11): K_tau I + K_tau0, with the current I of both."
LOAD_MODEL = "Torque of one drive (Gerdes Table 5): torque constant × wing rate + inertia × wing acceleration."
THROTTLE_MODEL = (
    "Flapping frequency = f + slope × T + curvature × T² + voltage slope × V; throttle T and voltage V about the"
    " center of the data; only significant terms."
)
POWER_MODEL = (
    "Output power of one drive over a stroke (Gerdes Eq. 12): P = C_A + C_B I + C_C V + C_F i v + C_G i² + C_H v²,"
    " with half the current I and the voltage V; i and v are these about their centers."
)
COEFFICIENT_MODEL = (
    "Coefficients of the wings from the equations of motion (Grauer Eq. 13 to 16); their terms by stepwise"
    " regression."
)
POWER_PREFIX = "power."
"""of the names of the power model's true values"""
PLOTTED = ("airspeed", "alpha", "beta", "phi", "theta", "psi", "altitude")
PLOTTED_RECORDS = 6
"""-; limit of the records of a flight path that are plotted"""


def drives_chapter(
    torque: EstimationResult | None,
    power: EstimationResult | None,
    data: DriveData | None,
    truths: Mapping[str, float],
) -> Chapter | None:
    """Return the servo models; None if there are none. Without ``data`` there are no scatter plots."""
    parts = []
    if torque is not None:
        scatter = () if data is None else (_torque_plot(torque, data),)
        parts.append(_part("Torque", TORQUE_MODEL, torque, truths, "N m", scatter))
    if power is not None:
        plots = () if data is None else _power_plots(power, data)
        of_power = {name.removeprefix(POWER_PREFIX): v for name, v in truths.items() if name.startswith(POWER_PREFIX)}
        parts.append(_part("Power", POWER_MODEL, power, of_power, "W", plots))
    return Chapter("Drive servos", parts=tuple(parts)) if parts else None


def wings_chapter(
    load: EstimationResult | None, frequency: FrequencyResult | None, truths: Mapping[str, float]
) -> Chapter | None:
    """Return load of the wings on the drives and flapping frequency by throttle; None if there are none."""
    parts: list[Chapter] = []
    if load is not None:
        parts.append(_part("Load", LOAD_MODEL, load, truths, "N m", ()))
    if frequency is not None and (frequency.result.estimates or frequency.segments):
        parts.append(_frequency(frequency, truths))
    return Chapter("Wing load and flapping frequency", parts=tuple(parts)) if parts else None


def _frequency(frequency: FrequencyResult, truths: Mapping[str, float]) -> Chapter:
    model, segments = frequency
    voltage = f" and {model.fixed['V_c']:.4g} V" if "V_c" in model.fixed else ""
    text = (
        f"{len(segments)} segments of steady throttle, standard deviation {model.residual_deviation:.3g} Hz."
        f" Center: throttle {model.fixed['T_c']:.3g}{voltage}."
    )
    return Chapter(
        "Flapping frequency by throttle", (THROTTLE_MODEL, text),
        plots=(*intervals(model.estimates, truths), _frequency_plot(frequency)),
        findings=missing_remarks(model.withheld),
    )  # fmt: skip


def _frequency_plot(model: FrequencyResult) -> Plot:
    """Return every segment and the model at the central voltage."""
    throttle, measured = (
        np.array([getattr(one, key) for one in model.segments]) for key in ("throttle", "frequency")
    )
    series = [Series("steady segments", throttle, measured, MEASURED, POINTS)]
    values = {e.name: e.value for e in model.result.estimates}
    flapping = throttle[measured > 0]
    if {"flapping_frequency", "throttle_slope"} <= values.keys() and len(flapping):
        grid = np.linspace(flapping.min(), flapping.max(), 50)
        change = grid - model.result.fixed["T_c"]
        slope = values["throttle_slope"] + values.get("throttle_curvature", 0.0) * change
        series.insert(0, Series("model", grid, values["flapping_frequency"] + slope * change, MODEL))
    return Plot("Flapping frequency", "throttle", "-", "frequency", "Hz", tuple(series))


def _part(
    title: str,
    equation: str,
    model: EstimationResult,
    truths: Mapping[str, float],
    unit: str,
    plots: tuple[Plot, ...],
) -> Chapter:
    """Return one model: equation, estimates, findings and scatter plots."""
    center = f" Center: {-model.fixed['C_D']:.3g} A and {-model.fixed['C_E']:.3g} V per drive." if model.fixed else ""
    text = f"{model.samples} samples, residual standard deviation {model.residual_deviation:.3g} {unit}.{center}"
    return Chapter(
        title, (equation, text), plots=(*intervals(model.estimates, truths), *plots),
        findings=missing_remarks(model.withheld),
    )  # fmt: skip


def _torque_plot(model: EstimationResult, data: DriveData) -> Plot:
    """Return the mean |torque| of both drives in the middle of each burst over its current, and the line."""
    middle = data.power_time - data.window / 2
    inside = (middle >= data.torque_time[0]) & (middle <= data.torque_time[-1])
    sides = [np.abs(np.interp(middle[inside], data.torque_time, t)) for t in (data.torque_left, data.torque_right)]
    current, torque = data.current[inside], (sides[0] + sides[1]) / 2
    series = [Series("measured", current, torque, MEASURED, POINTS)]
    values = {one.name: one.value for one in model.estimates}
    if {"K_tau", "K_tau0"} <= set(values) and len(current):
        ends = np.array([current.min(), current.max()])
        series.append(Series("model", ends, values["K_tau0"] + values["K_tau"] * ends, MODEL))
    return Plot("Torque by current", "current of both drives", "A", "torque", "N m", tuple(series))


def _power_plots(model: EstimationResult, data: DriveData) -> tuple[Plot, ...]:
    """Return stroke means: power over current, and measured over modeled power."""
    current, voltage, power = _stroke_means(data)
    if len(power) < 2:
        return ()
    modeled = power_of(model, current, voltage)
    by_current = Plot(
        "Power by current, stroke means", "current of one drive", "A", "output power of one drive", "W",
        (Series("measured", current, power, MEASURED, POINTS), Series("model", current, modeled, MODEL, POINTS)),
    )  # fmt: skip
    if not np.all(np.isfinite(modeled)):
        return (by_current._replace(series=by_current.series[:1]),)
    ends = np.array([min(power.min(), modeled.min()), max(power.max(), modeled.max())])
    comparison = Plot(
        "Measured by modeled power", "modeled", "W", "measured", "W",
        (Series("strokes", modeled, power, MEASURED, POINTS), Series("equal", ends, ends, MODEL, DASHED)),
    )  # fmt: skip
    return by_current, comparison


def _stroke_means(data: DriveData) -> tuple[Array, Array, Array]:
    """Return current (A) and voltage (V) of one drive and its output power (W), mean of every stroke."""
    empty = np.zeros(0)
    if not len(data.wing_time) or np.ptp(data.strokes) <= 2:
        return empty, empty, empty
    half = data.window / 2
    first = max(data.power_time[0], data.torque_time[0], data.wing_time[0]) + half
    last = min(data.power_time[-1] - half, data.torque_time[-1], data.wing_time[-1])
    cuts = stroke_cuts(data.wing_time, data.strokes)
    cuts = cuts[(cuts >= first) & (cuts <= last)]
    if len(cuts) < 3:
        return empty, empty, empty
    power = np.zeros(len(data.torque_time))
    for torque, rate in ((data.torque_left, data.rate_left), (data.torque_right, data.rate_right)):
        power += torque * np.interp(data.torque_time, data.wing_time, rate)
    flapping = np.diff(cuts) < 3 * np.median(np.diff(cuts))
    both = np.column_stack((data.current, data.voltage))
    columns = interval_mean(data.power_time - half, both, cuts[:-1], cuts[1:])[flapping]
    return columns[:, 0] / 2, columns[:, 1], stroke_means(data.torque_time, power, cuts)[flapping] / 2


# --- wing coefficients ----------------------------------------------------------------------------------------------


def aero_chapter(result: AeroResult, truths: Mapping[str, float]) -> Chapter:
    """Return the sources, the regressors and a part for each of C_L, C_T and C_m."""
    regressors = Table(
        ("regressor", "unit", "meaning"), tuple((name, *row) for name, row in REGRESSORS.items()),
        "Slopes are per regressor, or per product of regressors.",
    )  # fmt: skip
    notes = (COEFFICIENT_MODEL, f"From {', '.join(result.records)}.", *map(sentence, result.notes))
    return Chapter(
        "Wing coefficients", notes, (regressors,), parts=tuple(_coefficient(one, truths) for one in result.models)
    )


def _coefficient(model: EstimationResult, truths: Mapping[str, float]) -> Chapter:
    text = f"R² = {coefficient_r_squared(model.steps):.4f}, {model.samples} samples."
    tables = (step_table(model.steps),) if model.steps else ()
    return Chapter(
        model.title, (text,), tables, intervals(model.estimates, truths),
        findings=missing_remarks(model.withheld),
    )  # fmt: skip


def step_table(steps: tuple[Step, ...]) -> Table:
    """Return the steps of a stepwise regression: the term that entered or left, statistics, reason."""
    rows = tuple(
        (
            f"{number}", one.action, one.term.replace("*", " "), one.colored_f, one.statistics.r_squared,
            one.statistics.press, one.statistics.pse, one.why,
        )
        for number, one in enumerate(steps)
    )  # fmt: skip
    return Table(("step", "", "term", "F", "R²", "PRESS", "PSE", "reason"), rows)


# --- flight path ----------------------------------------------------------------------------------------------------


def path_chapter(records: Sequence[Experiment], path: FlightPath) -> Chapter | None:
    """Return the motion of the first records; None if there is none."""
    pairs = list(zip(records, path.motions, strict=True)) if path.motions else []
    parts = tuple(Chapter(one.name, plots=_path_plots(one, motion)) for one, motion in pairs[:PLOTTED_RECORDS])
    rest = f" The first {PLOTTED_RECORDS} of {len(pairs)} records." if len(pairs) > PLOTTED_RECORDS else ""
    note = f"Flow angles and airspeed at the center of mass.{rest}"
    return Chapter("Reconstructed motion", (note,), parts=parts) if parts else None


def _path_plots(record: Experiment, motion: Experiment) -> tuple[Plot, ...]:
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


def log_path_chapter(result: PathResult) -> Chapter | None:
    """Return the motion of a log."""
    if result.by_attitude is not None:
        return path_chapter(*result.by_attitude)
    if result.by_velocities is None:
        return None
    flight, fit = result.by_velocities
    time = flight.time[flight.at]
    columns = [
        (name, "rad", np.unwrap(flight.attitude[flight.at, k]), fit.motion[:, 3 + k], LINE)
        for k, name in enumerate(ATTITUDE)
    ]
    columns += [(n, "m/s", flight.velocity[:, k], fit.predicted[:, k], POINTS) for k, n in enumerate(VELOCITIES)]
    plots = []
    for name, unit, measured, model, style in columns:
        recorded = Series("recorded", time, measured, MEASURED, style)
        plots.append(Plot("", "time", "s", name, unit, (recorded, Series("reconstructed", time, model, MODEL, LINE))))
    note = "Reconstruction, attitude of the flight computer and GPS velocity."
    return Chapter("Reconstructed motion", (note,), plots=tuple(plots))
