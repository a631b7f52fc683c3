"""Airspeed and pressure altitude from the raw counts of barometer and pitot.

The pitot sensor is a Honeywell HSC of +-1 inch of water (HSCMRRN001ND2A5, Gerdes et al. 2017 Table 1): 10 % of 2^14
counts at the lower end of its range, 90 % at the upper end. Its zero drifts by more than the dynamic pressure of slow
flight. It is therefore estimated on the ground, with a limit that excludes wind. Flapping modulates the flow along
the tube. The low-pass filter acts on the pressure instead of the speed, because the mean of a root is not the root of
the mean.

The residual error of the filter is estimated from its innovations (a reading minus the previous pressure). Their mean
square is the variance that the gate expects of the next innovation. After a second low-pass filter they measure the
lag of the pressure in gusts: the error of the filter in a random walk is a first-order process with the time constant
of the filter, and a second low-pass filter of that time constant passes half of its variance.
"""

from __future__ import annotations

from enum import IntEnum
from math import sqrt
from typing import Annotated, Final, NamedTuple

from avionics.messages import AirData, PressureSample
from wingbeat.atmosphere import GAS_CONSTANT, SEA_LEVEL_TEMPERATURE, pressure_altitude
from wingbeat.units import Quantity

LEAST_TEMPERATURE: Final = 180.0
"""K; lower limit of a valid temperature; below it the standard temperature is used"""
LONGEST_STEP: Final = 0.5
"""s; maximum interval between samples"""


START_SPREAD: Final = 4.0
"""-; initial mean square of the innovations, in multiples of the noise variance; larger than in gusts"""
LEFT_BY_SMOOTHING: Final = 0.5
"""-; fraction of the variance of a first-order process after a low-pass filter of its own time constant"""
ROOT_OF_NOISE: Final = 0.8
"""-; twice the mean of a rectified Gaussian noise, in standard deviations: 2 / sqrt(2 pi)"""


class Gate(IntEnum):
    """Innovation-gate mode for the pitot pressure."""

    OPEN = 0
    """no gate: on the ground, in the hand and during the throw"""
    WATCHED = 1
    """outliers are rejected, for `Gains.gate_timeout` at most"""
    SUSPECT = 2
    """outliers are rejected, for `Gains.gate_reset_time` at most, within which `airspeed_check` decides"""


class Gains(NamedTuple):
    """Transfer functions of the sensors and time constants of the filters."""

    static_scale: Annotated[float, Quantity("Pa", 1e-6, 1000.0)] = 0.01
    """Pa; static pressure per count"""
    temperature_scale: Annotated[float, Quantity("K", 1e-6, 10.0)] = 0.01
    """K; temperature per count"""
    differential_low: Annotated[float, Quantity("counts", 0.0, 1.7e7)] = 1638.0
    """counts; at the negative end of the range: 10 % of 2^14"""
    differential_high: Annotated[float, Quantity("counts", 1.0, 1.7e7)] = 14746.0
    """counts; at the positive end of the range: 90 % of 2^14"""
    differential_range: Annotated[float, Quantity("Pa", 1.0, 1e5)] = 248.84
    """Pa; range in each direction"""
    differential_zero: Annotated[float, Quantity("Pa", -100.0, 100.0)] = 0.0
    """Pa; pitot pressure at rest, from a calibration. Default: neutral until it is calibrated"""
    differential_scale: Annotated[float, Quantity("-", 0.3, 3.0)] = 1.0
    """-; scale factor of the pressure, from a calibration: the square of that of the airspeed. Default: neutral until
    it is calibrated"""
    zero_limit: Annotated[float, Quantity("Pa", 0.0, 50.0)] = 3.0
    """Pa; limit of the pitot zero estimated on the ground"""
    reference_time: Annotated[float, Quantity("s", 0.02, 60.0)] = 1.0
    """s; averaging time of the static pressure after boot"""
    zero_time: Annotated[float, Quantity("s", 0.02, 60.0)] = 2.0
    """s; time constant of the pitot zero on the ground; a plain mean before that"""
    pressure_time: Annotated[float, Quantity("s", 0.0, 5.0)] = 0.25
    """s; time constant of the dynamic pressure"""
    rate_time: Annotated[float, Quantity("s", 0.01, 5.0)] = 0.5
    """s; time constant of the airspeed rate"""
    pressure_noise: Annotated[float, Quantity("Pa", 0.01, 50.0)] = 1.9
    """Pa; one sigma of a pitot reading. Default, published: Gerdes Table 1, 0.2 m/s of airspeed, at 7.75 m/s"""
    zero_error: Annotated[float, Quantity("Pa", 0.0, 50.0)] = 1.0
    """Pa; one sigma of the zero; `zero_limit` if wind on the ground has moved the zero to that limit. Default: wind
    of 1.3 m/s along the tube before the launch, fitted to tests/sitl/test_sitl_consistency.py"""
    scale_error: Annotated[float, Quantity("-", 0.0, 0.5)] = 0.01
    """-; one sigma of the pressure scale, including flow across the tube. Default: flow at 0.1 rad across the tube;
    0.25 % for the sensor"""
    spread_time: Annotated[float, Quantity("s", 0.1, 600.0)] = 5.0
    """s; averaging time of the squared innovations. Default: 250 samples; typical duration of gusts"""
    gate: Annotated[float, Quantity("-", 1.0, 100.0)] = 5.0
    """-; innovation gate of the pitot in flight, in standard deviations"""
    gate_timeout: Annotated[float, Quantity("s", 0.0, 60.0, formerly="gate_patience")] = 1.5
    """s; duration of rejected readings after which the pitot is accepted again. Default: longer than the detection of
    a standstill"""
    gate_reset_time: Annotated[float, Quantity("s", 0.0, 60.0, formerly="doubt_patience")] = 4.5
    """s; gate timeout while the airspeed is inconsistent. Default: longer than airspeed_check.difference_time and the
    low-pass filter"""


class State(NamedTuple):
    """State of the air data filter."""

    time_us: int = -1
    """us; time of the last sample, -1 before the first"""
    reference: float = 0.0
    """Pa; static pressure at boot"""
    reference_span: float = 0.0
    """s; averaging time of the reference so far"""
    zero: float = 0.0
    """Pa; zero of the pitot"""
    zero_span: float = 0.0
    """s; averaging time of the zero so far"""
    dynamic_pressure: float = 0.0
    """Pa; filtered dynamic pressure"""
    airspeed: float = 0.0
    """m/s; low-passed airspeed, for its rate"""
    airspeed_rate: float = 0.0
    """m/s^2"""
    ungated: float = 0.0
    """Pa; dynamic pressure filtered without the gate"""
    spread: float = -1.0
    """Pa^2; mean square of the innovations, negative before the first sample"""
    lag: float = 0.0
    """Pa; low-passed innovations"""
    lag_spread: float = 0.0
    """Pa^2; mean square of the low-passed innovations"""
    refused: float = 0.0
    """s; time since a reading was last accepted"""
    behind: int = 0
    """-; 1 while accepted readings are beyond the gate"""


def step(
    gains: Gains, state: State, sample: PressureSample, on_ground: bool, gate: Gate = Gate.OPEN
) -> tuple[State, AirData]:
    """Update the air data with one sample.

    Args:
        gains: calibration and time constants.
        state: result of the last step, ``State()`` at boot.
        sample: raw counts; the filters do not advance unless it is later than the last one.
        on_ground: True before the launch: the zero of the pitot is estimated.
        gate: innovation-gate mode of the pitot.
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
    """Return the airspeed (m/s) without the gate in air of ``density`` (kg/m^3)."""
    return _speed(state.ungated, density)


def calibrated(gains: Gains, counts: int) -> float:
    """Return the differential pressure (Pa) of the counts with the calibration.

    The zero of the ground is not subtracted.
    """
    return (differential(gains, counts) - gains.differential_zero) * gains.differential_scale


def differential(gains: Gains, counts: int) -> float:
    """Return the differential pressure (Pa) of the counts without zero and scale.

    The range is 10 to 90 % of the counts (Honeywell HSC data sheet, transfer function A).
    """
    share = (counts - gains.differential_low) / (gains.differential_high - gains.differential_low)
    return (2.0 * share - 1.0) * gains.differential_range


def _reference(gains: Gains, state: State, static: float, dt: float) -> tuple[float, float]:
    """Return the static pressure at boot and its averaging time.

    The pressure is the mean of the samples since boot, constant after the reference time.
    """
    if state.time_us < 0:
        return static, 0.0
    if state.reference_span >= gains.reference_time or dt == 0.0:
        return state.reference, state.reference_span
    span = state.reference_span + dt
    # The first sample also represents one interval.
    return state.reference + (static - state.reference) * dt / (span + dt), span


def _zero(gains: Gains, state: State, raw: float, dt: float) -> tuple[float, float]:
    """Return the limited pitot zero: a mean at first, a low-pass filter later."""
    if state.time_us < 0:
        zero, span = raw, 0.0
    else:
        span = min(state.zero_span + dt, gains.zero_time)
        zero = state.zero + (raw - state.zero) * dt / (span + dt) if dt > 0.0 else state.zero
    return max(-gains.zero_limit, min(gains.zero_limit, zero)), span


Filtered = tuple[float, float, float, float, float, int]


def _pressure(gains: Gains, state: State, reading: float, dt: float, gate: Gate) -> tuple[float, float, Filtered]:
    """Return the gated dynamic pressure (Pa), its innovation and the filter states."""
    if state.time_us < 0:
        return reading, 0.0, (reading, START_SPREAD * gains.pressure_noise**2, 0.0, 0.0, 0.0, 0)
    follow = _follow(state.ungated, reading, dt, gains.pressure_time, False)
    innovation = reading - state.dynamic_pressure
    kept = (follow, state.spread, state.lag, state.lag_spread)
    if dt == 0.0:
        return state.dynamic_pressure, innovation, (*kept, state.refused, state.behind)
    beyond = innovation * innovation > gains.gate**2 * _expected(gains, state)
    pressure = _follow(state.dynamic_pressure, reading, dt, gains.pressure_time, False)
    # At the launch the filter lags behind readings that were accepted during the throw by more than the gate. They
    # widen the gate, so that one is soon within it.
    if gate and beyond and not state.behind:
        refused = state.refused + dt
        if refused <= (gains.gate_timeout if gate == Gate.WATCHED else gains.gate_reset_time):
            return state.dynamic_pressure, innovation, (*kept, refused, 0)
        # Gate timeout: reset to the ungated pressure.
        pressure = follow
    spread = _follow(state.spread, innovation * innovation, dt, gains.spread_time, False)
    lag = _follow(state.lag, innovation, dt, gains.pressure_time, False)
    lag_spread = _follow(state.lag_spread, lag * lag, dt, gains.spread_time, False)
    return pressure, innovation, (follow, spread, lag, lag_spread, 0.0, int(beyond))


def _expected(gains: Gains, state: State) -> float:
    """Return the expected variance (Pa^2) of the next innovation.

    The minimum is the noise variance of the sensor.
    """
    return max(state.spread, gains.pressure_noise**2)


def _variance(gains: Gains, state: State, airspeed: float, density: float) -> float:
    """Return the variance (m^2/s^2) of V = sqrt(2 q / rho) from that of q.

    The relation is dV = dq / (rho V). Without flow V is the root of the noise, with the mean square 0.8 sigma / rho.
    """
    if density <= 0.0:
        return 0.0
    lag = state.lag_spread / LEFT_BY_SMOOTHING
    # While readings are rejected the pressure is constant and its error grows with time.
    lag *= 1.0 + 2.0 * state.refused / gains.pressure_time if state.refused and gains.pressure_time else 1.0
    # At the limit the zero contains wind, in addition to the error of the sensor.
    moved = gains.zero_limit if abs(state.zero) >= gains.zero_limit else 0.0
    scale = gains.scale_error * state.dynamic_pressure
    pressure = lag + moved * moved + gains.zero_error**2 + scale * scale
    return pressure / (density * max(density * airspeed * airspeed, sqrt(pressure) / ROOT_OF_NOISE, 1e-9))


def _speed(pressure: float, density: float) -> float:
    """Return the true airspeed (m/s) of a dynamic pressure (Pa).

    ``density`` is in kg/m^3.
    """
    return sqrt(max(0.0, 2.0 * pressure / density)) if density > 0.0 else 0.0


def _follow(last: float, value: float, dt: float, time: float, first: bool) -> float:
    """Return a first-order low-pass that starts at its first value."""
    return value if first else last + (value - last) * dt / (time + dt if dt > 0.0 else 1.0)
