"""Roll and pitch in whole flights: straight, in turns of 25 degrees both ways, and in gusts."""

from __future__ import annotations

import math
from typing import Any, NamedTuple

import numpy as np
import pytest
from memory_log import MemoryLog
from simulate import ARIZONA, RAVEN, Flight

from avionics import topics
from avionics.autopilot import Autopilot
from avionics.link.codec import quantized_command
from avionics.messages import Command, CommandKind, Mode, PilotInput
from avionics.missions import load_mission
from avionics.missions.script import scripted_start
from avionics.vehicles import load_vehicle as load_flight_vehicle
from sim_bridge.bridge.world import NEUTRAL
from sim_bridge.flight.world import LAUNCH_TIME, Scenario, SimulatedWorld
from sim_bridge.vehicles import SimulatedVehicle, load_vehicle

TURN = math.radians(25.0)
RIGHT, LEFT = (18.0, 33.0), (43.0, 58.0)
"""s; turns, with straight flight before and after each"""
STICK_PERIOD = 0.1
"""s; a stick that is not told again is none"""
HOLD_TIME = 14.0
DURATION = 68.0
SETTLED = 4.0
"""s; with less than 5 degrees of bank before a moment counts as straight flight"""


def calibrated(vehicle: SimulatedVehicle) -> SimulatedVehicle:
    """Without errors of scale, offset and mounting, which no filter sees; noise and the gyro's bias are left."""
    s = dict(vehicle.sections)
    none = {"scale_sigma": 0.0, "misalignment_sigma_deg": 0.0}
    s["accelerometer"] = s["accelerometer"]._replace(offset_sigma_mg=0.0, **none)
    s["gyroscope"] = s["gyroscope"]._replace(**none)
    s["magnetometer"] = s["magnetometer"]._replace(hard_iron_sigma_mg=0.0, **none)
    return vehicle._replace(sections=s)


class Errors(NamedTuple):
    """RMS of roll and pitch in degrees, and of errors over told sigmas."""

    straight: Any
    turning: Any
    flapping: Any
    ratio: float


def sticks(roll: float) -> list[PilotInput]:
    """The pilot's, told ten times a second while the altitude is held."""
    told = []
    for time in np.arange(HOLD_TIME, DURATION, STICK_PERIOD).tolist():
        side = float(RIGHT[0] <= time < RIGHT[1]) - float(LEFT[0] <= time < LEFT[1])
        told.append(PilotInput(round(time * 1e6), 0.0, side * roll, 0.0, 0.6))
    return told


def turns(vehicle: str, scenario: Scenario) -> Flight:
    """AUTO to the climb-out's end, then ALTITUDE_HOLD with the roll stick held for turns of 25 degrees.

    What follows the launch is as much later as a launcher that waits for steady air.
    """
    flight_vehicle, log = load_flight_vehicle(vehicle), MemoryLog()
    mission = load_mission("circuit")
    world = SimulatedWorld(calibrated(load_vehicle(vehicle)), scenario, log.publish)
    autopilot = Autopilot(flight_vehicle, mission, log.publish)
    waiting: list[Command | PilotInput] = list(scripted_start())
    flown: list[Command | PilotInput] = [
        Command(round(HOLD_TIME * 1e6), CommandKind.SET_MODE, name=Mode.ALTITUDE_HOLD.name),
        *sticks(TURN / flight_vehicle.gains.roll.stick_roll),
    ]
    command, launched = NEUTRAL, False
    while not world.finished:
        frame = world.step(command)
        if world.launched and not launched:
            launched, late = True, frame.time_us - round(LAUNCH_TIME * 1e6)
            waiting += [entry._replace(time_us=entry.time_us + late) for entry in flown]
            waiting.sort(key=lambda entry: entry.time_us)
        due = [entry for entry in waiting if entry.time_us <= frame.time_us]
        waiting = waiting[len(due) :]
        command = quantized_command(autopilot.step(frame, due))
    return Flight(log, mission)


def errors(flight: Flight) -> Errors:
    """Of the time in the air, wings beating, from 4 s after the launch."""
    attitude, wing = flight.columns(topics.ATTITUDE), flight.columns(topics.WING)
    time = attitude["time_us"] * 1e-6
    roll, pitch, _ = (np.interp(attitude["time_us"], flight.truth["time_us"], a) for a in flight.true_attitude())
    error = np.degrees(np.stack([attitude["roll"] - roll, attitude["pitch"] - pitch], axis=1))
    launch, end = flight.air_time()
    flapping = np.interp(attitude["time_us"], wing["time_us"], wing["flapping"]) == 1.0
    chosen = flapping & (time > launch + SETTLED) & (time < end)
    bank = np.degrees(np.abs(roll))
    banked = np.cumsum(bank >= 5.0)
    ticks = round(SETTLED * 200)
    level = np.concatenate([np.zeros(ticks, dtype=bool), banked[ticks:] == banked[:-ticks]])
    turning = (bank > 20.0) & (bank < 30.0)
    ratio = error[chosen] / np.degrees(attitude["tilt_sigma"][chosen])[:, None]
    parts = [_rms(error[chosen & part]) for part in (level, turning, np.ones_like(level))]
    return Errors(*parts, float(np.sqrt(np.mean(ratio**2))))


def _rms(error: Any) -> Any:
    return np.sqrt(np.mean(error**2, axis=0)) if len(error) > 1000 else np.full(2, np.nan)


@pytest.mark.validate
@pytest.mark.parametrize("vehicle", [RAVEN, pytest.param(ARIZONA, marks=pytest.mark.validate)])
def test_roll_and_pitch_straight_and_in_turns(vehicle: str) -> None:
    """GIVEN sensor noise in still air THEN within 0.5 degrees straight and 1.0 in turns of 25 degrees, RMS."""
    flight = turns(vehicle, Scenario(seed=1, duration=DURATION))
    found = errors(flight)
    assert found.straight.max() < 0.5
    assert found.turning.max() < 1.0
    assert found.ratio < 1.5


@pytest.mark.validate
@pytest.mark.parametrize(("vehicle", "seed"), [(RAVEN, 7), (RAVEN, 8), (ARIZONA, 4)])
def test_roll_and_pitch_in_gusts(vehicle: str, seed: int) -> None:
    """GIVEN 3 m/s of wind and moderate gusts THEN within 1 degree all the time the wings beat, RMS."""
    flight = turns(vehicle, Scenario(seed=seed, wind_speed=3.0, turbulence="moderate", duration=DURATION))
    found = errors(flight)
    assert found.flapping.max() < 1.0
    assert found.ratio < 1.5
