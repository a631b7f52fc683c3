"""A sweep and a multisine flown on the simulated Robo Raven give the short period that its doublets give."""

from __future__ import annotations

import math

import pytest
from flown import RAVEN
from identified import true_short_period
from memory_log import MemoryLog

from avionics import topics
from avionics.autopilot import Autopilot
from avionics.guidance.mission import Channel, Excitation, ItemKind, MissionItem, Shape
from avionics.vehicles import load_vehicle as load_flight_vehicle
from groundstation.command.onboard import scripted_start
from logs.identification.data import Aircraft
from logs.identification.flight import flight_data
from logs.identification.manoeuvre import find_manoeuvres
from logs.identification.report import identify
from sim_bridge.flight.flight import fly
from sim_bridge.flight.world import Scenario, SimulatedWorld
from sim_bridge.vehicles import load_vehicle

SWEEP = Excitation(
    Channel.ELEVATOR, Shape.LOGARITHMIC_SWEEP, math.radians(3.0), 8.0, settle=0.9, repeats=1, low=0.5, high=3.0
)
MULTISINE = SWEEP._replace(shape=Shape.MULTISINE, amplitude=math.radians(4.0))
MISSION = (
    MissionItem(ItemKind.TAKEOFF, altitude=40.0),
    MissionItem(ItemKind.HOLD, altitude=40.0, heading=math.radians(60.0), duration=5.5),
    MissionItem(ItemKind.EXCITE, excitation=SWEEP),
    MissionItem(ItemKind.EXCITE, excitation=MULTISINE),
)


@pytest.mark.validate
def test_a_sweep_and_a_multisine_give_the_true_short_period() -> None:
    log = MemoryLog()
    flight_vehicle = load_flight_vehicle(RAVEN)
    world = SimulatedWorld(load_vehicle(RAVEN), Scenario(seed=1, duration=68.0), log.publish)
    fly(world, Autopilot(flight_vehicle, MISSION, log.publish), scripted_start())
    said = [event.text for event in log.messages[topics.EVENTS.name]]
    assert "item 3 done" in said, said

    airframe = flight_vehicle.airframe
    aircraft = Aircraft(airframe.imu_x, airframe.imu_z, airframe.tail_time_constant)
    found = find_manoeuvres(flight_data(log), aircraft)
    assert [manoeuvre.number for manoeuvre in found] == [1, 2]
    for manoeuvre in found:
        assert manoeuvre.at[-1] - manoeuvre.at[0] == pytest.approx(8.0 + 2 * 0.9, abs=0.5)

    modes, true = identify(log, "modes", aircraft).modes, true_short_period(RAVEN, log)
    assert modes is not None
    output_error = next(mode for mode in modes.modes if mode.method == "output error")
    assert output_error.frequency is not None
    assert output_error.damping is not None
    assert output_error.frequency.low <= true.natural_frequency <= output_error.frequency.high
    assert output_error.frequency.high - output_error.frequency.low <= 0.1 * output_error.frequency.value
    assert output_error.damping.value == pytest.approx(true.damping, abs=0.08)
