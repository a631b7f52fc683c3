"""A set of sensors as a vehicle file describes them, without and with their errors, and something to measure."""

from __future__ import annotations

from pathlib import Path
from typing import Any

from scipy.stats import chi2

from sim_bridge.observation import Observation
from sim_bridge.sensors.suite import SECTIONS, SensorSpec, sensor_spec
from wingbeat.vehicle_file import Schema, read_vehicle_file

SPEC: SensorSpec = sensor_spec(read_vehicle_file(Path(__file__).with_suffix(".toml"), Schema(SECTIONS)).sections)

LEVEL_CRUISE = Observation(
    time_us=0,
    quaternion=(1.0, 0.0, 0.0, 0.0),
    omega_frd=(0.0, 0.0, 0.0),
    specific_force_frd=(0.0, 0.0, -9.80665),
    position_ned=(0.0, 0.0, -40.0),
    v_ned=(7.75, 0.0, 0.0),
    v_air_frd=(7.75, 0.0, 0.0),
    static_pressure=100613.0,
    temperature=287.76,
    density=1.2180,
    flap_left=0.0,
    flap_right=0.0,
    torque_left=0.5,
    torque_right=0.5,
    current=3.26,
    open_circuit_voltage=8.0,
    battery_resistance=0.08,
    pulse_current=6.4,
    pwm_frequency=300.0,
)


def cruise(tick: int = 0, **changes: Any) -> Observation:
    """Level cruise of Robo Raven at a tick of 200 Hz, with changes."""
    return LEVEL_CRUISE._replace(time_us=5000 * tick, **changes)


def quiet(section: Any) -> Any:
    """The same sensor with no noise, no drift and no errors of the unit."""
    wrong = ("noise", "sigma", "walk", "zero_left", "zero_right")
    silent = {name for name in section._fields if any(word in name for word in wrong)}
    zeros = {name: (0.0, 0.0, 0.0) if isinstance(getattr(section, name), tuple) else 0.0 for name in silent}
    return section._replace(**zeros)


def perfect() -> SensorSpec:
    """Every sensor quiet."""
    optional = {section: quiet(spec) for section, spec in SPEC.optional.items()}
    return SensorSpec(*map(quiet, SPEC[:-1]), optional=optional)


def variance_bounds(samples: int, variance: float) -> tuple[float, float]:
    """Where the sample variance of so many independent normal numbers lies, but for one case in 10^5."""
    low, high = chi2.interval(1.0 - 1e-5, samples - 1)
    return variance * low / (samples - 1), variance * high / (samples - 1)
