"""[servo] and [power] of a map: torque and power model of a servo (Gerdes Eq. 11 and 12) from readings of a bench."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import NamedTuple

import numpy as np

from logs.identification.data.experiment import Experiment
from logs.identification.estimators.servo import ServoModel, torque_of_readings
from logs.identification.estimators.servo_power import power_of_readings
from logs.identification.results import Array, EstimationResult, FitSeries, Fitted, Information, from_fitted
from logs.identification.sources.table.maneuvers import Cut
from logs.identification.sources.table.signal_lookup import signal

SERVO_EXAMPLE = """\
# Torque model of a servo (Gerdes Eq. 11): wingbeat identify BENCH.csv --map THIS.toml servo
[experiment]
kind = "steady"              # rows are independent readings in any order

[signals]
torque = { column = "torque", unit = "N m" }
current = { column = "I", unit = "A" }

[servo]
torque = "torque"            # names of signals
current = "current"
"""
POWER_EXAMPLE = """\
# Power model of a servo (Gerdes Eq. 12): wingbeat identify BENCH.csv --map THIS.toml power
[experiment]
kind = "steady"              # rows are independent readings in any order

[signals]
power = { column = "P", unit = "W" }                 # mechanical: torque times speed
current = { column = "I", unit = "A" }
voltage = { column = "U", unit = "V" }

[power]
power = "power"              # names of signals
current = "current"
voltage = "voltage"
"""
TORQUE = ("torque = K_tau I + K_tau0 (Gerdes Eq. 11)",)
POWER = (
    "P = C_A + C_B I + C_C V + C_F (I + C_D)(V + C_E) + C_G (I + C_D)^2 + C_H (V + C_E)^2 (Gerdes Eq. 12)",
    "P_0 is the power at the mean current and voltage, -C_D and -C_E",
)


class ServoSection(NamedTuple):
    """Section [servo]."""

    torque: str = "torque"
    current: str = "current"


class PowerSection(NamedTuple):
    """Section [power]."""

    power: str = "power"
    current: str = "current"
    voltage: str = "voltage"


def servo_fit(
    section: ServoSection, data: Cut, constants: Mapping[str, float], fill: float | None
) -> list[EstimationResult]:
    """The torque model over all readings, and its torque in those held out.

    Raises:
        InputError: a signal is missing or in another unit, or too few readings.
    """

    def columns(one: Experiment) -> tuple[Array, ...]:
        return tuple(
            signal(one, name, unit, f"servo.{key}")
            for key, name, unit in (("torque", section.torque, "N m"), ("current", section.current, "A"))
        )

    def model(values: Mapping[str, float], current: Array) -> Array:
        return values["K_tau"] * current + values["K_tau0"]

    torque, current = _all(columns, data.fitted)
    fit = torque_of_readings(current, torque, data.fitted[0].steady)
    return [_table_fit("servo", "torque", "N m", TORQUE, fit, _series(data, columns, fit, model, "torque", "N m"))]


def power_fit(
    section: PowerSection, data: Cut, constants: Mapping[str, float], fill: float | None
) -> list[EstimationResult]:
    """The power model over all readings, and its power in those held out.

    Raises:
        InputError: a signal is missing or in another unit, or too few readings.
    """

    def columns(one: Experiment) -> tuple[Array, ...]:
        wanted = (("power", section.power, "W"), ("current", section.current, "A"), ("voltage", section.voltage, "V"))
        return tuple(signal(one, name, unit, f"power.{key}") for key, name, unit in wanted)

    power, current, voltage = _all(columns, data.fitted)
    fit = power_of_readings(current, voltage, power, data.fitted[0].steady)

    def model(values: Mapping[str, float], current: Array, voltage: Array) -> Array:
        i, v = current + fit.centre_current, voltage + fit.centre_voltage
        terms = {"C_B": i, "C_C": v, "C_F": i * v, "C_G": i * i, "C_H": v * v}
        total = np.full(len(i), values["P_0"])
        for name, term in terms.items():
            total = total + values.get(name, 0.0) * term
        return total

    series = _series(data, columns, fit, model, "power", "W") if _has(fit, "P_0") else ()
    result = _table_fit("power", "power", "W", POWER, fit, series)
    return [result._replace(fixed={"C_D": fit.centre_current, "C_E": fit.centre_voltage})]


def _all(
    columns: Callable[[Experiment], tuple[Array, ...]], experiments: tuple[Experiment, ...]
) -> tuple[Array, ...]:
    """Columns of all experiments, one after the other."""
    return tuple(np.concatenate(parts) for parts in zip(*map(columns, experiments), strict=True))


def _has(fit: ServoModel, name: str) -> bool:
    return any(one.name == name for one in fit.estimates)


def _series(
    data: Cut,
    columns: Callable[[Experiment], tuple[Array, ...]],
    fit: ServoModel,
    model: Callable[..., Array],
    name: str,
    unit: str,
) -> tuple[FitSeries, ...]:
    """Measured and modeled response of every maneuver."""
    values = {one.name: one.value for one in fit.estimates}
    if not values:
        return ()
    pairs = [(one, False) for one in data.fitted] + [(one, True) for one in data.held_out]
    return tuple(
        FitSeries(
            one.name,
            name,
            unit,
            one.time,
            columns(one)[0],
            model(values, *columns(one)[1:]),
            held_out,
            independent=one.steady,
        )
        for one, held_out in pairs
    )


def _table_fit(
    subject: str, response: str, unit: str, equations: tuple[str, ...], fit: ServoModel, series: tuple[FitSeries, ...]
) -> EstimationResult:
    failure = "" if fit.estimates else fit.unidentified[0].reason
    notes = (Information(f"standard deviation of the residuals {fit.residual:.3g} {unit}"),)
    fitted = Fitted(
        f"{response} model of a servo", equations, fit.estimates, fit.unidentified, series=series, notes=notes
    )
    return from_fitted(fitted, subject, failure, subject=subject, samples=fit.samples)
