"""Chapter of the drive servos: what was found, and torque and power against current and beside the model."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from logs.identification.data.flight import DriveData
from logs.identification.estimators.flapping_frequency import FrequencyModel
from logs.identification.estimators.servo import ServoModel
from logs.identification.report.document import DASHED, MEASURED, MODEL, POINTS, Bar, Chapter, Intervals, Plot, Series
from logs.identification.results import Array
from logs.strokes import interval_mean, stroke_cuts, stroke_means

TORQUE_MODEL = (
    "Torque (Gerdes Eq. 11): mean of the two drives' |torque| = K_tau I + K_tau0, with the current I of both; where"
    " both are loaded, above the floor of the idle current."
)
LOAD_MODEL = "What the drives turn (Gerdes Table 5): torque = torque constant × wing rate + inertia × its derivative."
THROTTLE_MODEL = (
    "Strokes per second = flapping frequency + throttle slope × T + throttle curvature × T² + voltage slope × V, with"
    " the throttle T and the voltage V from the centre of the data; terms that the data does not need are left out."
)
POWER_MODEL = (
    "Output power of one drive over a stroke (Gerdes Eq. 12): P = C_A + C_B I + C_C V + C_F i v + C_G i² + C_H v²,"
    " with half the current I and the voltage V; i and v are these from the centre."
)

OF_POWER = "power."
"""before the names of the power model's true values"""


def drives_chapter(
    torque: ServoModel | None, power: ServoModel | None, data: DriveData | None, truths: Mapping[str, float]
) -> Chapter | None:
    """The servo models; None where neither was asked for or found. ``data`` None leaves the scatter plots out."""
    parts = []
    if torque is not None:
        scatter = () if data is None else (_torque_plot(torque, data),)
        parts.append(_part("Torque", TORQUE_MODEL, torque, truths, "N m", scatter))
    if power is not None:
        plots = () if data is None else _power_plots(power, data)
        of_power = {name.removeprefix(OF_POWER): v for name, v in truths.items() if name.startswith(OF_POWER)}
        parts.append(_part("Power", POWER_MODEL, power, of_power, "W", plots))
    return Chapter("Drive servos", parts=tuple(parts)) if parts else None


def wings_chapter(
    load: ServoModel | None, frequency: FrequencyModel | None, truths: Mapping[str, float]
) -> Chapter | None:
    """What the wings ask of the drives, and how fast they beat by the throttle; None where neither was found."""
    parts: list[Chapter] = []
    if load is not None:
        parts.append(_part("Load", LOAD_MODEL, load, truths, "N m", ()))
    if frequency is not None and (frequency.estimates or frequency.segments):
        parts.append(_frequency(frequency, truths))
    return Chapter("Wings on the drives", parts=tuple(parts)) if parts else None


def _frequency(model: FrequencyModel, truths: Mapping[str, float]) -> Chapter:
    bars = tuple(Bar(e.name, e, truths.get(e.name)) for e in model.estimates)
    refused = [f"Not identified: {one.name}: {one.reason}." for one in model.unidentified]
    voltage = f" and {model.centre_voltage:.4g} V" if model.centre_voltage else ""
    told = (
        f"{len(model.segments)} stretches of steady throttle, residual {model.residual:.3g} Hz (standard deviation)."
        f" Centre: throttle {model.centre_throttle:.3g}{voltage}."
    )
    drawn = (Intervals("", bars),) if bars else ()
    return Chapter("Frequency against throttle", (THROTTLE_MODEL, told, *refused), plots=(*drawn, _beats(model)))


def _beats(model: FrequencyModel) -> Plot:
    """Every stretch, and the model at the centre's voltage."""
    throttle, measured = (
        np.array([getattr(one, key) for one in model.segments]) for key in ("throttle", "frequency")
    )
    series = [Series("steady stretches", throttle, measured, MEASURED, POINTS)]
    found = {e.name: e.value for e in model.estimates}
    beating = throttle[measured > 0]
    if {"flapping_frequency", "throttle_slope"} <= found.keys() and len(beating):
        at = np.linspace(beating.min(), beating.max(), 50)
        off = at - model.centre_throttle
        slope = found["throttle_slope"] + found.get("throttle_curvature", 0.0) * off
        series.insert(0, Series("model", at, found["flapping_frequency"] + slope * off, MODEL))
    return Plot("Flapping frequency", "throttle", "-", "frequency", "Hz", tuple(series))


def _part(
    title: str, equation: str, model: ServoModel, truths: Mapping[str, float], unit: str, plots: tuple[Plot, ...]
) -> Chapter:
    """One model: equation, numbers, refusals and scatter."""
    bars = tuple(Bar(e.name, e, truths.get(e.name)) for e in model.estimates)
    refused = [f"Not identified: {one.name}: {one.reason}." for one in model.unidentified]
    centre = (
        f" Centre: {-model.centre_current:.3g} A and {-model.centre_voltage:.3g} V per drive."
        if model.centre_voltage
        else ""
    )
    told = f"{model.samples} samples, residual {model.residual:.3g} {unit} (standard deviation).{centre}"
    return Chapter(title, (equation, told, *refused), plots=((Intervals("", bars),) if bars else ()) + plots)


def _values(model: ServoModel) -> dict[str, float]:
    return {e.name: e.value for e in model.estimates}


def _torque_plot(model: ServoModel, data: DriveData) -> Plot:
    """Mean size of both torques in the middle of each burst against its current, and the line."""
    middle = data.power_time - data.window / 2
    inside = (middle >= data.torque_time[0]) & (middle <= data.torque_time[-1])
    sides = [np.abs(np.interp(middle[inside], data.torque_time, t)) for t in (data.torque_left, data.torque_right)]
    current, torque = data.current[inside], (sides[0] + sides[1]) / 2
    series = [Series("measured", current, torque, MEASURED, POINTS)]
    found = _values(model)
    if {"K_tau", "K_tau0"} <= set(found) and len(current):
        ends = np.array([current.min(), current.max()])
        series.append(Series("model", ends, found["K_tau0"] + found["K_tau"] * ends, MODEL))
    return Plot("Torque against current", "current of both drives", "A", "torque", "N m", tuple(series))


def _power_plots(model: ServoModel, data: DriveData) -> tuple[Plot, ...]:
    """Stroke means: power against current, and measured against modelled."""
    current, voltage, power = _stroke_means(data)
    if len(power) < 2:
        return ()
    modelled = _power(model, current, voltage)
    against = Plot(
        "Power against current, stroke means", "current of one drive", "A", "output power of one drive", "W",
        (Series("measured", current, power, MEASURED, POINTS), Series("model", current, modelled, MODEL, POINTS)),
    )  # fmt: skip
    if not np.all(np.isfinite(modelled)):
        return (against._replace(series=against.series[:1]),)
    ends = np.array([min(power.min(), modelled.min()), max(power.max(), modelled.max())])
    beside = Plot(
        "Measured against modelled power", "modelled", "W", "measured", "W",
        (Series("strokes", modelled, power, MEASURED, POINTS), Series("equal", ends, ends, MODEL, DASHED)),
    )  # fmt: skip
    return against, beside


def _power(model: ServoModel, current: Array, voltage: Array) -> Array:
    """Eq. 12 about its centre with the coefficients that were found; NaN where the power there is not told."""
    found = _values(model)
    i, v = current + model.centre_current, voltage + model.centre_voltage
    terms = {"C_B": i, "C_C": v, "C_F": i * v, "C_G": i * i, "C_H": v * v}
    if "P_0" not in found:
        return np.full(len(current), np.nan)
    total = np.full(len(current), found["P_0"])
    for name, column in terms.items():
        total += found.get(name, 0.0) * column
    return total


def _stroke_means(data: DriveData) -> tuple[Array, Array, Array]:
    """Current (A) and output power (W) of one drive, and voltage (V), over every stroke of flapping wings."""
    nothing = np.zeros(0)
    if not len(data.wing_time) or np.ptp(data.strokes) <= 2:
        return nothing, nothing, nothing
    half = data.window / 2
    first = max(data.power_time[0], data.torque_time[0], data.wing_time[0]) + half
    last = min(data.power_time[-1] - half, data.torque_time[-1], data.wing_time[-1])
    cuts = stroke_cuts(data.wing_time, data.strokes)
    cuts = cuts[(cuts >= first) & (cuts <= last)]
    if len(cuts) < 3:
        return nothing, nothing, nothing
    power = np.zeros(len(data.torque_time))
    for torque, rate in ((data.torque_left, data.rate_left), (data.torque_right, data.rate_right)):
        power += torque * np.interp(data.torque_time, data.wing_time, rate)
    flapping = np.diff(cuts) < 3 * np.median(np.diff(cuts))
    both = np.column_stack((data.current, data.voltage))
    columns = interval_mean(data.power_time - half, both, cuts[:-1], cuts[1:])[flapping]
    return columns[:, 0] / 2, columns[:, 1], stroke_means(data.torque_time, power, cuts)[flapping] / 2
