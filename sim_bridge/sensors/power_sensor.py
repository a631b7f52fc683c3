"""Supply voltage and current: divider and ACS723 into the ten-bit ADC of an ATMEGA328P, in bursts at 6 kHz.

The servos modulate the current at 300 Hz (Gerdes p. 3). The plant gives the mean over the modulation; the burst
puts the pulses back: with duty = current / pulse_current the current is the pulse's while it is on and nothing
while it is off, and the voltage sags with it. The phase of the modulation runs on from burst to burst.

The edges of the pulses last ``edge`` seconds (the motor's inductance). An edge as long as the spacing of the
samples makes the mean of the sampled current exact: the sampled trapezoid is then the mean of a sharp pulse over
each sample's own interval, whatever the phase.

The commutation of the motor ripples the current at several kilohertz. A sample takes it at a random phase: noise in
proportion to the current, in quadrature with that of the sensor, and over the resistance in the voltage.
"""

from __future__ import annotations

import math
import struct
from functools import cached_property
from typing import Annotated, NamedTuple

import numpy as np

from sim_bridge import observation as o
from sim_bridge.compiled import Bound, bound_values, exact, exact_inlined
from sim_bridge.observation import Observation
from sim_bridge.sensors.noise import NormalRows, SensorSeed, split
from sim_bridge.vectors import Floats, Integers
from wingbeat.samples import BURST_LENGTH
from wingbeat.units import Quantity

SAMPLE_RATE = 6000.0
"""Hz; of the ADC: three periods of 300 Hz in sixty samples"""
_CHANNEL = struct.Struct(f"<{BURST_LENGTH}q")


class PowerSensorSpec(NamedTuple):
    """ATMEGA328P ADC (Gerdes Table 1: 0 to 5 V, 4.9 mV) with ACS723LLCTR-10AB (+-10 A, 20 mA) and a divider.

    The ACS723 gives half its supply, 2.5 V, at no current and 200 mV/A (Allegro data sheet, -10AB); its output
    is linear within 0.5 V of the rails, which is the +-10 A. Two lithium cells need a divider before a 5 V ADC.
    """

    reference: Annotated[float, Quantity("V", 0.5, 200.0)]
    """full scale of the ADC"""
    bits: Annotated[int, Quantity("-", 6, 16)]
    """of the ADC"""
    divider: Annotated[float, Quantity("-", 0.001, 1.0)]
    """of the supply voltage that reaches the ADC"""
    voltage_noise: Annotated[float, Quantity("V", 0.0, 1.0)]
    """standard deviation of one sample, at the ADC"""
    current_zero: Annotated[float, Quantity("V", 0.0, 200.0)]
    """of the current sensor's output without current"""
    current_sensitivity: Annotated[float, Quantity("V/A", 1e-4, 10.0)]
    """of the current sensor's output"""
    current_range: Annotated[float, Quantity("A", 0.01, 1000.0)]
    """either way, where its output saturates"""
    current_noise: Annotated[float, Quantity("A", 0.0, 10.0)]
    """standard deviation of one sample"""
    divider_sigma: Annotated[float, Quantity("-", 0.0, 0.2)]
    """of the units' relative errors of the divider"""
    current_zero_sigma: Annotated[float, Quantity("A", 0.0, 5.0)]
    """of the units' residual zero offsets"""
    current_scale_sigma: Annotated[float, Quantity("-", 0.0, 0.2)]
    """of the units' relative errors of the sensitivity"""
    edge: Annotated[float, Quantity("s", 0.0, 0.01)]
    """duration of a rising or falling edge of the current; 0 for sharp"""


class PowerSensorErrors(NamedTuple):
    """Constant errors of one unit."""

    divider: float
    """-"""
    current_zero: float
    """A"""
    current_scale: float
    """-"""


class Supply(NamedTuple):
    """Supply voltage and current during one burst."""

    duty: float
    """-; share of the time the current is on, 1 for a smooth current"""
    amplitude: float
    """A; while it is on"""
    open_circuit_voltage: float
    """V"""
    resistance: float
    """ohm"""


class Channels(NamedTuple):
    """Conversion of volts and amperes to counts."""

    voltage_gain: float
    """counts/V"""
    voltage_noise: float
    """counts"""
    current_zero: float
    """counts"""
    current_gain: float
    """counts/A"""
    current_noise: float
    """counts"""
    current_lowest: float
    """counts; where the current sensor saturates"""
    current_highest: float
    """counts; where the current sensor saturates"""
    full_scale: float
    """counts; of the ADC"""


class Burst(NamedTuple):
    """Workspace of the kernel."""

    channels: Channels
    edge: float
    """s; duration of an edge"""
    normals: Floats
    """(bursts, 2 n); standard normal numbers drawn ahead"""
    counts: Integers
    """(2, n) out; n samples of voltage and of current"""
    ripple: Floats
    """(1,) -; standard deviation of the current by commutation, over the current; the caller may write to it"""
    phase: Floats
    """(1,) periods; of the modulation at the last sample"""
    time_us: Integers
    """(1,); of the last burst, negative before the first"""


class PowerSensor:
    """One unit; `read` once per burst."""

    def __init__(self, spec: PowerSensorSpec, seed: SensorSeed) -> None:
        unit, flight = split(seed)
        a, b, c = unit.standard_normal(3).tolist()
        self.errors = PowerSensorErrors(
            spec.divider_sigma * a, spec.current_zero_sigma * b, spec.current_scale_sigma * c
        )
        self.normals = NormalRows(flight, 2 * BURST_LENGTH)
        self.burst = Burst(
            _channels(spec, self.errors),
            spec.edge,
            self.normals.rows,
            np.zeros((2, BURST_LENGTH), dtype=np.int64),
            np.zeros(1),
            np.zeros(1),
            np.full(1, -1),
        )
        """arguments of `sample_burst`"""

    def read(self, observation: Observation) -> tuple[tuple[int, ...], tuple[int, ...]]:
        """Sixty counts of voltage and of current; the last sample is taken at the observation's time."""
        array = np.zeros(o.SIZE)
        observation.fill(array)
        sample_alone(observation.time_us, array, self.normals.next_row(), self._bound)
        return self.counts()

    def counts(self) -> tuple[tuple[int, ...], tuple[int, ...]]:
        """Return the counts of the last burst."""
        counts = self.burst.counts.data
        return _CHANNEL.unpack_from(counts, 0), _CHANNEL.unpack_from(counts, _CHANNEL.size)

    @cached_property
    def _bound(self) -> Bound:
        return Bound(self.burst)


@exact
def supply(observed: Floats) -> Supply:
    """Duty and amplitude of the current; a mean that no pulse gives (or a frequency of 0) is smooth.

    ``observed`` (`observation.SIZE`,) is an observation.
    """
    current, pulsed = observed[o.CURRENT], observed[o.PULSE_CURRENT]
    voltage, resistance = observed[o.OPEN_CIRCUIT_VOLTAGE], observed[o.BATTERY_RESISTANCE]
    if observed[o.PWM_FREQUENCY] > 0.0 and 0.0 < current < pulsed:
        return Supply(current / pulsed, pulsed, voltage, resistance)
    return Supply(1.0, current, voltage, resistance)


def _channels(spec: PowerSensorSpec, errors: PowerSensorErrors) -> Channels:
    per_volt = (1 << spec.bits) / spec.reference
    swing = spec.current_range * spec.current_sensitivity
    sensitivity = spec.current_sensitivity * (1.0 + errors.current_scale)
    return Channels(
        voltage_gain=per_volt * spec.divider * (1.0 + errors.divider),
        voltage_noise=per_volt * spec.voltage_noise,
        current_zero=per_volt * (spec.current_zero + spec.current_sensitivity * errors.current_zero),
        current_gain=per_volt * sensitivity,
        current_noise=per_volt * spec.current_sensitivity * spec.current_noise,
        current_lowest=per_volt * (spec.current_zero - swing),
        current_highest=per_volt * (spec.current_zero + swing),
        full_scale=(1 << spec.bits) - 1.0,
    )


@exact_inlined
def time_on(turns: float, duty: float) -> float:
    """On time in periods of a sharp pulse of ``duty`` from phase 0 to ``turns``."""
    whole = math.floor(turns)
    return whole * duty + min(turns - whole, duty)


@exact_inlined
def pulse(phase: float, duty: float, edge: float) -> float:
    """Value, 0 to 1, of a periodic pulse of mean ``duty`` with edges of ``edge`` periods."""
    if edge > 0.0:
        return (time_on(phase + 0.5 * edge, duty) - time_on(phase - 0.5 * edge, duty)) / edge
    return 1.0 if phase - math.floor(phase) < duty else 0.0


def mean_square(duty: float, edge: float) -> float:
    """Mean over a period of the square of `pulse`; ``duty`` and ``edge`` (at most a half) in periods."""
    short = min(duty, 1.0 - duty)
    if short < edge:
        peaks = short * short / edge * (1.0 - short / (3.0 * edge))
        return peaks if duty < 0.5 else 1.0 - 2.0 * short + peaks
    return duty - edge / 3.0


@exact_inlined
def _added(noise: float, other: float) -> float:
    """Increase of a standard deviation by an independent noise."""
    return math.hypot(noise, other) - noise


@exact
def sample_alone(time_us: int, observed: Floats, at: int, bound: Bound) -> None:
    """`sample_burst` of one sensor alone."""
    sample_burst(time_us, observed, at, bound_values(bound))


@exact_inlined
def sample_burst(time_us: int, observed: Floats, at: int, burst: Burst) -> None:
    """Fill the counts with the row ``at`` of the noise; the last sample is taken at ``time_us``."""
    frequency = observed[o.PWM_FREQUENCY]
    if burst.time_us[0] >= 0:
        elapsed = (time_us - burst.time_us[0]) * 1e-6
        turns = burst.phase[0] + frequency * elapsed
        burst.phase[0] = turns - math.floor(turns)
    burst.time_us[0] = time_us
    duty, amplitude, voltage, resistance = supply(observed)
    counts, channels, normals, phase = burst.counts, burst.channels, burst.normals[at], burst.phase[0]
    step, edge, n = frequency / SAMPLE_RATE, frequency * burst.edge, burst.counts.shape[1]
    ripple = burst.ripple[0] * amplitude
    # While the current is on; a square root for each sample would double the time that a burst takes.
    added_volts = _added(channels.voltage_noise, channels.voltage_gain * resistance * ripple)
    added_amperes = _added(channels.current_noise, channels.current_gain * ripple)
    for i in range(n):
        height = pulse(phase - (n - 1 - i) * step, duty, edge)
        amperes = height * amplitude
        volts = voltage - resistance * amperes
        raw = volts * channels.voltage_gain + (channels.voltage_noise + height * added_volts) * normals[i]
        counts[0, i] = round(min(max(raw, 0.0), channels.full_scale))
        noise = channels.current_noise + height * added_amperes
        raw = channels.current_zero + amperes * channels.current_gain + noise * normals[n + i]
        raw = min(max(raw, channels.current_lowest), channels.current_highest)
        counts[1, i] = round(min(max(raw, 0.0), channels.full_scale))
