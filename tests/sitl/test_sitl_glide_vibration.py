"""Vibration in cruise over that in a glide, beside the flight of a real ornithopter."""

from __future__ import annotations

import numpy as np
import pytest
from memory_log import simulate
from scipy.signal import welch

from avionics import topics
from sim_bridge.flight.faults import parse_fault
from sim_bridge.flight.world import Scenario

JAMMED_AT = 45.0
"""s; in cruise, on a straight leg"""
WINDOW = 1.0
"""s"""
AXES = ("accel_x", "accel_y", "accel_z")
REAL = (16.0, 52.0)
"""-; lowest and highest of the axes of a 0.9 kg ornithopter (dAnte-9029/QgcLogs, log 21 of 2026-03-03)"""


@pytest.mark.validate
@pytest.mark.parametrize("seed", [1, 2, 3])
def test_vibration_falls_in_a_glide_as_that_of_the_real_aircraft(seed: int) -> None:
    """GIVEN a cruise WHEN the drive stops THEN the accelerometers have 16 to 52 times less above 40 Hz."""
    fault = parse_fault(f"wing_left_jammed@{JAMMED_AT}")
    log = simulate("ulg_ornithopter", Scenario(seed=seed, vibration=1.0, duration=JAMMED_AT + 15.0, faults=(fault,)))
    imu, wing, altitude = (log.columns(topic) for topic in (topics.IMU, topics.WING, topics.ALTITUDE))
    time = imu["time_us"] * 1e-6
    frequency = np.interp(time, wing["time_us"] * 1e-6, wing["frequency"])
    height = np.interp(time, altitude["time_us"] * 1e-6, altitude["altitude"])

    def levels(first: float, last: float, gliding: bool) -> list[float]:
        """RMS above 40 Hz of the axes, median over the seconds from ``first`` to ``last``."""
        found = []
        for start in np.arange(first, last, WINDOW):
            at = (time >= start) & (time < start + WINDOW)
            if at.any() and height[at].min() > 2.0 and bool(np.all(frequency[at] == 0.0)) == gliding:
                found.append([_above_40_hz(imu[axis][at]) for axis in AXES])
        return list(np.median(found, axis=0))

    cruise, glide = levels(JAMMED_AT - 9.0, JAMMED_AT, False), levels(JAMMED_AT + 3.0, JAMMED_AT + 13.0, True)
    for axis, flight, rest in zip(AXES, cruise, glide, strict=True):
        assert REAL[0] <= flight / rest <= REAL[1], f"{axis}: {flight:.3g} over {rest:.3g} = {flight / rest:.1f}"


def _above_40_hz(values: np.ndarray) -> float:
    frequency, density = welch(values, 200.0, nperseg=128)
    above = frequency >= 40.0
    return float(np.sqrt(np.trapezoid(density[above], frequency[above])))
