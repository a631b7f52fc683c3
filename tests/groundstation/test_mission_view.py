"""A mission's items in words and units, and in SI for programs."""

from __future__ import annotations

import math

import pytest

from avionics.guidance.mission import Channel, Excitation, ItemKind, MissionItem, Shape
from avionics.link.dialect import mavlink
from avionics.link.mission_codec import encode_item
from avionics.link.vehicle import Home
from groundstation.link.missions import Item
from groundstation.link.waypoints import item_of
from groundstation.views.mission import item_view, mission_record, print_mission

HOME = Home(math.radians(39.0), math.radians(-77.0), 40.0)
DOUBLET = Excitation(Channel.ELEVATOR, Shape.DOUBLET, math.radians(5.0), 0.25, 2.0, 1)
SWEEP = Excitation(Channel.THROTTLE, Shape.LINEAR_SWEEP, 0.1, 20.0, 1.0, 2, 0.3, 2.5, loops=1)
MULTISINE = Excitation(
    Channel.ELEVATOR, Shape.MULTISINE, math.radians(3.0), 10.0, 2.0, 2, 0.3, 2.5, (0.0, 0.0, math.radians(5.0)), 1
)


def sent(item: MissionItem, home: Home | None = None) -> Item:
    """As a vehicle's download has it."""
    return item_of(encode_item(item, home))


@pytest.mark.parametrize(
    ("item", "words"),
    [
        (MissionItem(ItemKind.TAKEOFF, altitude=40.0), "take off to 40 m"),
        (MissionItem(ItemKind.WAYPOINT, 30.0, -5.0, 25.0), "fly to +30.0 m N -5.0 m E 25 m"),
        (MissionItem(ItemKind.LOITER, 1.0, 2.0, 40.0, radius=-20.0), "circle without end +1.0 m N +2.0 m E 40 m"
         " radius 20 m counter-clockwise"),
        (MissionItem(ItemKind.CIRCLE, 1.0, 2.0, 40.0, radius=30.0, turns=1.0), "circle +1.0 m N +2.0 m E 40 m"
         " 1 turn radius 30 m"),
        (MissionItem(ItemKind.CIRCLE, 1.0, 2.0, 40.0, duration=12.5), "circle +1.0 m N +2.0 m E 40 m for 12.5 s"),
        (MissionItem(ItemKind.CIRCLE, 1.0, 2.0, 60.0, radius=15.0), "circle to altitude +1.0 m N +2.0 m E 60 m"
         " radius 15 m"),
        (MissionItem(ItemKind.HOLD, altitude=40.0, heading=math.radians(270.0), duration=8.0), "hold course 40 m"
         " for 8 s heading 270°"),
        (MissionItem(ItemKind.LAND, 10.0, 20.0, heading=0.0), "land +10.0 m N +20.0 m E 0 m heading 000°"),
        (MissionItem(ItemKind.RETURN), "return to launch"),
        (MissionItem(ItemKind.JUMP, jump_to=3, repeats=2), "go on with item 3 2 times"),
        (MissionItem(ItemKind.JUMP, jump_to=3, repeats=-1), "go on with item 3 for ever"),
        (MissionItem(ItemKind.EXCITE, excitation=DOUBLET), "doublet elevator ±5.0° steps of 0.25 s settling 2 s"
         " 1 time loops frozen"),
        (MissionItem(ItemKind.EXCITE, excitation=SWEEP), "linear sweep throttle ±0.10 0.3 to 2.5 Hz over 20 s"
         " settling 1 s 2 times loops active"),
        (MissionItem(ItemKind.EXCITE, excitation=MULTISINE), "multisine elevator ±3.0° rudder ±5.0° 0.3 to 2.5 Hz"
         " period 10 s settling 2 s 2 times loops active"),
    ],
)  # fmt: skip
def test_an_item_is_one_row_of_words_and_units(
    item: MissionItem, words: str, capsys: pytest.CaptureFixture[str]
) -> None:
    print_mission([sent(item)])
    row = capsys.readouterr().out.splitlines()[1]
    assert " ".join(row.split()) == f"0 {words}"


def test_a_place_on_the_globe_and_above_which_ground() -> None:
    item = sent(MissionItem(ItemKind.WAYPOINT, 100.0, 0.0, 40.0), HOME)
    said = item_view(item)
    assert said.latitude == pytest.approx(HOME.latitude + 100.0 / 6_378_137.0, abs=1e-9)
    assert said.longitude == pytest.approx(HOME.longitude) and said.north is None
    assert (said.altitude, said.altitude_above) == (40.0, "home")
    assert item_view(item._replace(frame=mavlink.MAV_FRAME_GLOBAL_INT)).altitude_above == "sea"
    assert item_view(item._replace(frame=mavlink.MAV_FRAME_GLOBAL_TERRAIN_ALT_INT)).altitude_above == "terrain"


def test_local_axes_are_told_apart() -> None:
    item = Item(mavlink.MAV_FRAME_LOCAL_NED, 16, (0.0, 0.0, 0.0, math.nan), 100_000, 50_000, -30.0)
    assert item_view(item)[1:3] == (10.0, 5.0) and item_view(item).altitude == 30.0
    other = item_view(item._replace(frame=mavlink.MAV_FRAME_LOCAL_ENU, z=30.0))
    assert (other.north, other.east, other.altitude) == (5.0, 10.0, 30.0)


def test_a_foreign_waypoint_waits_and_an_unknown_command_shows_what_came(capsys: pytest.CaptureFixture[str]) -> None:
    print_mission(
        [Item(3, 16, (4.0, 6.0, 0.0, math.nan), 1, 2, 40.0), Item(2, 206, (25.0, 0.0, 1.0, math.nan), 0, 0, 0.0)]
    )
    waypoint, camera = capsys.readouterr().out.splitlines()[1:]
    assert "for 4 s" in waypoint and "reached within 6 m" in waypoint
    assert "do set cam trigg dist" in camera and "parameter 1 25  parameter 3 1" in camera


def test_parameters_of_a_camera_are_no_position(capsys: pytest.CaptureFixture[str]) -> None:
    """GIVEN camera commands in a frame of the globe THEN only what a camera is aimed at is a position."""
    values = (0.0, 2.0, 0.0, 0.0)
    camera = Item(3, mavlink.MAV_CMD_IMAGE_START_CAPTURE, values, 10_000_000, 20_000_000, 5.0)
    aimed = Item(3, mavlink.MAV_CMD_DO_SET_ROI_LOCATION, values, 481_000_000, 116_000_000, 5.0)
    print_mission([camera, aimed])
    rows = capsys.readouterr().out.splitlines()[1:]
    assert "parameter 2 2  parameter 5 1  parameter 6 2  parameter 7 5" in rows[0] and "°" not in rows[0]
    assert "48.100000°  11.600000°" in rows[1] and "5 m" in rows[1]
    assert mission_record(0, camera)["latitude"] is None


def test_speed_and_landing_sequence_are_one_row_each(capsys: pytest.CaptureFixture[str]) -> None:
    speed, own, start = (MissionItem(ItemKind.SPEED, airspeed=value) for value in (8.5, 0.0, 0.0))
    print_mission([sent(speed), sent(own), sent(start._replace(kind=ItemKind.LAND_START))])
    rows = [" ".join(row.split()) for row in capsys.readouterr().out.splitlines()[1:]]
    assert rows == ["0 change airspeed 8.5 m/s", "1 default airspeed", "2 landing sequence"]


def test_numbers_for_programs_are_si_and_radians() -> None:
    record = mission_record(4, sent(MissionItem(ItemKind.EXCITE, excitation=MULTISINE)))
    assert (record["number"], record["command"], record["frame"]) == (4, mavlink.MAV_CMD_WINGBEAT_EXCITE_MULTISINE, 2)
    asked = record["excitation"]
    assert (asked["shape"], asked["width"], asked["low"], asked["high"]) == ("MULTISINE", 10.0, 0.3, 2.5)
    assert asked["elevator"] == pytest.approx(math.radians(3.0)) and asked["throttle"] == 0.0
    hold = mission_record(0, sent(MissionItem(ItemKind.HOLD, altitude=40.0, heading=1.0, duration=8.0)))
    assert (hold["duration"], hold["altitude"], hold["latitude"]) == (8.0, 40.0, None)
    assert hold["heading"] == pytest.approx(1.0)


def test_an_altitude_is_told_to_the_centimetre_at_most(capsys: pytest.CaptureFixture[str]) -> None:
    print_mission([Item(0, 16, (0.0,) * 4, 389_899_700, -769_400_040, 20.1949), Item(3, 16, (0.0,) * 4, 0, 0, 40.0)])
    rows = capsys.readouterr().out.splitlines()[1:]
    assert "  20.19 m above the sea" in rows[0] and "  40 m" in rows[1]
