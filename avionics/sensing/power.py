"""Drive power from bursts of ADC counts, and state of charge of the battery.

The servos modulate their current at 300 Hz (Gerdes et al. 2017, instrumentation suite), and the supply voltage drops
with each pulse. Voltage and current are therefore anticorrelated, and the mean power is the mean of the product over
whole modulation periods. The sums are integers and exact; the calibration is applied to the sums.

The zero of a current sensor drifts by a percent of the cruise current. It is estimated while the current is known:
disarmed, and with the wings at rest by their encoders for `Gains.rest_time`, since a drive that opposes wind on a
wing may draw current. A burst beyond `Gains.zero_limit` is ignored.

The state of charge is the integral of the current, corrected slowly toward the value of the open-circuit voltage.
That voltage is the measured one plus the voltage drop. The resistance is the slope of voltage over current between
bursts within the strokes. The voltage thus corrects for a battery that was not full at boot, or has aged.
"""

from __future__ import annotations

from operator import mul
from typing import Annotated, Final, NamedTuple

from avionics.limits import clip, low_pass
from avionics.messages import AdcBurst, PowerState
from wingbeat.records import constructor
from wingbeat.units import Quantity

LONGEST_GAP: Final = 1.0
"""s; maximum interval between bursts in the integration of the power"""
BATTERY_US: Final = 40_000
"""us; update interval of the battery: six samples in a stroke of 4 Hz, for the estimation of the resistance"""
VOLTAGE_SHARE_TIME: Final = 2.0
"""s; averaging time of the charge fraction from the voltage alone, for early detection of a failing battery"""
RESISTANCE_SPAN: Final = 5.0
"""-; ratio of a measured resistance to the nominal one, and its inverse, up to which it is accepted"""


class Gains(NamedTuple):
    """Calibration of ADC (ATMEGA328P), divider, current sensor (ACS723) and battery."""

    reference: Annotated[float, Quantity("V", 0.5, 200.0)] = 5.0
    """V; full scale of the ADC"""
    full_scale: Annotated[float, Quantity("counts", 256.0, 65536.0)] = 1024.0
    """counts; at the reference: 2^10"""
    divider: Annotated[float, Quantity("-", 0.001, 1.0)] = 0.5
    """-; ratio of ADC input to supply voltage"""
    voltage_offset: Annotated[float, Quantity("V", -5.0, 5.0)] = 0.0
    """V; offset added to the supply voltage"""
    current_zero: Annotated[float, Quantity("V", 0.0, 200.0)] = 2.5
    """V; output of the current sensor without current"""
    current_sensitivity: Annotated[float, Quantity("V/A", 0.001, 10.0)] = 0.2
    """V/A; sensitivity of the current sensor (ACS723, +-10 A: 200 mV/A)"""
    sample_rate: Annotated[float, Quantity("Hz", 100.0, 100000.0)] = 6000.0
    """Hz; sample rate of the ADC within a burst"""
    pwm_frequency: Annotated[float, Quantity("Hz", 0.0, 50000.0)] = 300.0
    """Hz; frequency of the current modulation, 0 for a smooth current"""
    current_range: Annotated[float, Quantity("A", 0.1, 1000.0)] = 10.0
    """A; saturation of the current sensor in each direction"""
    rest_current: Annotated[float, Quantity("A", 0.0, 5.0)] = 0.0
    """A; current of the drives at rest with power on"""
    rest_travel: Annotated[float, Quantity("rad", 0.0, 1.0)] = 0.02
    """rad; travel of a wing beyond which it is not at rest"""
    rest_time: Annotated[float, Quantity("s", 0.0, 60.0)] = 0.5
    """s; time at rest before the zero is estimated. Default: two strokes"""
    zero_limit: Annotated[float, Quantity("A", 0.0, 1.0)] = 0.06
    """A; limit of the estimated zero; a burst with a larger error is ignored"""
    zero_time: Annotated[float, Quantity("s", 0.1, 1000.0)] = 10.0
    """s; time constant of the zero at rest; a plain mean before that. Default: the zero of the sensor drifts with its
    temperature over minutes"""
    capacity: Annotated[float, Quantity("C", 10.0, 1e6)] = 2664.0
    """C; capacity of the battery (740 mA h)"""
    open_circuit: Annotated[tuple[float, ...], Quantity("V", 0.5, 100.0)] = (7.2, 8.4)
    """V; open-circuit voltage of the battery, empty to full in equal steps of charge"""
    resistance: Annotated[float, Quantity("ohm", 0.001, 5.0)] = 0.06
    """ohm; resistance of battery and leads until it is measured in flight"""
    sag_time: Annotated[float, Quantity("s", 0.5, 100.0)] = 5.0
    """s; averaging time of voltage and current for the resistance. Default: twenty strokes"""
    sag_current: Annotated[float, Quantity("A", 0.01, 100.0)] = 0.3
    """A; minimum standard deviation of the current for the resistance. Default: a voltage drop of 18 mV, ten times
    the error of the mean voltage of a burst"""
    voltage_time: Annotated[float, Quantity("s", 1.0, 1e5)] = 120.0
    """s; time constant of the correction by the open-circuit voltage; a plain mean before that. Default: a tenth of
    the battery at cruise: before the error of the integral exceeds that of the voltage"""


class Battery(NamedTuple):
    """State of the battery, updated every `BATTERY_US`."""

    time_us: int = -1
    """us; time of the last update, -1 before the first"""
    charge: float = 0.0
    """C; charge drawn since boot at the last update"""
    voltage: float = 0.0
    """V; mean over `Gains.sag_time`"""
    current: float = 0.0
    """A; mean over `Gains.sag_time`"""
    variance: float = 0.0
    """A^2; variance of the current over `Gains.sag_time`"""
    covariance: float = 0.0
    """V A; covariance of voltage and current over `Gains.sag_time`"""
    resistance: float = 0.0
    """ohm; 0 before it is measured"""
    open_circuit: float = 0.0
    """V; voltage plus the voltage drop"""
    remaining: float = 1.0
    """-; remaining fraction of the charge"""
    span: float = 0.0
    """s; averaging time of the correction by the open-circuit voltage so far"""
    by_voltage: float = 1.0
    """-; charge fraction from the voltage of the last seconds alone"""


class Rest(NamedTuple):
    """Rest detection of the wings."""

    left: float = 0.0
    """rad; left flap angle at the last movement by `Gains.rest_travel`"""
    right: float = 0.0
    """rad; right flap angle at the last movement by `Gains.rest_travel`"""
    time: float = 0.0
    """s; time since then"""


class State(NamedTuple):
    """State of the power integration."""

    time_us: int = -1
    """us; time of the last burst, -1 before the first"""
    charge: float = 0.0
    """C; charge drawn since boot"""
    energy: float = 0.0
    """J; energy drawn since boot"""
    strokes: int = 0
    """-; number of full strokes at the last burst"""
    stroke_us: int = -1
    """us; first burst in the present stroke, -1 before the first"""
    energy_at_stroke: float = 0.0
    """J; energy drawn at that burst"""
    energy_per_stroke: float = 0.0
    """J; energy of the last full stroke"""
    zero: float = 0.0
    """A; estimated zero of the current sensor"""
    zero_span: float = 0.0
    """s; averaging time of the zero so far"""
    battery: Battery = Battery()
    clipped: int = 0
    """-; number of battery updates with a saturated current sensor"""
    rest: Rest = Rest()


class Beat(NamedTuple):
    """Wing motion used by the power measurement."""

    strokes: int = 0
    """-; full strokes since boot"""
    frequency: float = 0.0
    """Hz; frequency of the last stroke"""
    left: float = 0.0
    """rad; flap angle of the left wing"""
    right: float = 0.0
    """rad; flap angle of the right wing"""


NO_BEAT: Final = Beat()
NO_REST: Final = Rest()


class Averages(NamedTuple):
    """Means over whole PWM periods of a burst."""

    voltage: float
    """V"""
    current: float
    """A"""
    power: float
    """W; mean of the product"""


def whole_periods(gains: Gains, samples: int) -> int:
    """Return the number of the last ``samples`` that span whole PWM periods.

    All samples are used if no whole period fits.
    """
    if gains.pwm_frequency <= 0.0:
        return samples
    samples_per_period = gains.sample_rate / gains.pwm_frequency
    periods = int(samples / samples_per_period + 1e-9)
    return round(periods * samples_per_period) if periods > 0 else samples


_new_averages: Final = constructor(Averages)


def averages(gains: Gains, burst: AdcBurst) -> Averages:
    """Return mean voltage, current and power of a burst.

    The two tuples of the burst have the same length, at least 1.
    """
    voltages, currents = burst.voltage_counts, burst.current_counts
    samples = len(voltages)
    count = whole_periods(gains, samples)
    if count != samples:
        voltages, currents = voltages[-count:], currents[-count:]
    lsb = gains.reference / gains.full_scale
    a, b = lsb / gains.divider, gains.voltage_offset
    c, d = lsb / gains.current_sensitivity, -gains.current_zero / gains.current_sensitivity
    # The mean of (a v + b) (c i + d), from exact integer sums.
    voltage, current = a * sum(voltages) / count, c * sum(currents) / count
    power = a * c * sum(map(mul, voltages, currents)) / count + d * voltage + b * current + b * d
    return _new_averages(voltage + b, current + d, power)


_new_power_state: Final = constructor(PowerState)
_new_state: Final = constructor(State)


def step(
    gains: Gains, state: State, burst: AdcBurst, beat: Beat = NO_BEAT, resting: bool = False
) -> tuple[State, PowerState]:
    """Update the power state with one burst.

    Args:
        gains: calibration.
        state: result of the last step, ``State()`` at boot.
        burst: samples; the integrals do not advance unless it is later than the last one.
        beat: wing motion from the wing state.
        resting: True if the drives are off, so that the zero may be estimated while the wings are at rest.
    """
    (last_us, charge, energy, strokes, stroke_us, energy_at_stroke, energy_per_stroke, zero, zero_span, battery,
     clipped, rest) = state  # fmt: skip
    time_us = burst.time_us
    dt = _interval(gains, last_us, burst)
    voltage, current, power = averages(gains, burst)
    rest = at_rest(gains, rest, beat, dt) if resting else NO_REST
    if rest.time > gains.rest_time:
        zero, zero_span = learned_zero(gains, zero, zero_span, current, dt)
    current, power = current - zero, power - zero * voltage
    charge, energy = charge + current * dt, energy + power * dt
    if beat.strokes != strokes:
        if stroke_us >= 0 and beat.frequency > 0.0:
            # Bursts are not synchronized with strokes: mean power between bursts times the period.
            energy_per_stroke = (energy - energy_at_stroke) * 1e6 / (max(time_us - stroke_us, 1) * beat.frequency)
        strokes, stroke_us, energy_at_stroke = beat.strokes, time_us, energy
    if battery.time_us < 0 or time_us - battery.time_us >= BATTERY_US:
        battery = watched(gains, battery, time_us, charge, voltage, current)
        clipped += beyond_range(gains, burst)
    state = _new_state(
        max(last_us, time_us), charge, energy, strokes, stroke_us, energy_at_stroke, energy_per_stroke, zero,
        zero_span, battery, clipped, rest,
    )  # fmt: skip
    return state, _new_power_state(
        time_us, voltage, current, power, charge, energy, energy_per_stroke, battery.remaining,
        battery.open_circuit, battery.resistance or gains.resistance, zero, clipped,
    )  # fmt: skip


def at_rest(gains: Gains, rest: Rest, beat: Beat, dt: float) -> Rest:
    """Advance the rest detection by ``dt`` (s).

    A movement by `Gains.rest_travel` resets it.
    """
    if max(abs(beat.left - rest.left), abs(beat.right - rest.right)) > gains.rest_travel:
        return Rest(beat.left, beat.right)
    return rest._replace(time=rest.time + dt)


def learned_zero(gains: Gains, zero: float, span: float, current: float, dt: float) -> tuple[float, float]:
    """Return the current zero (A) and its averaging time (s) after ``dt`` (s) at rest.

    ``current`` (A) is the calibrated current.
    """
    error = current - gains.rest_current
    if dt <= 0.0 or abs(error) > gains.zero_limit:
        return zero, span
    span = min(span + dt, gains.zero_time)
    return zero + (error - zero) * min(1.0, dt / span), span


def beyond_range(gains: Gains, burst: AdcBurst) -> int:
    """Return 1 if the current sensor saturated, so that its mean is too small."""
    highest = (gains.current_zero + gains.current_range * gains.current_sensitivity) / gains.reference
    return int(max(burst.current_counts) >= highest * gains.full_scale - 1.0)


def watched(gains: Gains, battery: Battery, time_us: int, charge: float, voltage: float, current: float) -> Battery:
    """Update the battery state.

    ``charge`` (C) is drawn since boot; ``voltage`` (V) and ``current`` (A) are means of the burst.
    """
    if battery.time_us < 0:
        open_circuit = voltage + gains.resistance * current
        share = share_of(gains.open_circuit, open_circuit)
        return Battery(
            time_us, charge, voltage, current, open_circuit=open_circuit, remaining=share, by_voltage=share
        )
    _, charge_before, mean_voltage, mean_current, variance, covariance, resistance, _, remaining, span, by_voltage = (
        battery
    )
    dt = min(LONGEST_GAP, (time_us - battery.time_us) * 1e-6)
    share = dt / (dt + gains.sag_time)
    off = current - mean_current
    covariance = (1.0 - share) * (covariance + share * off * (voltage - mean_voltage))
    variance = (1.0 - share) * (variance + share * off * off)
    mean_voltage, mean_current = mean_voltage + share * (voltage - mean_voltage), mean_current + share * off
    resistance = slope(gains, variance, covariance) or resistance
    open_circuit = voltage + (resistance or gains.resistance) * current
    span = min(span + dt, gains.voltage_time)
    remaining = clip(remaining - (charge - charge_before) / gains.capacity, 0.0, 1.0)
    told = share_of(gains.open_circuit, open_circuit)
    remaining += (told - remaining) * min(1.0, dt / span)
    # Nominal resistance, because a failing battery corrupts the slope of voltage over current.
    at_once = share_of(gains.open_circuit, voltage + gains.resistance * current)
    by_voltage = low_pass(by_voltage, at_once, VOLTAGE_SHARE_TIME, dt)
    return Battery(
        time_us, charge, mean_voltage, mean_current, variance, covariance, resistance, open_circuit, remaining, span,
        by_voltage,
    )  # fmt: skip


def slope(gains: Gains, variance: float, covariance: float) -> float:
    """Return the resistance (ohm) from voltage and current; 0 if it is implausible."""
    if variance < gains.sag_current * gains.sag_current:
        return 0.0
    measured = -covariance / variance
    believed = gains.resistance / RESISTANCE_SPAN <= measured <= gains.resistance * RESISTANCE_SPAN
    return measured if believed else 0.0


def share_of(open_circuit: tuple[float, ...], voltage: float) -> float:
    """Return the charge fraction at an open-circuit ``voltage`` (V).

    The fraction is from 0 to 1. The points of ``open_circuit`` rise from empty to full.
    """
    if voltage <= open_circuit[0]:
        return 0.0
    for i in range(1, len(open_circuit)):
        low, high = open_circuit[i - 1], open_circuit[i]
        if voltage < high:
            return (i - 1 + (voltage - low) / (high - low)) / (len(open_circuit) - 1)
    return 1.0


def _interval(gains: Gains, last_us: int, burst: AdcBurst) -> float:
    """Return the duration (s) of a burst: since the last one, or its length at boot."""
    if last_us < 0:
        return len(burst.voltage_counts) / gains.sample_rate
    return max(0.0, min(LONGEST_GAP, (burst.time_us - last_us) * 1e-6))
