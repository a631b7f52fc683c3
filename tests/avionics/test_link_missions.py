"""Missions as ground stations send them: before the first fix, with home first, "here", and without altitudes."""

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
from avionics.link.mission_codec import decode_fence, to_degrees, to_metres
from avionics.link.vehicle import PROFILES, Home, Identity
from avionics.link.wire_item import ItemRefused, WireItem
from avionics.messages import CommandKind, Mode, Stage
from avionics.missions.reader import check_mission

ACCEPTED = mavlink.MAV_MISSION_ACCEPTED
GLOBAL, RELATIVE = mavlink.MAV_FRAME_GLOBAL, mavlink.MAV_FRAME_GLOBAL_RELATIVE_ALT
HERE, NAN, NO_INTEGER = (0.0, 0.0), math.nan, 2**31 - 1
NEAR = to_degrees(HOME, 60.0, -40.0)
PLACE_OF_HOME = to_degrees(HOME, 0.0, 0.0)


class Bench:
    """A vehicle and a station that uploads and downloads, in the time of the test."""

    def __init__(self, identity: Identity, home: bool = True) -> None:
        self.wire, self.vehicle, self.now = Wire("udpin:127.0.0.1:1"), FakeVehicle(), 1.0
        self.vehicle.home = HOME if home else None
        self.identity = identity
        self.link = GroundLink([self.wire], self.vehicle, identity)
        self.texts: list[str] = []

    def send(self, message: Any) -> list[Any]:
        """What is answered to a message and within the next 10 ms."""
        self.wire.take()
        self.wire.put(Voice(255).frame(message))
        return self.pass_time() + self.pass_time()

    def pass_time(self) -> list[Any]:
        self.now += 0.01
        self.vehicle.apply(self.link.poll(self.now))
        incoming = self.wire.incoming()
        self.texts += [each.text for each in incoming if each.get_type() == "STATUSTEXT"]
        return incoming

    def upload(self, *items: tuple[int, int, tuple[float, ...], tuple[float, float], float]) -> list[int]:
        """Send items of frame, command, parameters, place and altitude; the results that are answered."""
        listed = list(items)
        if self.identity.first_item:
            listed.insert(0, (GLOBAL, 16, (0.0, 0.0, 0.0, 0.0), PLACE_OF_HOME, HOME.altitude))
        answers = self.send(mavlink.MAVLink_mission_count_message(1, 1, len(listed), 0))
        results = []
        for _ in range(3 * len(listed)):
            requests = [each for each in answers if each.get_type().startswith("MISSION_REQUEST")]
            results += [each.type for each in answers if each.get_type() == "MISSION_ACK"]
            if not requests:
                return results
            number = requests[-1].seq
            answers = self.send(integer(number, *listed[number]))
        return results

    def download(self) -> list[Any]:
        count = next(
            each
            for each in self.send(mavlink.MAVLink_mission_request_list_message(1, 1, 0))
            if each.get_type() == "MISSION_COUNT"
        ).count
        return [
            next(
                each
                for each in self.send(mavlink.MAVLink_mission_request_int_message(1, 1, number, 0))
                if each.get_type() == "MISSION_ITEM_INT"
            )
            for number in range(self.identity.first_item, count)
        ]


def integer(number: int, frame: int, command: int, params: Any, place: tuple[float, float], z: float) -> Any:
    x, y = (NO_INTEGER if math.isnan(value) else round(value * 1e7) for value in place)
    return mavlink.MAVLink_mission_item_int_message(1, 1, number, frame, command, 0, 1, *params, x, y, z, 0)


def waypoint(place: tuple[float, float], z: float, frame: int = RELATIVE) -> Any:
    return frame, 16, (0.0, 0.0, 0.0, NAN), place, z


TAKEOFF = (RELATIVE, 22, (0.0, 0.0, 0.0, NAN), HERE, 40.0)
identities = pytest.mark.parametrize("identity", PROFILES.values(), ids=PROFILES)


@identities
def test_mission_before_the_first_fix_is_accepted_and_placed_once_home_is_known(identity: Identity) -> None:
    bench = Bench(identity, home=False)
    assert bench.upload(TAKEOFF, waypoint(NEAR, 40.0)) == [ACCEPTED]
    assert bench.vehicle.mission == ()
    assert [each.command for each in bench.download()] == [22, 16]
    bench.vehicle.home = HOME
    answers = [each for _ in range(3) for each in bench.pass_time()]
    assert [each.kind for each in bench.vehicle.mission] == [ItemKind.TAKEOFF, ItemKind.WAYPOINT]
    assert bench.vehicle.mission[1][1:4] == pytest.approx((60.0, -40.0, 40.0), abs=0.02)
    assert "MISSION_ACK" not in [each.get_type() for each in answers], "it was answered at the upload"


def test_mission_that_home_shows_to_be_far_away_is_refused_with_its_reason_when_home_is_known() -> None:
    bench = Bench(PROFILES["px4"], home=False)
    assert bench.upload(TAKEOFF, waypoint((NEAR[0] + 2.0, NEAR[1]), 40.0)) == [ACCEPTED]
    bench.vehicle.home = HOME
    bench.pass_time()
    assert bench.vehicle.mission == () and bench.download() == []
    assert "an item is over 100 km from home" in " ".join(bench.texts)


def test_items_that_no_home_can_place_are_refused_at_once() -> None:
    bench = Bench(PROFILES["px4"], home=False)
    far = waypoint((NEAR[0] + 2.0, NEAR[1]), 40.0)
    assert bench.upload(waypoint(NEAR, 40.0), far) == [mavlink.MAV_MISSION_INVALID_PARAM5_X]
    bench.vehicle.home = HOME
    bench.pass_time()
    assert bench.vehicle.mission == ()


def test_clearing_and_another_upload_replace_what_waits_for_home() -> None:
    bench = Bench(PROFILES["px4"], home=False)
    bench.upload(TAKEOFF, waypoint(NEAR, 40.0))
    answers = bench.send(mavlink.MAVLink_mission_clear_all_message(1, 1, 0))
    assert [each.type for each in answers if each.get_type() == "MISSION_ACK"] == [ACCEPTED]
    bench.upload(TAKEOFF, waypoint(NEAR, 40.0))
    assert bench.upload((mavlink.MAV_FRAME_MISSION, 20, (0.0,) * 4, HERE, 0.0)) == [ACCEPTED]
    bench.vehicle.home = HOME
    bench.pass_time()
    assert [each.kind for each in bench.vehicle.mission] == [ItemKind.RETURN]


@identities
@pytest.mark.parametrize("place", [HERE, (NAN, NAN)])
@pytest.mark.parametrize("command", [16, 17, 18, 19, 31, 21])
def test_an_item_without_a_place_is_here(identity: Identity, place: tuple[float, float], command: int) -> None:
    bench = Bench(identity)
    params = (2.0 if command in (18, 19) else 0.0, 0.0, 0.0, NAN)
    assert bench.upload(TAKEOFF, (RELATIVE, command, params, place, 40.0)) == [ACCEPTED]
    item = bench.vehicle.mission[1]
    assert (item.here, item.north, item.east) == (1, 0.0, 0.0)
    back = bench.download()[1]
    assert (back.command, back.x, back.y) == (command, *((NO_INTEGER,) * 2 if math.isnan(place[0]) else (0, 0)))


def test_an_item_without_an_altitude_has_that_of_the_item_before() -> None:
    bench = Bench(PROFILES["px4"])
    sea = waypoint(NEAR, HOME.altitude + 55.0, GLOBAL)
    assert bench.upload(TAKEOFF, waypoint(NEAR, NAN), sea, waypoint(NEAR, NAN)) == [ACCEPTED]
    assert [each.altitude for each in bench.vehicle.mission] == [40.0, 40.0, 55.0, 55.0]
    assert bench.upload(waypoint(NEAR, NAN)) == [mavlink.MAV_MISSION_INVALID_PARAM7]


@identities
def test_download_returns_every_parameter_as_it_was_sent(identity: Identity) -> None:
    bench = Bench(identity)
    items = (
        (RELATIVE, 22, (15.0, 0.0, 0.0, NAN), NEAR, 40.0),
        (mavlink.MAV_FRAME_MISSION, 205, (NAN, 0.0, 7.0, NAN), HERE, 2.0),
        (mavlink.MAV_FRAME_GLOBAL_TERRAIN_ALT, 16, (0.0, 3.0, 2.0, 10.0), NEAR, 40.0),
        (RELATIVE, 21, (0.0, 0.0, 0.0, 0.0), NEAR, 0.0),
    )
    assert bench.upload(*items) == [ACCEPTED]
    for got, sent in zip(bench.download(), items, strict=True):
        expected = (*sent[:2], *sent[2], sent[4])
        assert (got.frame, got.command, got.param1, got.param2, got.param3, got.param4, got.z) == pytest.approx(
            expected, nan_ok=True
        )
    bench.vehicle.mission = bench.vehicle.mission[:2]  # changed on board: what is there counts
    assert [each.command for each in bench.download()] == [22, 205]


def test_home_of_the_client_and_home_of_the_file_are_both_not_flown() -> None:
    bench = Bench(PROFILES["ardupilot"])
    assert bench.upload(waypoint(PLACE_OF_HOME, HOME.altitude, GLOBAL), TAKEOFF) == [ACCEPTED]
    assert [each.kind for each in bench.vehicle.mission] == [ItemKind.SKIP, ItemKind.TAKEOFF]


@identities
def test_chosen_item_is_answered_with_its_number_at_once(identity: Identity) -> None:
    bench = Bench(identity)
    bench.upload(TAKEOFF, waypoint(NEAR, 40.0))
    for number in (0, 1, 1 + identity.first_item):
        answers = bench.send(mavlink.MAVLink_mission_set_current_message(1, 1, number))
        assert next(each.seq for each in answers if each.get_type() == "MISSION_CURRENT") == number
    answers = bench.send(mavlink.MAVLink_mission_set_current_message(1, 1, 2 + identity.first_item))
    assert "there is no mission item" in bench.texts[-1]


@pytest.mark.parametrize("name", ["px4", "generic"])
@pytest.mark.parametrize(("place", "altitude"), [(PLACE_OF_HOME, HOME.altitude), (PLACE_OF_HOME, 522.0), (HERE, 0.0)])
def test_home_first_is_kept_in_its_place_and_not_flown(
    name: str, place: tuple[float, float], altitude: float
) -> None:
    bench = Bench(PROFILES[name])
    assert bench.upload(waypoint(place, altitude, GLOBAL), TAKEOFF, waypoint(NEAR, 40.0)) == [ACCEPTED]
    kinds = [each.kind for each in bench.vehicle.mission]
    assert kinds == [ItemKind.SKIP, ItemKind.TAKEOFF, ItemKind.WAYPOINT]
    first = bench.download()[0]
    assert (first.frame, first.command, first.z) == (GLOBAL, 16, altitude)
    assert (first.x, first.y) == pytest.approx((place[0] * 1e7, place[1] * 1e7), abs=1)


def test_first_waypoint_in_the_air_is_flown() -> None:
    bench = Bench(PROFILES["px4"])
    assert bench.upload(waypoint(PLACE_OF_HOME, HOME.altitude + 40.0, GLOBAL)) == [ACCEPTED]
    assert bench.vehicle.mission[0].kind is ItemKind.WAYPOINT


@identities
@pytest.mark.parametrize("heading", [0.0, NAN])
def test_landing_without_a_heading_continues_from_the_position_before(identity: Identity, heading: float) -> None:
    bench = Bench(identity)
    west = to_degrees(HOME, 60.0, -140.0)
    land = (RELATIVE, 21, (0.0, 0.0, 0.0, heading), west, 0.0)
    assert bench.upload(TAKEOFF, waypoint(NEAR, 40.0), land) == [ACCEPTED]
    assert bench.vehicle.mission[-1].heading == pytest.approx(-math.pi / 2, abs=1e-3)
    north = (RELATIVE, 21, (0.0, 0.0, 0.0, 360.0), west, 0.0)
    assert bench.upload(TAKEOFF, waypoint(NEAR, 40.0), north) == [ACCEPTED]
    assert bench.vehicle.mission[-1].heading == pytest.approx(0.0, abs=1e-9)
    assert bench.download()[-1].param4 == 360.0


def test_parameter_that_no_message_can_carry_is_refused() -> None:
    bench = Bench(PROFILES["px4"])
    bench.send(mavlink.MAVLink_mission_count_message(1, 1, 1, 0))
    roi = mavlink.MAVLink_mission_item_message(1, 1, 0, 2, 201, 0, 1, 0.0, 0.0, 0.0, 0.0, 3e9, 0.0, 0.0, 0)
    acks = [each.type for each in bench.send(roi) if each.get_type() == "MISSION_ACK"]
    assert acks == [mavlink.MAV_MISSION_INVALID_PARAM5_X]


def test_fence_that_waits_for_home_does_not_stop_a_mission_upload() -> None:
    bench = Bench(PROFILES["px4"], home=False)
    fence = [mavlink.MAVLink_mission_item_int_message(
        1, 1, number, 3, 5001, 0, 1, 3.0, 0, 0, 0, round((NEAR[0] + north) * 1e7), round((NEAR[1] + east) * 1e7), 0, 1
    ) for number, (north, east) in enumerate(((-0.01, -0.01), (0.01, 0.0), (-0.01, 0.01)))]  # fmt: skip
    bench.send(mavlink.MAVLink_mission_count_message(1, 1, 3, 1))
    for item in fence:
        bench.send(item)
    bench.send(mavlink.MAVLink_mission_count_message(1, 1, 2, 0))
    bench.send(integer(0, *TAKEOFF))
    bench.vehicle.home = HOME
    bench.pass_time()
    assert len(bench.vehicle.fence.zones) == 1
    answers = bench.send(integer(1, *waypoint(NEAR, 40.0)))
    assert [each.type for each in answers if each.get_type() == "MISSION_ACK"] == [ACCEPTED]


def test_clearing_everything_clears_what_waits_for_home() -> None:
    bench = Bench(PROFILES["px4"], home=False)
    bench.upload(TAKEOFF, waypoint(NEAR, 40.0))
    bench.send(mavlink.MAVLink_mission_clear_all_message(1, 1, 255))
    bench.vehicle.home = HOME
    bench.pass_time()
    assert bench.vehicle.mission == ()


def test_takeoff_in_the_place_of_home_is_named() -> None:
    bench = Bench(PROFILES["ardupilot"]._replace(first_item=1))
    bench.identity = PROFILES["px4"]  # so that the station sends no home
    assert bench.upload(TAKEOFF, waypoint(NEAR, 40.0)) == [ACCEPTED]
    assert "item 0 is home and not flown: it was NAV_TAKEOFF (22)" in "".join(bench.texts)


def test_position_across_the_date_line_is_near() -> None:
    fiji = Home(math.radians(-17.0), math.radians(179.9995), 5.0)
    north, east = to_metres(fiji, -17.0, -179.9995)
    assert (north, east) == pytest.approx((0.0, 106.5), abs=1.0)
    assert to_degrees(fiji, north, east)[1] == pytest.approx(-179.9995)


@pytest.mark.parametrize("change", [(5002, 4.0), (5001, 3.0)])
def test_corners_of_one_polygon_have_one_command_and_one_count(change: tuple[int, float]) -> None:
    corners = [WireItem(3, 5001, (4.0, 0.0, 0.0, 0.0), NEAR[0] + n, NEAR[1] + e, 0.0)
               for n, e in ((-0.01, -0.01), (0.01, -0.01), (0.01, 0.01), (-0.01, 0.01))]  # fmt: skip
    assert len(decode_fence(corners, HOME).zones) == 1
    corners[2] = corners[2]._replace(command=change[0], params=(change[1], 0.0, 0.0, 0.0))
    with pytest.raises(ItemRefused, match="one command and one count"):
        decode_fence(corners, HOME)


def test_jump_loop_without_an_item_to_fly_is_refused() -> None:
    skip, takeoff = MissionItem(ItemKind.SKIP), MissionItem(ItemKind.TAKEOFF, altitude=20.0)
    jump = MissionItem(ItemKind.JUMP, jump_to=1, repeats=-1)
    assert "leads back to itself" in check_mission((takeoff, *[skip] * 497, jump._replace(repeats=-1)))
    assert "leads back to itself" in check_mission((takeoff, jump._replace(jump_to=2), jump))
    assert check_mission((takeoff, MissionItem(ItemKind.WAYPOINT, altitude=20.0), skip, jump)) == ""


@identities
def test_takeoff_by_set_mode_and_standard_mode(identity: Identity) -> None:
    bench = Bench(identity)
    bench.upload(TAKEOFF, waypoint(NEAR, 40.0))
    for message in (
        mavlink.MAVLink_set_mode_message(1, 1, identity.takeoff.custom_mode),
        mavlink.MAVLink_command_long_message(1, 1, 262, 0, 8.0, 0, 0, 0, 0, 0, 0),
    ):
        bench.vehicle.mode = Mode.MANUAL
        answers = bench.send(message)
        assert [each.result for each in answers if each.get_type() == "COMMAND_ACK"] == [mavlink.MAV_RESULT_ACCEPTED]
        assert bench.vehicle.mode is Mode.AUTO


def test_hold_mode_is_denied_to_a_vehicle_armed_for_its_mission() -> None:
    bench = Bench(PROFILES["px4"])
    vehicle = bench.vehicle
    navigation = vehicle.topics[topics.NAVIGATION.name]
    vehicle.topics[topics.NAVIGATION.name] = navigation._replace(stage=Stage.WAIT_LAUNCH)
    vehicle.refusals[CommandKind.SET_MODE] = "not in flight"
    hold = mavlink.MAVLink_command_long_message(1, 1, mavlink.MAV_CMD_DO_SET_MODE, 0, 1.0, 4.0, 3.0, 0, 0, 0, 0)
    for armed, mode, accepted in ((True, Mode.AUTO, False), (False, Mode.AUTO, True), (True, Mode.MANUAL, True)):
        vehicle.armed, vehicle.mode = armed, mode
        result = next(each.result for each in bench.send(hold) if each.get_type() == "COMMAND_ACK")
        assert (result == mavlink.MAV_RESULT_ACCEPTED) is accepted


def test_interval_beyond_the_field_is_answered() -> None:
    bench = Bench(PROFILES["px4"])
    bench.send(mavlink.MAVLink_command_long_message(1, 1, 511, 0, 30.0, 1e10, 0, 0, 0, 0, 0))
    answers = bench.send(mavlink.MAVLink_command_long_message(1, 1, 510, 0, 30.0, 0, 0, 0, 0, 0, 0))
    assert next(each.interval_us for each in answers if each.get_type() == "MESSAGE_INTERVAL") == 2**31 - 1


def test_reposition_in_the_local_frame_is_in_its_unit() -> None:
    bench = Bench(PROFILES["px4"])
    bench.send(mavlink.MAVLink_command_int_message(1, 1, 1, 192, 0, 0, -1.0, 1.0, 0, NAN, 500_000, -200_000, -30.0))
    (circle,) = [each for each in bench.vehicle.inputs if getattr(each, "kind", None) is CommandKind.LOITER_AT]
    assert (circle.payload.north, circle.payload.east) == pytest.approx((50.0, -20.0))
