"""A sweep and a multisine flown on the simulated Robo Raven give the short period that its doublets give."""

from __future__ import annotations

import math
from typing import NamedTuple

import pytest
from identified import true_short_period
from memory_log import MemoryLog
from simulate import RAVEN

from avionics import topics
from avionics.autopilot import Autopilot
from avionics.guidance.mission import Channel, Excitation, ItemKind, MissionItem, Shape
from avionics.missions.script import scripted_start
from avionics.vehicles import load_vehicle as load_flight_vehicle
from logs.identification.data.flight import Aircraft
from logs.identification.data.maneuvers import find_maneuvers
from logs.identification.models.modes import Mode
from logs.identification.report import identify
from logs.identification.sources.flight import flight_data
from sim_bridge.flight.flight import fly
from sim_bridge.flight.world import Scenario, SimulatedWorld
from sim_bridge.flight_mechanics.averaged import ShortPeriod
from sim_bridge.vehicles import load_vehicle

SWEEP = Excitation(
    Channel.ELEVATOR, Shape.LOGARITHMIC_SWEEP, math.radians(3.0), 8.0, settle=0.9, repeats=1, low=0.5, high=3.0
)
MULTISINE = SWEEP._replace(shape=Shape.MULTISINE, amplitude=math.radians(4.0), width=8.125)
MISSION = (
    MissionItem(ItemKind.TAKEOFF, altitude=40.0),
    MissionItem(ItemKind.HOLD, altitude=40.0, heading=math.radians(60.0), duration=5.5),
    MissionItem(ItemKind.EXCITE, excitation=SWEEP),
    MissionItem(ItemKind.EXCITE, excitation=MULTISINE),
)


class Stated(NamedTuple):
    """What the flight's identification says, and what is true."""

    output_error: Mode
    equation_error: Mode
    true: ShortPeriod


@pytest.fixture(scope="module")
def stated() -> Stated:
    log = MemoryLog()
    flight_vehicle = load_flight_vehicle(RAVEN)
    world = SimulatedWorld(load_vehicle(RAVEN), Scenario(seed=1, duration=68.0), log.publish)
    fly(world, Autopilot(flight_vehicle, MISSION, log.publish), scripted_start())
    said = [event.text for event in log.messages[topics.EVENTS.name]]
    assert any(text.startswith("waypoint 3 ") for text in said), said
    assert not [text for text in said if text.startswith("multisine aliases")]

    airframe = flight_vehicle.airframe
    aircraft = Aircraft(airframe.imu_x, airframe.imu_z, airframe.tail_time_constant)
    found = find_maneuvers(flight_data(log))
    assert [manoeuvre.number for manoeuvre in found] == [1, 2]
    for manoeuvre, width in zip(found, (SWEEP.width, MULTISINE.width), strict=True):
        assert manoeuvre.experiment.time[-1] - manoeuvre.experiment.time[0] == pytest.approx(width + 2 * 0.9, abs=0.5)
    modes = identify(log, "modes", aircraft).modes
    assert modes is not None
    output_error, equation_error = (
        next(mode for mode in modes.modes if mode.method.startswith(method))
        for method in ("output error", "equation error")
    )
    return Stated(output_error, equation_error, true_short_period(RAVEN, log))


@pytest.mark.validate
def test_a_sweep_and_a_multisine_give_the_true_short_period(stated: Stated) -> None:
    mode = stated.equation_error
    assert mode.frequency is not None
    assert mode.frequency.low <= stated.true.natural_frequency <= mode.frequency.high
    assert mode.frequency.high - mode.frequency.low <= 0.1 * mode.frequency.value
    for mode in (stated.output_error, stated.equation_error):
        assert mode.frequency is not None
        assert mode.damping is not None
        assert mode.frequency.value == pytest.approx(stated.true.natural_frequency, rel=0.03)
        assert mode.damping.value == pytest.approx(stated.true.damping, abs=0.08)


@pytest.mark.validate
def test_the_true_short_period_is_within_the_interval_of_output_error(stated: Stated) -> None:
    frequency = stated.output_error.frequency
    assert frequency is not None
    assert frequency.high - frequency.low <= 0.1 * frequency.value
    assert frequency.low <= stated.true.natural_frequency <= frequency.high
