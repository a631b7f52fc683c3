"""The zero of the current sensor, learned in the hand while wind moves the wings."""

from __future__ import annotations

import pytest
from memory_log import MemoryLog
from simulate import ARIZONA, RAVEN, rms

from avionics import topics
from avionics.autopilot import Autopilot
from avionics.link.codec import quantized_command
from avionics.vehicles import load_vehicle as load_flight_vehicle
from sim_bridge.bridge.world import NEUTRAL
from sim_bridge.flight.world import Scenario, SimulatedWorld
from sim_bridge.vehicles import load_vehicle

SEEDS = range(101, 106)
TICKS = 500
"""2.5 s, disarmed"""


def zero_error(vehicle: str, seed: int) -> float:
    """Error (A) of the learned zero in 4 m/s of wind with moderate gusts."""
    gusts = Scenario(seed=seed, wind_speed=4.0, wind_from=0.7, turbulence="small_uav_moderate")
    world, log, command = SimulatedWorld(load_vehicle(vehicle), gusts), MemoryLog(), NEUTRAL
    autopilot = Autopilot(load_flight_vehicle(vehicle), (), log.publish)
    for _ in range(TICKS):
        command = quantized_command(autopilot.step(world.step(command)))
    learned = log.messages[topics.POWER.name][-1].current_zero
    assert learned != 0.0
    return float(learned - world.suite.unit_errors()["power_sensor.current_zero"])


@pytest.mark.parametrize("vehicle", [RAVEN, pytest.param(ARIZONA, marks=pytest.mark.validate)])
def test_current_zero_is_learned_in_gusts(vehicle: str) -> None:
    """GIVEN a disarmed vehicle in the hand in gusts THEN the zero is right to 5 mA RMS."""
    assert rms([zero_error(vehicle, seed) for seed in SEEDS]) < 0.005
