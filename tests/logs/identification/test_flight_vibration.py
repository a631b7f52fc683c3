"""Vibration at the IMU during the maneuvers of a flight is a finding."""

from __future__ import annotations

import numpy as np
import pytest

from logs.identification.data.flight import FlightData
from logs.identification.estimators.flight_modes import vibration_findings

TIME = np.arange(0.0, 20.0, 0.005)


def flight(level: float) -> FlightData:
    """Return a flight with 4 Hz strokes and white noise of a level in m/s^2 in the normal specific force."""
    zero, active = np.zeros(len(TIME)), (TIME > 5.0) & (TIME < 15.0)
    noise = np.random.default_rng(1).normal(0.0, level, len(TIME))
    accel_z = -9.8 + 12.0 * np.sin(2.0 * np.pi * 4.0 * TIME) + noise
    return FlightData(
        TIME, zero, zero, accel_z, zero, zero + 7.0, zero, zero, 4.0 * TIME, active.astype(float), zero, zero, zero
    )


@pytest.mark.parametrize(("level", "codes"), [(0.2, []), (2.0, ["vibration"])])
def test_vibration_is_a_finding(level: float, codes: list[str]) -> None:
    """GIVEN a flapping flight with noise WHEN its band above 40 Hz is strong THEN a warning with the level."""
    found = vibration_findings(flight(level))
    assert [one.code for one in found] == codes
    for one in found:
        # White noise above 40 Hz of a Nyquist frequency of 100 Hz has 60 % of the power.
        assert one.value == pytest.approx(level * np.sqrt(0.6), rel=0.1)
        assert one.severity == "warning" and "filter error" in one.text
