"""Supply voltage, current and power of the wing drives from bursts of ADC counts.

The servos modulate their current at 300 Hz (Gerdes et al. 2017, instrumentation suite), and the supply sags with
every pulse: voltage and current are anticorrelated, so the mean power is the mean of the product, taken over
whole periods of the modulation. The sums are of whole numbers and exact; the calibration is applied to the sums.
"""

from __future__ import annotations

from operator import mul
from typing import Annotated, NamedTuple

from avionics.messages import AdcBurst, PowerState
from avionics.quantities import Quantity

LONGEST_GAP = 1.0
"""s; between bursts, over which the last power is held when it is integrated"""


class Gains(NamedTuple):
    """Calibration of the ADC (ATMEGA328P), divider, current sensor (ACS723) and battery."""

    reference: Annotated[float, Quantity("V", 0.5, 10.0)] = 5.0
    """V; full scale of the ADC"""
    full_scale: Annotated[float, Quantity("counts", 256.0, 65536.0)] = 1024.0
    """counts; at the reference: 2^10"""
    divider: Annotated[float, Quantity("-", 0.001, 1.0)] = 0.5
    """-; share of the supply voltage that reaches the ADC"""
    voltage_offset: Annotated[float, Quantity("V", -5.0, 5.0)] = 0.0
    """V; added to the supply voltage"""
    current_zero: Annotated[float, Quantity("V", 0.0, 10.0)] = 2.5
    """V; output of the current sensor without current"""
    current_sensitivity: Annotated[float, Quantity("V/A", 0.001, 10.0)] = 0.2
    """V/A; of the current sensor (ACS723, +-10 A: 200 mV/A)"""
    sample_rate: Annotated[float, Quantity("Hz", 100.0, 100000.0)] = 6000.0
    """Hz; of the ADC within a burst"""
    pwm_frequency: Annotated[float, Quantity("Hz", 0.0, 50000.0)] = 300.0
    """Hz; of the current modulation, 0 for a smooth current"""
    capacity: Annotated[float, Quantity("C", 10.0, 1e6)] = 2664.0
    """C; of the battery (740 mA h)"""


class State(NamedTuple):
    """What the integration remembers."""

    time_us: int = -1
    """us; of the last burst, -1 before the first"""
    charge: float = 0.0
    """C; drawn since boot"""
    energy: float = 0.0
    """J; drawn since boot"""
    strokes: int = 0
    """-; full strokes at the last burst"""
    energy_at_stroke: float = 0.0
    """J; drawn when the present stroke began"""
    energy_per_stroke: float = 0.0
    """J; of the last full stroke"""


class Averages(NamedTuple):
    """Means over the whole PWM periods of a burst."""

    voltage: float
    """V"""
    current: float
    """A"""
    power: float
    """W; of the product"""


def whole_periods(gains: Gains, samples: int) -> int:
    """How many of the last ``samples`` span the largest whole number of PWM periods (all when none fits)."""
    if gains.pwm_frequency <= 0.0:
        return samples
    samples_per_period = gains.sample_rate / gains.pwm_frequency
    periods = int(samples / samples_per_period + 1e-9)
    return round(periods * samples_per_period) if periods > 0 else samples


def averages(gains: Gains, burst: AdcBurst) -> Averages:
    """Mean voltage, current and power of a burst; its two tuples have the same length, at least 1."""
    count = whole_periods(gains, len(burst.voltage_counts))
    voltages, currents = burst.voltage_counts[-count:], burst.current_counts[-count:]
    voltage_mean = sum(voltages) / count
    current_mean = sum(currents) / count
    product_mean = sum(map(mul, voltages, currents)) / count
    lsb = gains.reference / gains.full_scale
    a, b = lsb / gains.divider, gains.voltage_offset
    c, d = lsb / gains.current_sensitivity, -gains.current_zero / gains.current_sensitivity
    power = a * c * product_mean + a * d * voltage_mean + b * c * current_mean + b * d
    return Averages(a * voltage_mean + b, c * current_mean + d, power)


def step(gains: Gains, state: State, burst: AdcBurst, strokes: int = 0) -> tuple[State, PowerState]:
    """One burst on.

    Args:
        gains: calibration.
        state: what the last step returned, ``State()`` at boot.
        burst: samples; one that is not later than the last moves no integral.
        strokes: full strokes since boot, from the wing state.
    """
    voltage, current, power = averages(gains, burst)
    dt = _interval(gains, state, burst)
    charge = state.charge + current * dt
    energy = state.energy + power * dt
    at_stroke, per_stroke = state.energy_at_stroke, state.energy_per_stroke
    if strokes > state.strokes:
        per_stroke = (energy - at_stroke) / (strokes - state.strokes)
    if strokes != state.strokes:
        at_stroke = energy
    time_us = max(state.time_us, burst.time_us)
    remaining = max(0.0, min(1.0, 1.0 - charge / gains.capacity))
    state = State(time_us, charge, energy, strokes, at_stroke, per_stroke)
    return state, PowerState(burst.time_us, voltage, current, power, charge, energy, per_stroke, remaining)


def _interval(gains: Gains, state: State, burst: AdcBurst) -> float:
    """Seconds for which the burst stands: since the last one, or its own length at boot."""
    if state.time_us < 0:
        return len(burst.voltage_counts) / gains.sample_rate
    return max(0.0, min(LONGEST_GAP, (burst.time_us - state.time_us) * 1e-6))
