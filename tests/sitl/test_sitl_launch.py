"""Hand launch with the vibration of the airframe: every throw is detected, nothing else is."""

from __future__ import annotations

import math

import numpy as np
import pytest
from handled import CARRIED, carry, walking
from simulate import ARIZONA, RAVEN

from avionics.autopilot import Autopilot
from avionics.link.codec import quantized_command
from avionics.messages import Stage
from avionics.missions import load_mission
from avionics.missions.script import scripted_start
from avionics.vehicles import load_vehicle as load_flight_vehicle
from sim_bridge.bridge.world import NEUTRAL
from sim_bridge.flight.world import Scenario, SimulatedWorld, Throw
from sim_bridge.vehicles import load_vehicle

WAIT_THROTTLE = 0.35
"""-; of beating wings in the hand"""


def launch_delay(vehicle: str, beating: bool, seed: int) -> float:
    """Return the time (s) from a throw to its detection: negative if it came early, NaN without one in 3 s.

    The throws are up to 20 % too fast or slow, with standard deviations of 7 degrees of pitch and 11 degrees of bank.
    """
    generator = np.random.default_rng(seed)
    speed, pitch, bank = generator.uniform(0.8, 1.2), generator.normal(0.0, 0.12), generator.normal(0.0, 0.2)
    scenario = Scenario(seed, throw=Throw(float(speed), float(pitch), float(bank)), vibration=1.0)
    world, computer = SimulatedWorld(load_vehicle(vehicle), scenario), load_flight_vehicle(vehicle)
    modes = computer.gains.modes._replace(wait_throttle=WAIT_THROTTLE if beating else 0.0)
    computer = computer._replace(gains=computer.gains._replace(modes=modes))
    autopilot = Autopilot(computer, load_mission("circuit"), lambda topic, message: None)
    command, script = NEUTRAL, list(scripted_start())
    thrown = detected = math.nan
    while math.isnan(thrown + detected) and not world.time_us * 1e-6 > thrown + 3.0:
        frame = world.step(quantized_command(command))
        due = [one for one in script if one.time_us <= frame.time_us]
        script = script[len(due) :]
        command = autopilot.step(frame, tuple(due)) or command
        time = world.time_us * 1e-6
        if math.isnan(thrown) and world.launched:
            thrown = time
        if math.isnan(detected) and autopilot.memory.modes.stage > Stage.WAIT_LAUNCH:
            detected = time
    return detected - thrown


@pytest.mark.parametrize("vehicle", [RAVEN, ARIZONA])
@pytest.mark.parametrize("beating", [pytest.param(False, marks=pytest.mark.validate), True])
def test_throws_are_detected_with_vibration(vehicle: str, beating: bool) -> None:
    for seed in (1, 2):
        assert 0.0 <= launch_delay(vehicle, beating, seed) < 1.0


@pytest.mark.validate
@pytest.mark.parametrize("vehicle", [RAVEN, ARIZONA])
@pytest.mark.parametrize("beating", [False, True])
def test_fifty_throws_are_detected_with_vibration(vehicle: str, beating: bool) -> None:
    delays = {seed: launch_delay(vehicle, beating, seed) for seed in range(1000, 1050)}
    assert not {seed: delay for seed, delay in delays.items() if not 0.0 <= delay < 1.0}


@pytest.mark.parametrize(
    "kind", [pytest.param(kind, marks=() if kind == "walking" else pytest.mark.validate) for kind in CARRIED]
)
@pytest.mark.parametrize("beating", [pytest.param(False, marks=pytest.mark.validate), True])
def test_being_carried_is_no_launch(kind: str, beating: bool) -> None:
    carried = carry(RAVEN, CARRIED[kind](1, 20.0), 1, beating)
    assert "armed" in carried.events and carried.stage == Stage.WAIT_LAUNCH


def test_a_throw_while_walking_is_a_launch() -> None:
    motion = walking(1, 4.0)
    motion.acceleration[400:460, 0] += 20.0
    assert carry(RAVEN, motion, 1, beating=True).stage > Stage.WAIT_LAUNCH


@pytest.mark.validate
@pytest.mark.parametrize("vehicle", [RAVEN, ARIZONA])
@pytest.mark.parametrize("kind", CARRIED)
@pytest.mark.parametrize("beating", [False, True])
def test_five_minutes_of_being_carried_are_no_launch(vehicle: str, kind: str, beating: bool) -> None:
    carried = carry(vehicle, CARRIED[kind](2, 300.0), 2, beating)
    assert "armed" in carried.events and carried.stage == Stage.WAIT_LAUNCH
