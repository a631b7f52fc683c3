"""Airspeed and pressure altitude from the raw counts of barometer and pitot.

The pitot is a Honeywell HSC of +-1 inch of water (HSCMRRN001ND2A5, Gerdes et al. 2017 Table 1): 10 % of 2^14 counts
at the lower end of its range, 90 % at the upper. Its zero wanders by more than the dynamic pressure of slow flight,
so it is learned on the ground, within a limit that keeps a breeze from becoming a zero. Flapping shakes the flow
along the tube: the pressure, not the speed, is low-passed, since the mean of a root is not the root of the mean.

What the low-pass leaves is measured from its innovations (a reading less the pressure before it). Their mean square
is the variance that the gate expects of the next one. Smoothed once more they tell how far the pressure lags behind
gusts: the low-pass lags behind a random walk by a first-order process of its own time constant, of whose variance a
second low-pass of that time constant leaves half.
"""

from __future__ import annotations

from enum import IntEnum
from math import sqrt
from typing import Annotated, NamedTuple

from avionics.messages import AirData, PressureSample
from wingbeat.atmosphere import GAS_CONSTANT, SEA_LEVEL_TEMPERATURE, pressure_altitude
from wingbeat.units import Quantity

LEAST_TEMPERATURE = 180.0
"""K; a thermometer that tells less is broken, and the standard's temperature is taken"""
LONGEST_STEP = 0.5
"""s; between samples"""


START_SPREAD = 4.0
"""-; mean square of the innovations at boot, in squares of the noise: more than gusts make"""
LEFT_BY_SMOOTHING = 0.5
"""-; of the variance of a first-order process, by a low-pass of its own time constant"""
ROOT_OF_NOISE = 0.8
"""-; mean of the greater of noise and nothing, doubled, in its standard deviations: 2 / sqrt(2 pi)"""


class Gate(IntEnum):
    """How readings of the pitot are taken in."""

    OPEN = 0
    """every one: on the ground, in the hand and in the throw"""
    WATCHED = 1
    """one that departs is refused, for `Gains.gate_timeout` at most"""
    SUSPECT = 2
    """the same for `Gains.gate_reset_time` at most, within which `airspeed_check` decides"""


class Gains(NamedTuple):
    """Transfer functions of the sensors and filter times."""

    static_scale: Annotated[float, Quantity("Pa", 1e-6, 1000.0)] = 0.01
    """Pa; of one count of static pressure"""
    temperature_scale: Annotated[float, Quantity("K", 1e-6, 10.0)] = 0.01
    """K; of one count of temperature"""
    differential_low: Annotated[float, Quantity("counts", 0.0, 1.7e7)] = 1638.0
    """counts; at minus the range: 10 % of 2^14"""
    differential_high: Annotated[float, Quantity("counts", 1.0, 1.7e7)] = 14746.0
    """counts; at plus the range: 90 % of 2^14"""
    differential_range: Annotated[float, Quantity("Pa", 1.0, 1e5)] = 248.84
    """Pa; either way"""
    differential_zero: Annotated[float, Quantity("Pa", -100.0, 100.0)] = 0.0
    """Pa; reading of the pitot at rest, from a calibration. Default: neutral until it is calibrated"""
    differential_scale: Annotated[float, Quantity("-", 0.3, 3.0)] = 1.0
    """-; of the pressure, from a calibration: the square of the airspeed's. Default: neutral until it is
    calibrated"""
    zero_limit: Annotated[float, Quantity("Pa", 0.0, 50.0)] = 3.0
    """Pa; largest zero of the pitot that is learned on the ground"""
    reference_time: Annotated[float, Quantity("s", 0.02, 60.0)] = 1.0
    """s; after boot, over which the static pressure at boot is averaged"""
    zero_time: Annotated[float, Quantity("s", 0.02, 60.0)] = 2.0
    """s; time constant with which the pitot's zero is followed on the ground, a plain mean before that"""
    pressure_time: Annotated[float, Quantity("s", 0.0, 5.0)] = 0.25
    """s; time constant of the dynamic pressure"""
    rate_time: Annotated[float, Quantity("s", 0.01, 5.0)] = 0.5
    """s; time constant of the airspeed's rate"""
    pressure_noise: Annotated[float, Quantity("Pa", 0.01, 50.0)] = 1.9
    """Pa; one sigma of a reading of the pitot. Default, published: Gerdes Table 1, 0.2 m/s of airspeed, at 7.75
    m/s"""
    zero_error: Annotated[float, Quantity("Pa", 0.0, 50.0)] = 1.0
    """Pa; one sigma of the zero, `zero_limit` where a breeze on the ground has brought it there. Default: a breeze
    of 1.3 m/s along the tube before the launch, fitted to tests/sitl/test_sitl_consistency.py"""
    scale_error: Annotated[float, Quantity("-", 0.0, 0.5)] = 0.01
    """-; one sigma of the scale of the pressure, flow across the tube included. Default: flow at 0.1 rad across the
    tube; the sensor's own is 0.25 %"""
    spread_time: Annotated[float, Quantity("s", 0.1, 600.0)] = 5.0
    """s; over which the innovations' mean square is taken. Default: 250 samples; gusts grow and die in that time"""
    gate: Annotated[float, Quantity("-", 1.0, 100.0)] = 5.0
    """-; innovations of the pitot beyond this many sigma are refused in the air"""
    gate_timeout: Annotated[float, Quantity("s", 0.0, 60.0, formerly="gate_patience")] = 1.5
    """s; of refused readings after which the pitot is believed again. Default: longer than a standstill takes to be
    found"""
    gate_reset_time: Annotated[float, Quantity("s", 0.0, 60.0, formerly="doubt_patience")] = 4.5
    """s; the same while its airspeed is not the expected one. Default: longer than airspeed_check.difference_time
    and the low-pass"""


class State(NamedTuple):
    """What the measurement remembers."""

    time_us: int = -1
    """us; of the last sample, -1 before the first"""
    reference: float = 0.0
    """Pa; static pressure at boot"""
    reference_span: float = 0.0
    """s; over which it has been averaged"""
    zero: float = 0.0
    """Pa; of the pitot"""
    zero_span: float = 0.0
    """s; over which it has been averaged"""
    dynamic_pressure: float = 0.0
    """Pa; filtered"""
    airspeed: float = 0.0
    """m/s; filtered once more, for its rate"""
    airspeed_rate: float = 0.0
    """m/s^2"""
    ungated: float = 0.0
    """Pa; filtered without the gate"""
    spread: float = -1.0
    """Pa^2; mean square of the innovations, negative before the first sample"""
    lag: float = 0.0
    """Pa; innovations smoothed"""
    lag_spread: float = 0.0
    """Pa^2; mean square of that"""
    refused: float = 0.0
    """s; since a reading was last accepted"""


def step(
    gains: Gains, state: State, sample: PressureSample, on_ground: bool, gate: Gate = Gate.OPEN
) -> tuple[State, AirData]:
    """One sample on.

    Args:
        gains: calibration and filter times.
        state: what the last step returned, ``State()`` at boot.
        sample: raw counts; one that is not later than the last moves no filter.
        on_ground: true before the launch: the zero of the pitot is learned.
        gate: how its readings are taken in.
    """
    static = sample.static_counts * gains.static_scale
    kelvin = sample.temperature_counts * gains.temperature_scale
    temperature = kelvin if kelvin > LEAST_TEMPERATURE else SEA_LEVEL_TEMPERATURE
    dt = 0.0 if state.time_us < 0 else max(0.0, min(LONGEST_STEP, (sample.time_us - state.time_us) * 1e-6))
    first = state.time_us < 0
    reference, reference_span = _reference(gains, state, static, dt)
    raw = calibrated(gains, sample.differential_counts)
    zero, zero_span = _zero(gains, state, raw, dt) if on_ground else (state.zero, state.zero_span)
    pressure, innovation, filtered = _pressure(gains, state, raw - zero, dt, gate)
    density = static / (GAS_CONSTANT * temperature)
    airspeed = _speed(pressure, density)
    slow = _follow(state.airspeed, airspeed, dt, gains.rate_time, first)
    rate = (airspeed - slow) / gains.rate_time
    time_us = max(state.time_us, sample.time_us)
    expected = _expected(gains, state)
    state = State(time_us, reference, reference_span, zero, zero_span, pressure, slow, rate, *filtered)
    altitude = pressure_altitude(static) - pressure_altitude(reference)
    variance = _variance(gains, state, airspeed, density)
    measured = (time_us, airspeed, rate, pressure, static, temperature, density, altitude)
    return state, AirData(*measured, variance, innovation, expected)


def ungated(state: State, density: float) -> float:
    """Airspeed (m/s) that the pitot tells, whatever the gate refused, in air of a density (kg/m^3)."""
    return _speed(state.ungated, density)


def calibrated(gains: Gains, counts: int) -> float:
    """Differential pressure (Pa) of the counts by the calibration, before the zero of the ground is subtracted."""
    return (differential(gains, counts) - gains.differential_zero) * gains.differential_scale


def differential(gains: Gains, counts: int) -> float:
    """Pa of the counts, without zero and scale: 10 to 90 % (Honeywell HSC data sheet, transfer function A)."""
    share = (counts - gains.differential_low) / (gains.differential_high - gains.differential_low)
    return (2.0 * share - 1.0) * gains.differential_range


def _reference(gains: Gains, state: State, static: float, dt: float) -> tuple[float, float]:
    """Static pressure at boot: the mean of the samples since then, fixed after the reference time."""
    if state.time_us < 0:
        return static, 0.0
    if state.reference_span >= gains.reference_time or dt == 0.0:
        return state.reference, state.reference_span
    span = state.reference_span + dt
    # The first sample stands for one interval as well.
    return state.reference + (static - state.reference) * dt / (span + dt), span


def _zero(gains: Gains, state: State, raw: float, dt: float) -> tuple[float, float]:
    """Zero of the pitot: a mean at first, a low-pass later, limited."""
    if state.time_us < 0:
        zero, span = raw, 0.0
    else:
        span = min(state.zero_span + dt, gains.zero_time)
        zero = state.zero + (raw - state.zero) * dt / (span + dt) if dt > 0.0 else state.zero
    return max(-gains.zero_limit, min(gains.zero_limit, zero)), span


Filtered = tuple[float, float, float, float, float]


def _pressure(gains: Gains, state: State, reading: float, dt: float, gate: Gate) -> tuple[float, float, Filtered]:
    """Dynamic pressure behind the gate (Pa), the innovation (Pa), and what the State remembers of both."""
    if state.time_us < 0:
        return reading, 0.0, (reading, START_SPREAD * gains.pressure_noise**2, 0.0, 0.0, 0.0)
    follow = _follow(state.ungated, reading, dt, gains.pressure_time, False)
    innovation = reading - state.dynamic_pressure
    if dt == 0.0:
        return state.dynamic_pressure, innovation, (follow, state.spread, state.lag, state.lag_spread, state.refused)
    if gate and innovation * innovation > gains.gate**2 * _expected(gains, state):
        refused = state.refused + dt
        if refused <= (gains.gate_timeout if gate == Gate.WATCHED else gains.gate_reset_time):
            return state.dynamic_pressure, innovation, (follow, state.spread, state.lag, state.lag_spread, refused)
        # Believed again: then it is the pressure that must be doubted.
        pressure = follow
    else:
        pressure = _follow(state.dynamic_pressure, reading, dt, gains.pressure_time, False)
    spread = _follow(state.spread, innovation * innovation, dt, gains.spread_time, False)
    lag = _follow(state.lag, innovation, dt, gains.pressure_time, False)
    lag_spread = _follow(state.lag_spread, lag * lag, dt, gains.spread_time, False)
    return pressure, innovation, (follow, spread, lag, lag_spread, 0.0)


def _expected(gains: Gains, state: State) -> float:
    """Variance (Pa^2) of the next innovation: what was measured, at least that of the sensor's noise."""
    return max(state.spread, gains.pressure_noise**2)


def _variance(gains: Gains, state: State, airspeed: float, density: float) -> float:
    """Variance (m^2/s^2) of V = sqrt(2 q / rho), from that of q: dV = dq / (rho V).

    Where nothing flows V is the root of the noise, whose mean square is 0.8 sigma / rho.
    """
    if density <= 0.0:
        return 0.0
    lag = state.lag_spread / LEFT_BY_SMOOTHING
    # Refused, the pressure stands still, and what it follows walks on as it did.
    lag *= 1.0 + 2.0 * state.refused / gains.pressure_time if state.refused and gains.pressure_time else 1.0
    zero = gains.zero_limit if abs(state.zero) >= gains.zero_limit else gains.zero_error
    scale = gains.scale_error * state.dynamic_pressure
    pressure = lag + zero * zero + scale * scale
    return pressure / (density * max(density * airspeed * airspeed, sqrt(pressure) / ROOT_OF_NOISE, 1e-9))


def _speed(pressure: float, density: float) -> float:
    """True airspeed (m/s) of a dynamic pressure (Pa) in air of a density (kg/m^3)."""
    return sqrt(max(0.0, 2.0 * pressure / density)) if density > 0.0 else 0.0


def _follow(last: float, value: float, dt: float, time: float, first: bool) -> float:
    """First-order low-pass that starts at its first value."""
    return value if first else last + (value - last) * dt / (time + dt if dt > 0.0 else 1.0)
