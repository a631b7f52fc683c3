"""Supply voltage, current and power of the wing drives from bursts of ADC counts, and what the battery still holds.

The servos modulate their current at 300 Hz (Gerdes et al. 2017, instrumentation suite), and the supply sags with
every pulse: voltage and current are anticorrelated, so the mean power is the mean of the product, taken over
whole periods of the modulation. The sums are of whole numbers and exact; the calibration is applied to the sums.

The zero of a current sensor wanders by a per cent of the cruise's current. It is learned while the drives rest, when
the current is known: disarmed, and the wings still by their encoders for `Gains.rest_time`, since a drive that holds
a wing in the wind may draw current. A burst beyond `Gains.zero_limit` is left out.

The battery's share is the integral of the current, drawn slowly towards the share that belongs to its open-circuit
voltage. That voltage is the measured one plus the sag, whose resistance is the slope of voltage over current from
burst to burst within the strokes. A battery that was not full at boot, or has aged, is seen by its voltage.
"""

from __future__ import annotations

from operator import mul
from typing import Annotated, NamedTuple

from avionics.limits import clip, low_pass
from avionics.messages import AdcBurst, PowerState
from wingbeat.records import constructor
from wingbeat.units import Quantity

LONGEST_GAP = 1.0
"""s; between bursts, over which the last power is held when it is integrated"""
BATTERY_US = 40_000
"""us; from look to look at the battery: six in a stroke of 4 Hz, which is what tells its resistance"""
VOLTAGE_SHARE_TIME = 2.0
"""s; over which the share by the voltage alone is averaged: a battery that fails is seen before its charge is"""
RESISTANCE_SPAN = 5.0
"""-; times the bench's resistance, and its inverse, within which a measured one is believed"""


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
    current_range: Annotated[float, Quantity("A", 0.1, 1000.0)] = 10.0
    """A; either way, where the current sensor saturates"""
    rest_current: Annotated[float, Quantity("A", 0.0, 5.0)] = 0.0
    """A; drawn by the drives while they rest with power on"""
    rest_travel: Annotated[float, Quantity("rad", 0.0, 1.0)] = 0.02
    """rad; travel of a wing beyond which it is not at rest"""
    rest_time: Annotated[float, Quantity("s", 0.0, 60.0)] = 0.5
    """s; at rest before the zero is learned. Default: two strokes"""
    zero_limit: Annotated[float, Quantity("A", 0.0, 1.0)] = 0.06
    """A; greatest error of the zero that is learned; a burst further off is not a rest's"""
    zero_time: Annotated[float, Quantity("s", 0.1, 1000.0)] = 10.0
    """s; time constant with which the zero is followed while at rest, a plain mean before that. Default: the
    sensor's zero wanders with its temperature over minutes"""
    capacity: Annotated[float, Quantity("C", 10.0, 1e6)] = 2664.0
    """C; of the battery (740 mA h)"""
    open_circuit: Annotated[tuple[float, ...], Quantity("V", 0.5, 100.0)] = (7.2, 8.4)
    """V; of the battery without load, empty to full in equal steps of charge"""
    resistance: Annotated[float, Quantity("ohm", 0.001, 5.0)] = 0.06
    """ohm; of battery and leads, until it is measured in flight"""
    sag_time: Annotated[float, Quantity("s", 0.5, 100.0)] = 5.0
    """s; over which voltage and current are compared for the resistance. Default: twenty strokes"""
    sag_current: Annotated[float, Quantity("A", 0.01, 100.0)] = 0.3
    """A; least standard deviation of the current that tells the resistance. Default: sags by 18 mV, ten times what a
    burst's mean voltage is known to"""
    voltage_time: Annotated[float, Quantity("s", 1.0, 1e5)] = 120.0
    """s; with which the share follows that of the open-circuit voltage, a plain mean before that. Default: a tenth
    of the battery at the cruise: before the integral is off by more than the voltage is"""


class Battery(NamedTuple):
    """What is known of the battery, looked at every `BATTERY_US`."""

    time_us: int = -1
    """us; of the last look, -1 before the first"""
    charge: float = 0.0
    """C; drawn since boot, by then"""
    voltage: float = 0.0
    """V; mean over the last seconds"""
    current: float = 0.0
    """A; mean over the last seconds"""
    variance: float = 0.0
    """A^2; of the current over the last seconds"""
    covariance: float = 0.0
    """V A; of voltage and current over the last seconds"""
    resistance: float = 0.0
    """ohm; 0 before it is measured"""
    open_circuit: float = 0.0
    """V; the voltage without its sag"""
    remaining: float = 1.0
    """-; share of the charge"""
    span: float = 0.0
    """s; over which the share of the open-circuit voltage has been averaged"""
    by_voltage: float = 1.0
    """-; share of the charge by the voltage of the last seconds alone"""


class Rest(NamedTuple):
    """Stillness of the wings."""

    left: float = 0.0
    """rad; flap angle of the left wing when it last moved by `Gains.rest_travel`"""
    right: float = 0.0
    """rad; the same of the right wing"""
    time: float = 0.0
    """s; since then"""


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
    stroke_us: int = -1
    """us; of the burst at which the present stroke was first seen, -1 before the first"""
    energy_at_stroke: float = 0.0
    """J; drawn by then"""
    energy_per_stroke: float = 0.0
    """J; of the last full stroke"""
    zero: float = 0.0
    """A; what the sensor tells without current, as learned"""
    zero_span: float = 0.0
    """s; over which it has been averaged"""
    battery: Battery = Battery()
    clipped: int = 0
    """-; looks at a burst that found it beyond the current sensor's range"""
    rest: Rest = Rest()


class Beat(NamedTuple):
    """Wing motion as the power processor uses it."""

    strokes: int = 0
    """-; full strokes since boot"""
    frequency: float = 0.0
    """Hz; of the last"""
    left: float = 0.0
    """rad; flap angle of the left wing"""
    right: float = 0.0
    """rad; flap angle of the right wing"""


NO_BEAT = Beat()
NO_REST = Rest()


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


_new_averages = constructor(Averages)


def averages(gains: Gains, burst: AdcBurst) -> Averages:
    """Mean voltage, current and power of a burst; its two tuples have the same length, at least 1."""
    voltages, currents = burst.voltage_counts, burst.current_counts
    samples = len(voltages)
    count = whole_periods(gains, samples)
    if count != samples:
        voltages, currents = voltages[-count:], currents[-count:]
    lsb = gains.reference / gains.full_scale
    a, b = lsb / gains.divider, gains.voltage_offset
    c, d = lsb / gains.current_sensitivity, -gains.current_zero / gains.current_sensitivity
    # (a v + b) (c i + d), its mean from exact sums of whole numbers.
    voltage, current = a * sum(voltages) / count, c * sum(currents) / count
    power = a * c * sum(map(mul, voltages, currents)) / count + d * voltage + b * current + b * d
    return _new_averages(voltage + b, current + d, power)


_new_power_state = constructor(PowerState)
_new_state = constructor(State)


def step(
    gains: Gains, state: State, burst: AdcBurst, beat: Beat = NO_BEAT, resting: bool = False
) -> tuple[State, PowerState]:
    """One burst on.

    Args:
        gains: calibration.
        state: what the last step returned, ``State()`` at boot.
        burst: samples; one that is not later than the last moves no integral.
        beat: from the wing state.
        resting: whether the drives are off, so that the current's zero may be learned while the wings are at rest.
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
            # Bursts do not begin with strokes: the mean power between them, for as long as the stroke lasts.
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
    """The stillness ``dt`` s later; a wing that moves by `Gains.rest_travel` begins it anew."""
    if max(abs(beat.left - rest.left), abs(beat.right - rest.right)) > gains.rest_travel:
        return Rest(beat.left, beat.right)
    return rest._replace(time=rest.time + dt)


def learned_zero(gains: Gains, zero: float, span: float, current: float, dt: float) -> tuple[float, float]:
    """The zero (A) after ``dt`` s more at rest, and the time (s) it is the mean of; ``current`` is as calibrated."""
    error = current - gains.rest_current
    if dt <= 0.0 or abs(error) > gains.zero_limit:
        return zero, span
    span = min(span + dt, gains.zero_time)
    return zero + (error - zero) * min(1.0, dt / span), span


def beyond_range(gains: Gains, burst: AdcBurst) -> int:
    """1 when the current reached the end of its sensor's range, so that its mean is too small."""
    highest = (gains.current_zero + gains.current_range * gains.current_sensitivity) / gains.reference
    return int(max(burst.current_counts) >= highest * gains.full_scale - 1.0)


def watched(gains: Gains, battery: Battery, time_us: int, charge: float, voltage: float, current: float) -> Battery:
    """The battery at its next look: ``charge`` C drawn since boot, ``voltage`` V and ``current`` A of the burst."""
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
    # By the bench's resistance: a battery that gives way makes the slope of voltage over current a wrong one.
    at_once = share_of(gains.open_circuit, voltage + gains.resistance * current)
    by_voltage = low_pass(by_voltage, at_once, VOLTAGE_SHARE_TIME, dt)
    return Battery(
        time_us, charge, mean_voltage, mean_current, variance, covariance, resistance, open_circuit, remaining, span,
        by_voltage,
    )  # fmt: skip


def slope(gains: Gains, variance: float, covariance: float) -> float:
    """Resistance (ohm) that voltage and current tell; 0 while they tell none that can be."""
    if variance < gains.sag_current * gains.sag_current:
        return 0.0
    measured = -covariance / variance
    believed = gains.resistance / RESISTANCE_SPAN <= measured <= gains.resistance * RESISTANCE_SPAN
    return measured if believed else 0.0


def share_of(open_circuit: tuple[float, ...], voltage: float) -> float:
    """Share of the charge, 0 to 1, that belongs to an open-circuit ``voltage`` (V); the points rise from empty."""
    if voltage <= open_circuit[0]:
        return 0.0
    for i in range(1, len(open_circuit)):
        low, high = open_circuit[i - 1], open_circuit[i]
        if voltage < high:
            return (i - 1 + (voltage - low) / (high - low)) / (len(open_circuit) - 1)
    return 1.0


def _interval(gains: Gains, last_us: int, burst: AdcBurst) -> float:
    """Seconds for which the burst stands: since the last one, or its own length at boot."""
    if last_us < 0:
        return len(burst.voltage_counts) / gains.sample_rate
    return max(0.0, min(LONGEST_GAP, (burst.time_us - last_us) * 1e-6))
