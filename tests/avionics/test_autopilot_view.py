"""The flight computer as the ground link reads it."""

import math

import pytest
from surrogate import HOME, Bird
from surrogate_gains import VEHICLE

from avionics import topics
from avionics.link.vehicle import VehicleView
from avionics.messages import Command, CommandKind, Mode
from avionics.missions import load_mission
from avionics.view import FlightView

ARM = Command(0, CommandKind.ARM)


def simulate(seconds: float, commands=()) -> FlightView:
    view, bird = (
        FlightView(VEHICLE, load_mission("circuit"), lambda topic, message: None),
        Bird(),
    )
    for _ in range(round(seconds * 200)):
        bird.advance(view.autopilot.step(bird.frame(), commands))
        commands = ()
    return view


def test_it_is_what_the_link_asks_for() -> None:
    view: VehicleView = simulate(3.0)
    assert view.time_us == view.latest(topics.IMU).time_us
    assert (view.mode, view.armed, view.mission) == (Mode.MANUAL, False, load_mission("circuit"))
    assert view.latest(topics.DRIVE_TORQUE) is None
    home = view.home
    assert home is not None
    assert home.latitude == pytest.approx(HOME[0], abs=1e-7)
    assert home.altitude == pytest.approx(301.6, abs=0.5)


def test_there_is_no_home_before_a_fix() -> None:
    assert simulate(0.02).home is None


def test_parameters_keep_their_order_and_show_new_values() -> None:
    view = simulate(0.1)
    before = view.parameters
    command = Command(0, CommandKind.SET_PARAMETER, "ROLL_P", 2.0)
    assert view.refusal(command) == ""
    assert view.parameters == before
    view = simulate(0.1, (command,))
    assert [entry.name for entry in view.parameters] == [entry.name for entry in before]
    changed = [entry for entry, old in zip(view.parameters, before, strict=True) if entry != old]
    assert [(entry.name, entry.value) for entry in changed] == [("ROLL_P", 2.0)]


@pytest.mark.parametrize(
    ("command", "word"),
    [
        (ARM, "attitude not aligned: hold still"),
        (Command(0, CommandKind.SET_PARAMETER, "ROLL_P", math.nan), "not a number"),
        (Command(0, CommandKind.SET_MODE, "RETURN"), "no GPS position"),
    ],
)
def test_a_refusal_is_told_and_nothing_happens(command: Command, word: str) -> None:
    view = simulate(0.03)
    before, events = view.autopilot.state, view.events(0)
    assert word in view.refusal(command)
    assert view.autopilot.state == before
    assert view.events(0) == events


def test_what_would_be_taken_is_not_refused_and_not_done() -> None:
    view = simulate(3.0)
    assert view.refusal(Command(0, CommandKind.SET_MODE, "STABILIZED")) == ""
    assert view.refusal(ARM) == ""
    assert view.armed is False
    assert simulate(3.0, ()).events(10**6) == []
