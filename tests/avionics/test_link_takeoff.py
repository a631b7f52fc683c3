"""NAV_TAKEOFF by command: to the altitude that was asked for, counted from where the profile's clients count."""

from __future__ import annotations

import math
from typing import Any

import pytest
from link_vehicle import HOME, FakeVehicle
from link_wires import Voice, Wire

from avionics import topics
from avionics.guidance.mission import ItemKind, MissionItem
from avionics.link.dialect import mavlink
from avionics.link.ground import GroundLink
from avionics.link.vehicle import PROFILES, Identity, Parameter
from avionics.messages import CommandKind, Mode, Stage

PLAN = (
    MissionItem(ItemKind.WAYPOINT, 10.0, 0.0, 40.0),
    MissionItem(ItemKind.TAKEOFF, altitude=40.0),
    MissionItem(ItemKind.RETURN),
)
TAKEOFF = mavlink.MAV_CMD_NAV_TAKEOFF
ACCEPTED, DENIED = mavlink.MAV_RESULT_ACCEPTED, mavlink.MAV_RESULT_DENIED
FROM_THE_SEA = Identity()._replace(takeoff_frame=mavlink.MAV_FRAME_GLOBAL)


class Bench:
    """A vehicle with a plan and a station on one wire."""

    def __init__(self, identity: Identity) -> None:
        self.wire, self.vehicle = Wire("udpin:127.0.0.1:1"), FakeVehicle()
        self.vehicle.mission = PLAN
        self.now = 1.0
        self.vehicle.parameters = [*self.vehicle.parameters, Parameter("NAV_RETURN_FLOOR", 15.0, 0.0, 1000.0)]
        self.link = GroundLink([self.wire], self.vehicle, identity)

    def request(self, message: Any) -> tuple[int, str]:
        """The answer to a command: its result, and what is said with it."""
        self.wire.take()
        self.wire.put(Voice(255).frame(message))
        self.vehicle.apply(self.link.poll(self.now))
        incoming = self.wire.incoming()
        said = "".join(each.text for each in incoming if each.get_type() == "STATUSTEXT")
        return next(each.result for each in incoming if each.get_type() == "COMMAND_ACK"), said

    def long(self, altitude: float, blank: float = 0.0) -> tuple[int, str]:
        return self.request(mavlink.MAVLink_command_long_message(1, 1, TAKEOFF, 0, *(blank,) * 6, altitude))

    def integer(self, frame: int, altitude: float) -> tuple[int, str]:
        return self.request(
            mavlink.MAVLink_command_int_message(1, 1, frame, TAKEOFF, 0, 0, 0, 0, 0, 0, 0, 0, altitude)
        )

    def at(self, stage: Stage, item: int) -> None:
        navigation = self.vehicle.topics[topics.NAVIGATION.name]
        self.vehicle.topics[topics.NAVIGATION.name] = navigation._replace(stage=stage, item=item)

    def mode(self) -> int:
        """Custom mode of the next HEARTBEAT."""
        self.wire.take()
        self.now += 2.0
        self.link.poll(self.now)
        beats = [each for each in self.wire.incoming() if each.get_type() == "HEARTBEAT"]
        return int(beats[-1].custom_mode)

    @property
    def altitude(self) -> float:
        """m; of the take-off that is begun."""
        return self.vehicle.mission[1].altitude


@pytest.mark.parametrize("identity", [*PROFILES.values(), FROM_THE_SEA], ids=[*PROFILES, "from the sea"])
def test_the_altitude_that_is_asked_for_is_flown(identity: Identity) -> None:
    bench = Bench(identity)
    asked = 25.0 + (HOME.altitude if identity.takeoff_frame == mavlink.MAV_FRAME_GLOBAL else 0.0)
    assert bench.long(asked) == (ACCEPTED, "")
    assert bench.vehicle.mission == (PLAN[0], PLAN[1]._replace(altitude=25.0), PLAN[2])
    assert bench.vehicle.mode is Mode.AUTO
    kinds = [each.kind for each in bench.vehicle.inputs]  # type: ignore[union-attr]
    assert kinds == [CommandKind.SET_MISSION, CommandKind.SET_CURRENT_ITEM, CommandKind.SET_MODE]
    assert bench.vehicle.inputs[1].value == 1.0  # type: ignore[union-attr]


@pytest.mark.parametrize("identity", PROFILES.values(), ids=PROFILES)
def test_a_frame_that_is_named_counts_in_every_profile(identity: Identity) -> None:
    bench = Bench(identity)
    assert bench.integer(mavlink.MAV_FRAME_GLOBAL, HOME.altitude + 30.0)[0] == ACCEPTED and bench.altitude == 30.0
    assert bench.integer(mavlink.MAV_FRAME_GLOBAL_RELATIVE_ALT, 20.0)[0] == ACCEPTED and bench.altitude == 20.0


@pytest.mark.parametrize("altitude", [math.nan, 0.0, 40.0])
def test_without_an_altitude_the_plan_s_is_flown_and_the_plan_stays(altitude: float) -> None:
    bench = Bench(Identity())
    assert bench.long(altitude, blank=math.nan) == (ACCEPTED, "")
    assert bench.vehicle.mission is PLAN and bench.vehicle.mode is Mode.AUTO


@pytest.mark.parametrize(("planned", "flight"), [(40.0, 15.0), (12.0, 12.0)])
def test_the_two_metres_of_mavsdk_are_raised_to_where_it_may_turn(planned: float, flight: float) -> None:
    bench = Bench(Identity())
    bench.vehicle.mission = (PLAN[0], PLAN[1]._replace(altitude=planned), PLAN[2])
    assert bench.long(2.0, blank=math.nan) == (ACCEPTED, f"takeoff: to {flight:g} m, 2 m is too low to turn")
    assert bench.altitude == flight


@pytest.mark.parametrize(
    ("identity", "altitude", "why"),
    [
        (Identity(), math.inf, "takeoff: an item has no altitude"),
        (FROM_THE_SEA, HOME.altitude - 1.0, "altitude"),
        (Identity(), -5.0, "altitude"),
        (Identity(), 5000.0, "altitude"),
    ],
)
def test_what_cannot_be_flown_is_refused_with_the_reason(identity: Identity, altitude: float, why: str) -> None:
    bench = Bench(identity)
    bench.vehicle.refusals[CommandKind.SET_MISSION] = "altitude out of range"
    result, said = bench.long(altitude)
    assert result == DENIED and said.startswith(why)
    assert bench.vehicle.inputs == [] and bench.vehicle.mission is PLAN


def test_an_altitude_from_the_sea_waits_for_home() -> None:
    bench = Bench(FROM_THE_SEA)
    bench.vehicle.home = None
    assert bench.long(600.0) == (DENIED, "takeoff: home is not known yet: wait for the GPS")
    assert bench.long(math.nan)[0] == ACCEPTED


@pytest.mark.parametrize("identity", PROFILES.values(), ids=PROFILES)
@pytest.mark.parametrize(("requested", "expected"), [(40.0, 40.0), (2.0, 15.0), (math.nan, 15.0)])
def test_without_a_mission_it_takes_off_and_circles_at_home(
    identity: Identity, requested: float, expected: float
) -> None:
    bench = Bench(identity)
    bench.vehicle.mission = ()
    sea = HOME.altitude if identity.takeoff_frame == mavlink.MAV_FRAME_GLOBAL else 0.0
    assert bench.long(sea + requested) == (ACCEPTED, f"takeoff: to {expected:g} m, then LOITER at home")
    takeoff, circle = bench.vehicle.mission
    assert (takeoff.kind, takeoff.altitude) == (ItemKind.TAKEOFF, expected)
    assert (circle.kind, circle.north, circle.east, circle.altitude) == (ItemKind.LOITER, 0.0, 0.0, expected)
    assert bench.vehicle.mode is Mode.AUTO


def test_without_a_mission_and_a_position_it_does_not_take_off() -> None:
    bench = Bench(Identity())
    bench.vehicle.mission, bench.vehicle.home = (), None
    assert bench.long(30.0) == (mavlink.MAV_RESULT_TEMPORARILY_REJECTED, "takeoff: no GPS position")
    assert bench.vehicle.inputs == []


@pytest.mark.parametrize("identity", PROFILES.values(), ids=PROFILES)
def test_takeoff_mode_is_reported_until_the_takeoff_item_ends(identity: Identity) -> None:
    bench = Bench(identity)
    bench.at(stage=Stage.WAIT_LAUNCH, item=1)
    result, text = bench.long(math.nan)
    assert (result, text) == (ACCEPTED, "takeoff waits for the throw")
    assert bench.mode() == identity.takeoff.custom_mode
    bench.at(stage=Stage.CLIMB_OUT, item=1)
    assert bench.mode() == identity.takeoff.custom_mode
    bench.at(stage=Stage.EN_ROUTE, item=2)
    assert bench.mode() == identity.numbers(Mode.AUTO).custom_mode
    bench.at(stage=Stage.CLIMB_OUT, item=1)
    assert bench.mode() == identity.numbers(Mode.AUTO).custom_mode, "a mission that comes back to it is a mission"


@pytest.mark.parametrize("identity", PROFILES.values(), ids=PROFILES)
def test_takeoff_mode_can_be_set_and_another_mode_ends_it(identity: Identity) -> None:
    bench = Bench(identity)
    bench.at(stage=Stage.WAIT_LAUNCH, item=1)
    number = float(identity.takeoff.custom_mode)
    set_mode = mavlink.MAVLink_command_long_message(1, 1, mavlink.MAV_CMD_DO_SET_MODE, 0, 1.0, number, 0, 0, 0, 0, 0)
    assert bench.request(set_mode)[0] == ACCEPTED and bench.vehicle.mode is Mode.AUTO
    assert bench.mode() == identity.takeoff.custom_mode
    bench.vehicle.mode = Mode.MANUAL
    assert bench.mode() == identity.numbers(Mode.MANUAL).custom_mode
