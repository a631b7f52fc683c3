"""[servo], [power], [torque_speed] and [twist] of a map: models of a servo and of a wing's twist from a bench."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from functools import partial
from typing import Any, NamedTuple

import numpy as np

from logs.identification.data.experiment import Experiment
from logs.identification.diagnostics.signals import moves
from logs.identification.estimators.bench import (
    DAMPING,
    NATURAL,
    identify_torque_speed,
    identify_twist,
    swing_of,
    turning,
)
from logs.identification.estimators.servo import torque_of_readings
from logs.identification.estimators.servo_power import power_of, power_of_readings
from logs.identification.findings import Entry, Finding, register
from logs.identification.results import Array, EstimationResult, FitSeries, linear_result
from logs.identification.sources.table.derived import signal
from logs.identification.sources.table.maneuvers import DataSplit, files_of
from logs.identification.sources.table.quantities import Measure
from logs.pages.document import MEASURED, MODEL, POINTS, Chapter, Plot, Series
from wingbeat.errors import InputError

register({
    "nominal_voltage": Entry("the numbers are for {value:.4g} V", "Voltage of the torque-speed line."),
    "constant_reading": Entry(
        "the response {response} is constant in {where}",
        "A model of a response that does not change is not identifiable.",
        "correct its column in [signals], or vary the load",
    ),
    "residual_deviation": Entry(
        "standard deviation of the residuals {value:.3g} {unit}", "Scatter of the readings about the model."
    ),
})  # fmt: skip


class ServoSection(NamedTuple):
    """Section [servo]: names of signals."""

    torque: str = "torque"
    current: str = "current"


class PowerSection(NamedTuple):
    """Section [power]: names of signals."""

    power: str = "power"
    current: str = "current"
    voltage: str = "voltage"


class TorqueSpeedSection(NamedTuple):
    """Section [torque_speed]: names of signals, and the voltage of the result."""

    torque: str = "torque"
    speed: str = "speed"
    voltage: str | None = None
    """constant at ``nominal`` if not given"""
    nominal: Measure | None = None
    """V; the mean of the voltage if not given"""


class TwistSection(NamedTuple):
    """Section [twist]."""

    signal: str = "twist"


class Readings(NamedTuple):
    """The columns of a static model by key of the section, response first, of every maneuver."""

    data: DataSplit
    subject: str
    units: Mapping[str, str]
    """SI; by key"""
    parts: tuple[tuple[Array, ...], ...]

    @property
    def columns(self) -> tuple[Array, ...]:
        """Each column over the fitted maneuvers."""
        fitted = self.parts[: len(self.data.fitted)]
        return tuple(np.concatenate(column) for column in zip(*fitted, strict=True))

    def series(self, predict: Callable[..., Array]) -> tuple[FitSeries, ...]:
        """Measured and modeled response; ``predict`` takes the columns after the response."""
        name, unit = next(iter(self.units.items()))
        count = len(self.data.fitted)
        return tuple(
            FitSeries(one.name, name, unit, one.time, part[0], predict(*part[1:]), place >= count,
                      independent=one.steady)
            for place, (one, part) in enumerate(zip(self.data.all, self.parts, strict=True))
        )  # fmt: skip

    def constant(self, parameters: tuple[str, ...]) -> tuple[Finding, ...]:
        """Why there are no parameters if the response is constant; empty if it is not."""
        if moves(self.columns[0]):
            return ()
        details = {"response": next(iter(self.units)), "where": files_of(self.data.fitted)}
        return tuple(Finding("constant_reading", "withheld", name, details=details) for name in ("", *parameters))


def _readings(subject: str, section: Any, data: DataSplit, units: Mapping[str, str]) -> Readings:
    """The signals that the section names, in their units.

    Raises:
        InputError: one is missing or in another unit.
    """
    parts = tuple(
        tuple(signal(one, getattr(section, key), unit, f"{subject}.{key}") for key, unit in units.items())
        for one in data.all
    )
    return Readings(data, subject, units, parts)


def servo_fit(section: ServoSection, data: DataSplit) -> list[EstimationResult]:
    """The torque model over all readings, and its torque in those held out.

    Raises:
        InputError: a signal is missing or in another unit, or too few readings.
    """
    readings = _readings("servo", section, data, {"torque": "N m", "current": "A"})
    constant = readings.constant(("K_tau", "K_tau0"))
    if constant:
        return [linear_result("servo", (), constant[1:])]
    torque, current = readings.columns
    model = torque_of_readings(current, torque, data.fitted[0].steady)
    values = {one.name: one.value for one in model.estimates}
    series = readings.series(lambda i: values["K_tau"] * i + values["K_tau0"]) if values else ()
    return [_with_scatter(model, "N m", series)]


def power_fit(section: PowerSection, data: DataSplit) -> list[EstimationResult]:
    """The power model over all readings, and its power in those held out.

    Raises:
        InputError: a signal is missing or in another unit, or too few readings.
    """
    readings = _readings("power", section, data, {"power": "W", "current": "A", "voltage": "V"})
    constant = readings.constant(("P_0",))
    if constant:
        return [linear_result("power", (), constant[1:])]
    power, current, voltage = readings.columns
    model = power_of_readings(current, voltage, power, data.fitted[0].steady)
    known = any(one.name == "P_0" for one in model.estimates)
    series = readings.series(partial(power_of, model)) if known else ()
    return [_with_scatter(model, "W", series)]


def _with_scatter(model: EstimationResult, unit: str, series: tuple[FitSeries, ...]) -> EstimationResult:
    """The model of readings with its ``series`` and the scatter of the residuals in ``unit``."""
    scatter = Finding("residual_deviation", "info", "", model.residual_deviation, None, {"unit": unit})
    return model._replace(series=series, findings=(*model.findings, scatter))


def torque_speed_fit(section: TorqueSpeedSection, data: DataSplit) -> list[EstimationResult]:
    """The line over all maneuvers, and its torque in those that were held out.

    Raises:
        InputError: a signal is missing or in another unit, or too few samples have all of them.
    """
    nominal = None if section.nominal is None else section.nominal.si("V", 0.0)
    units = {"torque": "N m", "speed": "rad/s", "voltage": "V"}
    if section.voltage is None:
        if nominal is None:
            raise InputError("torque_speed needs voltage (a signal) or nominal (V)")
        del units["voltage"]
    readings = _readings("torque_speed", section, data, units)
    if section.voltage is None:
        parts = tuple((*part, np.full(len(part[0]), nominal)) for part in readings.parts)
        readings = readings._replace(parts=parts)
    torque, speed, voltage = readings.columns
    volts = float(np.nanmean(voltage)) if nominal is None else nominal
    model = identify_torque_speed(torque, speed, voltage, volts)
    values = {one.name: one.value for one in model.estimates}
    series: list[FitSeries] = []
    chapters: tuple[Chapter, ...] = ()
    if values:
        stall, slope = values["stall_torque"], values["torque_speed_slope"]
        signs = [turning(*part[:2]) for part in readings.parts]
        series = [
            one._replace(model=np.asarray(sign * stall * part[2] / volts - slope * part[1]))
            for one, part, sign in zip(
                readings.series(lambda speed, _: np.zeros(len(speed))), readings.parts, signs, strict=True
            )
        ]
        sign = turning(torque, speed)
        ends = np.array([0.0, values["no_load_speed"]])
        nominal_torque = torque * sign + stall * (1.0 - voltage / volts)
        lines = (
            Series("measured, for the nominal voltage", speed * sign, nominal_torque, MEASURED, POINTS),
            Series("bounding line", ends, stall - slope * ends, MODEL),
        )
        chapters = (Chapter("Torque and speed", plots=(Plot("", "speed", "rad/s", "torque", "N m", lines),)),)
    finding = Finding("nominal_voltage", "info", "", volts)
    return [model._replace(series=tuple(series), chapters=chapters, findings=(*model.findings, finding))]


def twist_fits(section: TwistSection, data: DataSplit) -> list[EstimationResult]:
    """Each release separately, and those held out with the mean of the others' constants.

    Raises:
        InputError: the signal is missing or is no angle or rate, or a release has too few samples.
    """
    name = section.signal
    for one in data.all:
        signal(one, name, None, "twist.signal")
        if one.units.get(name) not in ("rad", "rad/s"):
            raise InputError(f"twist.signal: signals.{name} is no angle and no rate")
    fits = []
    for one in data.fitted:
        model = identify_twist(one, name)
        values = {one.name: one.value for one in model.estimates}
        series = (_swing(one, name, values[NATURAL], values[DAMPING], held_out=False),) if values else ()
        fits.append(model._replace(title=f"twist, {one.name}", series=series))
    known = [fit for fit in fits if fit.estimates]
    if known and data.held_out:
        natural, damping = (float(np.mean([fit.value(key) for fit in known])) for key in (NATURAL, DAMPING))
        ahead = tuple(_swing(one, name, natural, damping, held_out=True) for one in data.held_out)
        fits[fits.index(known[0])] = known[0]._replace(series=(*known[0].series, *ahead))
    return fits


def _swing(one: Experiment, name: str, natural: float, damping: float, held_out: bool) -> FitSeries:
    """The release as measured and by Eq. 16; initial angle, rate and rest are per record."""
    swing = swing_of(one, name, natural, damping)
    return FitSeries(one.name, name, one.units[name], swing.time, swing.measured, swing.model, held_out)
