"""[torque_speed] and [twist] of a map: a servo's bounding line and a wing's twist, from records of a bench."""

from __future__ import annotations

from collections.abc import Mapping
from typing import NamedTuple

import numpy as np

from logs.identification.data.experiment import Experiment
from logs.identification.estimators.servo import ServoModel
from logs.identification.estimators.torque_speed import identify_torque_speed, turning
from logs.identification.estimators.twist import DAMPING, NATURAL, identify_twist, swing_of
from logs.identification.findings import Entry, Finding, register
from logs.identification.results import Array, EstimationResult, FitSeries, withheld_finding
from logs.identification.sources.table.maneuvers import Cut
from logs.identification.sources.table.quantities import Measure
from logs.identification.sources.table.signal_lookup import signal
from logs.pages.document import MEASURED, MODEL, POINTS, Chapter, Plot, Series
from wingbeat.errors import InputError

TORQUE_SPEED_EXAMPLE = """\
# The line that bounds a servo at full drive (Gerdes Fig. 9): wingbeat identify BENCH.csv --map THIS.toml torque_speed
# It takes 20 readings or more, from near the stall to near no load
[time]
rate = 1.0                   # Hz; any, where the rows are steady readings without a time; else column = "t"

[signals]
torque = { column = "torque", unit = "N m" }
speed = { column = "speed", unit = "deg/s" }
voltage = { column = "supply", unit = "V" }

[torque_speed]
torque = "torque"            # names of signals
speed = "speed"
voltage = "voltage"
nominal = 8.0                # V that the numbers are for; the mean of the voltage when not given
"""
TWIST_EXAMPLE = """\
# Natural frequency and damping of a wing's twist let go or stepped (Gerdes Eq. 16): one manoeuvre for each release
# wingbeat identify BENCH.csv --map THIS.toml twist
[time]
column = "t"

[signals]
twist = { column = "twist", unit = "deg" }           # of the tip, or its rate

[manoeuvres]
windows = [[0.0, 1.5], [2.0, 3.5]]                   # s; each is used from its greatest excursion on

[twist]
signal = "twist"             # name of a signal
"""
LINE = (
    "At full drive torque = stall_torque V / nominal - torque_speed_slope speed, both in the direction of the drive"
    " (Gerdes Fig. 9)",
    "no_load_speed = stall_torque / torque_speed_slope, at the nominal voltage",
)
RELEASE = (
    "twist = exp(-zeta omega t) (A cos(omega_d t) + B sin(omega_d t)) + rest, omega_d = omega sqrt(1 - zeta^2)"
    " (Gerdes Eq. 16)",
)


register({
    "nominal_voltage": Entry("the numbers are for {value:.4g} V", "Voltage of the torque-speed line."),
})  # fmt: skip


class TorqueSpeedSection(NamedTuple):
    """Section [torque_speed]."""

    torque: str = "torque"
    speed: str = "speed"
    voltage: str | None = None
    """one voltage all the time when not given: the nominal one"""
    nominal: Measure | None = None
    """V; the mean of the voltage when not given"""


class TwistSection(NamedTuple):
    """Section [twist]."""

    signal: str = "twist"


class _Bench(NamedTuple):
    """Torque N m, speed rad/s and voltage V, (N,) each."""

    torque: Array
    speed: Array
    voltage: Array


def torque_speed_fit(
    section: TorqueSpeedSection, maneuvers: Cut, constants: Mapping[str, float], fill: float | None
) -> list[EstimationResult]:
    """The line over all manoeuvres, and its torque in those that were held out.

    Raises:
        InputError: a signal is not there or in another unit, or too few samples have all three.
    """
    nominal = None if section.nominal is None else section.nominal.si("V", 0.0)
    if section.voltage is None and nominal is None:
        raise InputError("torque_speed needs voltage (a signal) or nominal (V)")
    parts = [_bench(section, one, nominal) for one in maneuvers.fitted]
    whole = _Bench(*(np.concatenate(column) for column in zip(*parts, strict=True)))
    volts = float(np.nanmean(whole.voltage)) if nominal is None else nominal
    model = identify_torque_speed(*whole, volts)
    held = [_bench(section, one, nominal) for one in maneuvers.held_out]
    series = [_line(one, part, model, volts, False) for one, part in zip(maneuvers.fitted, parts, strict=True)]
    series += [_line(one, part, model, volts, True) for one, part in zip(maneuvers.held_out, held, strict=True)]
    chapters = (_bounding(whole, model, volts),) if model.estimates else ()
    voltage = Finding("nominal_voltage", "info", "", volts)
    return [_result("torque_speed", "torque-speed line", LINE, model, tuple(series), chapters, (voltage,))]


def _bench(section: TorqueSpeedSection, one: Experiment, nominal: float | None) -> _Bench:
    torque = signal(one, section.torque, "N m", "torque_speed.torque")
    speed = signal(one, section.speed, "rad/s", "torque_speed.speed")
    if section.voltage is None:
        return _Bench(torque, speed, np.full(len(torque), nominal))
    return _Bench(torque, speed, signal(one, section.voltage, "V", "torque_speed.voltage"))


def _line(one: Experiment, bench: _Bench, model: ServoModel, volts: float, held_out: bool) -> FitSeries:
    """Torque as measured and by the line; nothing where there is none."""
    values = {maneuvers.name: maneuvers.value for maneuvers in model.estimates}
    told = np.full(len(bench.torque), np.nan)
    if values:
        way = turning(bench.torque, bench.speed)
        stall = values["stall_torque"] * bench.voltage / volts
        told = np.asarray(way * stall - values["torque_speed_slope"] * bench.speed, dtype=np.float64)
    return FitSeries(one.name, "torque", "N m", one.time, bench.torque, told, held_out)


def _bounding(bench: _Bench, model: ServoModel, volts: float) -> Chapter:
    """Torque at the nominal voltage over the speed."""
    values = {maneuvers.name: maneuvers.value for maneuvers in model.estimates}
    way = turning(bench.torque, bench.speed)
    nominal = bench.torque * way + values["stall_torque"] * (1.0 - bench.voltage / volts)
    across = np.array([0.0, values["no_load_speed"]])
    lines = (
        Series("measured, for the nominal voltage", bench.speed * way, nominal, MEASURED, POINTS),
        Series("bounding line", across, values["stall_torque"] - values["torque_speed_slope"] * across, MODEL),
    )
    return Chapter("Torque and speed", plots=(Plot("", "speed", "rad/s", "torque", "N m", lines),))


def twist_fits(
    section: TwistSection, maneuvers: Cut, constants: Mapping[str, float], fill: float | None
) -> list[EstimationResult]:
    """Each release for itself, and those held out with the mean of the others' constants.

    Raises:
        InputError: the signal is not there or is no angle or rate, or a release has too few samples.
    """
    for one in (*maneuvers.fitted, *maneuvers.held_out):
        signal(one, section.signal, None, "twist.signal")
        if one.units.get(section.signal) not in ("rad", "rad/s"):
            raise InputError(f"twist.signal: signals.{section.signal} is no angle and no rate")
    fits = []
    for one in maneuvers.fitted:
        model = identify_twist(one, section.signal)
        series = _swing(one, section.signal, model, held_out=False)
        fits.append(_result("twist", f"twist, {one.name}", RELEASE, model, series))
    known = [fit for fit in fits if fit.estimates]
    if known and maneuvers.held_out:
        mean = _mean(known)
        ahead = tuple(s for one in maneuvers.held_out for s in _swing(one, section.signal, mean, held_out=True))
        fits[fits.index(known[0])] = known[0]._replace(series=(*known[0].series, *ahead))
    return fits


def _mean(fits: list[EstimationResult]) -> ServoModel:
    """A model with the mean of natural frequency and damping."""
    means = tuple(
        one._replace(value=float(np.mean([fit.value(name) for fit in fits])))
        for name in (NATURAL, DAMPING)
        if (one := fits[0].estimate(name)) is not None
    )
    return ServoModel(means, (), 0.0, 0.0, 0.0, 0)


def _swing(one: Experiment, name: str, model: ServoModel, held_out: bool) -> tuple[FitSeries, ...]:
    """The release as measured and by Eq. 16, angle, rate and rest its own; nothing without constants."""
    values = {maneuvers.name: maneuvers.value for maneuvers in model.estimates}
    if not values:
        return ()
    swing = swing_of(one, name, values[NATURAL], values[DAMPING])
    return (FitSeries(one.name, name, one.units[name], swing.time, swing.measured, swing.model, held_out),)


def _result(
    subject: str,
    title: str,
    equations: str | tuple[str, ...],
    model: ServoModel,
    series: tuple[FitSeries, ...],
    chapters: tuple[Chapter, ...] = (),
    findings: tuple[Finding, ...] = (),
) -> EstimationResult:
    """The result of one model."""
    lost = [withheld_finding(one) for one in model.unidentified]
    if not model.estimates:
        lost.insert(0, lost[0]._replace(subject=""))
    return EstimationResult(
        subject, subject, "", (equations,) if isinstance(equations, str) else equations,
        "converged" if model.estimates else "not identifiable", model.estimates,
        series=series if model.estimates else (), samples=model.samples, findings=(*lost, *findings), title=title,
        chapters=chapters,
    )  # fmt: skip
