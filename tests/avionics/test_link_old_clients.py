"""Stations that know less: MAVLink 1, MISSION_REQUEST, LOG_*; and what mavros and dronekit wait for."""

from __future__ import annotations

import itertools
import math
import os
import struct
from pathlib import Path
from typing import Any

import pytest
from link_vehicle import FakeVehicle
from link_wires import Voice, Wire
from pymavlink.dialects.v10 import ardupilotmega as version_1

from avionics import messages as m
from avionics import topics
from avionics.guidance.mission import ItemKind, MissionItem, landing_sequence
from avionics.link.channel import VERSION_MEMORY
from avionics.link.dialect import mavlink
from avionics.link.framing import MARKER_V1, MARKER_V2
from avionics.link.ground import Files, GroundLink
from avionics.link.signing import Signing
from avionics.link.stream_table import STREAMS
from avionics.messages import Failsafe
from avionics.missions import check_mission

ROLL_RATE, VELOCITY = 0.25, (6.0, 2.0, -0.5)


class Station:
    """A vehicle with one link, and a station whose clock the test moves."""

    def __init__(
        self, logs: Path | None = None, url: str = "udpin:127.0.0.1:1", signing: Signing | None = None
    ) -> None:
        self.wire, self.vehicle = Wire(url), FakeVehicle()
        self.link = GroundLink([self.wire], self.vehicle, files=Files(logs=logs, signing=signing))
        self.now = 0.0

    def pass_time(self, duration: float) -> None:
        for _ in range(round(duration / 0.02)):
            self.now += 0.02
            self.vehicle.apply(self.link.poll(self.now))
            self.link.stream(self.now)

    def exchange(self, frame: bytes, duration: float = 0.1) -> list[Any]:
        self.wire.take()
        self.wire.put(frame)
        self.pass_time(duration)
        return self.wire.incoming()


class OldVoice:
    """Packs with pymavlink's own MAVLink 1."""

    def __init__(self) -> None:
        self._mav = version_1.MAVLink(None, 255, 190)

    def frame(self, message: Any) -> bytes:
        return bytes(message.pack(self._mav))


def of(messages: list[Any], kind: str) -> list[Any]:
    return [each for each in messages if each.get_type() == kind]


def in_version_1(sent: list[Any]) -> list[Any]:
    """What pymavlink's MAVLink 1 parser reads of the frames."""
    parser = version_1.MAVLink(None)
    return [message for each in sent for message in parser.parse_buffer(bytearray(each.data)) or []]


def test_a_mavlink_1_station_is_answered_in_mavlink_1() -> None:
    station, old = Station(), OldVoice()
    station.pass_time(0.5)
    assert {each.data[0] for each in station.wire.take()} == {MARKER_V2}, "to nobody in particular: MAVLink 2"
    station.wire.put(old.frame(version_1.MAVLink_heartbeat_message(6, 8, 0, 0, 4, 3)))
    station.wire.put(old.frame(version_1.MAVLink_param_request_read_message(1, 1, b"CLIMB_P", -1)))
    station.pass_time(3.0)
    sent = station.wire.take()
    assert {each.data[0] for each in sent} == {MARKER_V1}
    read = in_version_1(sent)
    assert len(read) == len(sent), "every frame is whole, with a correct checksum"
    assert of(read, "PARAM_VALUE")[0].param_value == pytest.approx(0.1)
    gps, attitude = of(read, "GPS_RAW_INT")[0], of(read, "ATTITUDE")[0]
    assert (gps.fix_type, gps.satellites_visible) == (3, 9) and attitude.roll == pytest.approx(0.1)
    assert {each.get_type() for each in read} >= {"HEARTBEAT", "SYS_STATUS", "GLOBAL_POSITION_INT", "VFR_HUD"}
    numbers = [each.get_seq() for each in read]
    assert all((after - before) % 256 == 1 for before, after in itertools.pairwise(numbers))


def test_one_frame_of_mavlink_2_is_enough_for_mavlink_2() -> None:
    station, old, new = Station(), OldVoice(), Voice(254)
    beat = old.frame(version_1.MAVLink_heartbeat_message(6, 8, 0, 0, 4, 3))

    def versions() -> set[int]:
        station.pass_time(1.5)
        return {each.data[0] for each in station.wire.take()}

    station.wire.put(beat)
    assert versions() == {MARKER_V1}
    station.wire.put(new.frame(mavlink.MAVLink_heartbeat_message(6, 8, 0, 0, 4, 3)))
    station.wire.put(beat)
    assert versions() == {MARKER_V2}
    station.pass_time(VERSION_MEMORY)
    station.wire.put(beat)
    station.wire.take()
    assert versions() == {MARKER_V1}, "the new station has left"


def test_radio_status_of_a_modem_does_not_change_the_version() -> None:
    station, old = Station(), OldVoice()
    station.wire.put(old.frame(version_1.MAVLink_radio_status_message(200, 200, 90, 20, 20, 0, 0)))
    station.pass_time(1.5)
    assert {each.data[0] for each in station.wire.take()} == {MARKER_V2}


def test_what_is_sent_to_a_mavlink_1_station_is_not_signed() -> None:
    signing = Signing(lambda: 1.8e9)
    signing.set_key(b"k" * 32)
    station, old = Station(url="udpin:127.0.0.1:1?unsigned=accept", signing=signing), OldVoice()
    station.wire.put(old.frame(version_1.MAVLink_heartbeat_message(6, 8, 0, 0, 4, 3)))
    station.pass_time(1.5)
    sent = station.wire.take()
    assert sent and len(in_version_1(sent)) == len(sent)


def items(kind: str) -> list[Any]:
    places = ((mavlink.MAV_CMD_NAV_TAKEOFF, 30.0), (mavlink.MAV_CMD_NAV_RETURN_TO_LAUNCH, 0.0))
    build = getattr(mavlink, f"MAVLink_{kind.lower()}_message")
    return [
        build(1, 1, number, 3, command, 0, 1, 0.0, 0.0, 0.0, math.nan, 0, 0, altitude)
        for number, (command, altitude) in enumerate(places)
    ]


@pytest.mark.parametrize(
    ("knows", "kind"), [("MISSION_REQUEST", "MISSION_ITEM"), ("MISSION_REQUEST_INT", "MISSION_ITEM_INT")]
)
def test_a_station_that_answers_one_of_the_two_requests_uploads_its_mission(knows: str, kind: str) -> None:
    station, voice = Station(), Voice(255)
    heard = station.exchange(voice.frame(mavlink.MAVLink_mission_count_message(1, 1, 2)))
    requests = 0
    while not (acks := of(heard, "MISSION_ACK")) and station.now < 20.0:
        asked = of(heard, knows)
        requests += len(asked)
        if asked:
            heard = station.exchange(voice.frame(items(kind)[asked[-1].seq]))
        else:
            station.pass_time(0.5)
            heard = station.wire.incoming()
    assert [each.type for each in acks] == [mavlink.MAV_MISSION_ACCEPTED]
    assert [item.kind for item in station.vehicle.mission] == [ItemKind.TAKEOFF, ItemKind.RETURN]
    assert requests == 2 and station.now < 3.0, "once it has answered, it is asked in its own way"


def test_a_station_that_refuses_mission_request_is_asked_again_by_mission_request_int() -> None:
    station, voice = Station(), Voice(255)
    station.exchange(voice.frame(mavlink.MAVLink_mission_count_message(1, 1, 2)))
    station.pass_time(1.1)
    assert of(station.wire.incoming(), "MISSION_REQUEST")
    refusal = mavlink.MAVLink_mission_ack_message(1, 1, mavlink.MAV_MISSION_UNSUPPORTED)
    assert of(station.exchange(voice.frame(refusal)), "MISSION_REQUEST_INT")
    cancel = mavlink.MAVLink_mission_ack_message(1, 1, mavlink.MAV_MISSION_OPERATION_CANCELLED)
    station.exchange(voice.frame(cancel))
    station.pass_time(5.0)
    assert not of(station.wire.incoming(), "MISSION_REQUEST")


# --- logs ------------------------------------------------------------------------------------------------------


@pytest.fixture
def logs(tmp_path: Path) -> Path:
    for number, size in enumerate((1000, 0, 180)):
        path = tmp_path / f"flight-{number}.mcap"
        path.write_bytes(os.urandom(size))
        os.utime(path, (1.7e9 + number, 1.7e9 + number))
    (tmp_path / "notes.txt").write_text("not a log")
    return tmp_path


def test_logs_are_listed_and_downloaded(logs: Path) -> None:
    station, voice = Station(logs), Voice(255)
    entries = of(
        station.exchange(voice.frame(mavlink.MAVLink_log_request_list_message(1, 1, 0, 0xFFFF))), "LOG_ENTRY"
    )
    assert [(each.id, each.num_logs, each.last_log_num, each.size) for each in entries] == [
        (1, 3, 3, 1000), (2, 3, 3, 0), (3, 3, 3, 180),
    ]  # fmt: skip
    assert [each.time_utc for each in entries] == [1_700_000_000, 1_700_000_001, 1_700_000_002]
    some = of(station.exchange(voice.frame(mavlink.MAVLink_log_request_list_message(1, 1, 2, 2))), "LOG_ENTRY")
    assert [each.id for each in some] == [2]
    for entry in entries:
        wanted = (logs / f"flight-{entry.id - 1}.mcap").read_bytes()
        assert download(station, voice, entry.id, 0, 0xFFFFFFFF) == wanted
    whole = (logs / "flight-0.mcap").read_bytes()
    assert download(station, voice, 1, 90, 200) == whole[90:290]


def download(station: Station, voice: Voice, number: int, offset: int, count: int) -> bytes:
    request = mavlink.MAVLink_log_request_data_message(1, 1, number, offset, count)
    parts = of(station.exchange(voice.frame(request), 1.0), "LOG_DATA")
    assert [each.ofs for each in parts] == [offset + 90 * place for place in range(len(parts))]
    assert {each.id for each in parts} == {number}
    return b"".join(bytes(each.data[: each.count]) for each in parts)


def test_a_download_ends_when_it_is_asked_to_and_yields_to_a_slow_link(logs: Path) -> None:
    (logs / "flight-0.mcap").write_bytes(os.urandom(200_000))
    station, voice = Station(logs, "serial:/dev/ttyNONE,57600"), Voice(255)
    begin = voice.frame(mavlink.MAVLink_log_request_data_message(1, 1, 1, 0, 0xFFFFFFFF))
    heard = station.exchange(begin, 4.0)
    rate = sum(each.count for each in of(heard, "LOG_DATA")) / 4.0
    assert 500.0 < rate < 5760.0 and len(of(heard, "ATTITUDE")) > 20, "bytes/s; the rest is for telemetry"
    station.exchange(voice.frame(mavlink.MAVLink_log_request_end_message(1, 1)))
    station.pass_time(0.2)
    station.wire.take()
    station.pass_time(1.0)
    assert not of(station.wire.incoming(), "LOG_DATA")


def test_logs_are_not_erased_and_unknown_ones_are_refused(logs: Path) -> None:
    station, voice = Station(logs), Voice(255)
    (text,) = of(station.exchange(voice.frame(mavlink.MAVLink_log_erase_message(1, 1))), "STATUSTEXT")
    assert text.text == "logs are not erased over the link" and len(list(logs.glob("*.mcap"))) == 3
    request = mavlink.MAVLink_log_request_data_message(1, 1, 4, 0, 90)
    (text,) = of(station.exchange(voice.frame(request)), "STATUSTEXT")
    assert text.text == "there is no log 4, only 3"
    (logs / "flight-0.mcap").unlink()
    station.link.close()


def test_without_logs_the_list_is_one_empty_entry(tmp_path: Path) -> None:
    station, voice = Station(tmp_path), Voice(255)
    (entry,) = of(
        station.exchange(voice.frame(mavlink.MAVLink_log_request_list_message(1, 1, 0, 0xFFFF))), "LOG_ENTRY"
    )
    assert (entry.id, entry.num_logs, entry.size) == (0, 0, 0)


# --- telemetry on request ------------------------------------------------------------------------------------


def requested(station: Station, name: str) -> Any:
    number = getattr(mavlink, f"MAVLINK_MSG_ID_{name}")
    command = mavlink.MAVLink_command_long_message(1, 1, 512, 0, number, 0, 0, 0, 0, 0, 0)
    heard = station.exchange(Voice(255).frame(command), 0.04)
    (ack,) = of(heard, "COMMAND_ACK")
    assert ack.result == mavlink.MAV_RESULT_ACCEPTED
    return of(heard, name)[0]


@pytest.fixture
def station() -> Station:
    made = Station()
    latest = made.vehicle.topics
    latest["/sensors/imu"] = m.ImuSample(5_000_000, 9.80665, 0.0, -9.80665, ROLL_RATE, 0.0, 0.5, 0.2, 0.0, 0.45)
    latest["/main/air_data"] = latest["/main/air_data"]._replace(
        static_pressure=95_000.0, dynamic_pressure=30.0, temperature=293.15, innovation=2.0, innovation_variance=4.0
    )
    # A quarter turn to the right about the vertical: north is to the left.
    half = math.sqrt(0.5)
    latest["/attitude/ahrs"] = latest["/attitude/ahrs"]._replace(
        quaternion_w=half, quaternion_z=half, tilt_sigma=0.01, heading_sigma=0.02
    )
    latest["/main/position"] = latest["/main/position"]._replace(
        innovation_north=3.0, innovation_east=4.0, place_innovation_variance=4.0, position_variance=2.25
    )
    return made


def test_every_stream_can_be_requested_once(station: Station) -> None:
    for entry in STREAMS:
        requested(station, str(mavlink.mavlink_map[entry.message_id].msgname))


def test_raw_sensors_are_sent_in_the_units_of_their_messages(station: Station) -> None:
    for name in ("RAW_IMU", "SCALED_IMU"):
        imu = requested(station, name)
        assert (imu.xacc, imu.yacc, imu.zacc) == (1000, 0, -1000), "mG"
        assert (imu.xgyro, imu.zgyro, imu.xmag, imu.zmag) == (250, 500, 200, 450), "mrad/s, mgauss"
    fine = requested(station, "HIGHRES_IMU")
    assert (fine.zacc, fine.xgyro) == pytest.approx((-9.80665, 0.25))
    assert (fine.abs_pressure, fine.diff_pressure, fine.temperature) == pytest.approx((950.0, 0.3, 20.0), abs=1e-3)
    air = requested(station, "SCALED_PRESSURE")
    assert (air.press_abs, air.press_diff, air.temperature) == pytest.approx((950.0, 0.3, 2000), abs=1e-3)
    shaken = requested(station, "VIBRATION")
    assert (shaken.vibration_x, shaken.vibration_z, shaken.clipping_0) == (1.0, 3.0, 4)


def test_odometry_has_the_velocity_in_body_axes(station: Station) -> None:
    odometry = requested(station, "ODOMETRY")
    assert (odometry.x, odometry.y, odometry.z) == (30.0, -20.0, -40.0)
    north, east, down = VELOCITY
    assert (odometry.vx, odometry.vy, odometry.vz) == pytest.approx((east, -north, down), abs=1e-6)
    places = [number for number, value in enumerate(odometry.pose_covariance) if not math.isnan(value)]
    assert places == [0, 6, 11, 15, 18, 20], "the diagonal of the triangle"
    assert odometry.pose_covariance[0] == pytest.approx(2.25)


def test_estimators_report_flags_and_test_ratios(station: Station) -> None:
    ekf = requested(station, "EKF_STATUS_REPORT")
    armable = mavlink.EKF_ATTITUDE | mavlink.EKF_POS_HORIZ_ABS | mavlink.EKF_PRED_POS_HORIZ_ABS
    assert ekf.flags & armable == armable and not ekf.flags & mavlink.EKF_CONST_POS_MODE
    assert (ekf.pos_horiz_variance, ekf.airspeed_variance) == pytest.approx((0.5, 0.2))
    status = requested(station, "ESTIMATOR_STATUS")
    assert (status.pos_horiz_ratio, status.tas_ratio) == pytest.approx((0.25, 0.04))
    assert status.pos_horiz_accuracy == pytest.approx(1.5) and not status.flags & mavlink.ESTIMATOR_GPS_GLITCH
    health = station.vehicle.topics[topics.HEALTH.name]
    station.vehicle.topics[topics.HEALTH.name] = health._replace(failsafe=int(Failsafe.GPS_LOST))
    lost = requested(station, "EKF_STATUS_REPORT")
    assert lost.flags & mavlink.EKF_CONST_POS_MODE and not lost.flags & mavlink.EKF_POS_HORIZ_ABS
    del station.vehicle.topics[topics.ATTITUDE.name]
    assert requested(station, "EKF_STATUS_REPORT").flags == mavlink.EKF_UNINITIALIZED


def test_the_times_of_a_flight_are_told_on_request(station: Station) -> None:
    vehicle = station.vehicle
    navigation = vehicle.topics[topics.NAVIGATION.name]

    def at(time_us: int, armed: bool, stage: m.Stage) -> Any:
        vehicle.time_us, vehicle.armed = time_us, armed
        vehicle.topics[topics.NAVIGATION.name] = navigation._replace(stage=stage)
        station.pass_time(0.04)
        seen = requested(station, "FLIGHT_INFORMATION")
        return seen.arming_time_utc, seen.takeoff_time_utc, seen.landing_time, seen.flight_uuid

    fresh = Station()
    fresh.vehicle.topics[topics.NAVIGATION.name] = navigation._replace(stage=m.Stage.ON_GROUND)
    station.link, station.wire, station.vehicle = fresh.link, fresh.wire, fresh.vehicle
    vehicle = fresh.vehicle
    assert at(1_000_000, False, m.Stage.ON_GROUND) == (0, 0, 0, 0)
    assert at(2_000_000, True, m.Stage.WAIT_LAUNCH) == (2_000_000, 0, 0, 1)
    assert at(9_000_000, True, m.Stage.EN_ROUTE) == (2_000_000, 9_000_000, 0, 1)
    assert at(50_000_000, False, m.Stage.LANDED) == (2_000_000, 9_000_000, 50_000, 1)


def test_extended_fields_do_not_travel_in_mavlink_1() -> None:
    """GPS_RAW_INT without its extensions has 30 bytes."""
    station, old = Station(), OldVoice()
    station.wire.put(old.frame(version_1.MAVLink_heartbeat_message(6, 8, 0, 0, 4, 3)))
    station.pass_time(2.0)
    frames = [each.data for each in station.wire.take() if each.data[5] == mavlink.MAVLINK_MSG_ID_GPS_RAW_INT]
    assert frames and {struct.unpack_from("<B", frame, 1)[0] for frame in frames} == {30}


# --- missions as ground stations draw them -------------------------------------------------------------------


PLACE = (481_003_000, 115_997_000)
SURVEY = (
    (3, mavlink.MAV_CMD_NAV_TAKEOFF, (15.0, 0.0, 0.0, math.nan), 0, 0, 30.0),
    (2, mavlink.MAV_CMD_DO_CHANGE_SPEED, (0.0, 8.0, -1.0, 0.0), 0, 0, 0.0),
    (10, mavlink.MAV_CMD_NAV_WAYPOINT, (0.0, 0.0, 0.0, math.nan), *PLACE, 30.0),
    (2, mavlink.MAV_CMD_DO_SET_CAM_TRIGG_DIST, (25.0, 0.0, 1.0, 0.0), 0, 0, 0.0),
    (3, mavlink.MAV_CMD_NAV_WAYPOINT, (12.0, 0.0, 0.0, math.nan), *PLACE, 35.0),
    (2, mavlink.MAV_CMD_DO_JUMP, (2.0, 1.0, 0.0, 0.0), 0, 0, 0.0),
    (3, mavlink.MAV_CMD_DO_SET_ROI_LOCATION, (0.0, 0.0, 0.0, 0.0), *PLACE, 0.0),
    (2, mavlink.MAV_CMD_DO_LAND_START, (0.0, 0.0, 0.0, 0.0), 0, 0, 0.0),
    (3, mavlink.MAV_CMD_NAV_LAND, (0.0, 0.0, 0.0, 0.0), *PLACE, 0.0),
)


def uploaded(station: Station, voice: Voice, survey: tuple[Any, ...]) -> list[Any]:
    """What comes back after the whole of an upload."""
    replies = station.exchange(voice.frame(mavlink.MAVLink_mission_count_message(1, 1, len(survey))))
    while requests := of(replies, "MISSION_REQUEST_INT"):
        number = requests[-1].seq
        frame, command, params, x, y, z = survey[number]
        message = mavlink.MAVLink_mission_item_int_message(1, 1, number, frame, command, 0, 1, *params, x, y, z)
        replies = station.exchange(voice.frame(message))
    return replies


def test_a_survey_is_accepted_with_what_is_passed_over_in_one_text() -> None:
    station, voice = Station(), Voice(255)
    replies = uploaded(station, voice, SURVEY)
    assert [each.type for each in of(replies, "MISSION_ACK")] == [mavlink.MAV_MISSION_ACCEPTED]
    text = "".join(each.text for each in of(replies, "STATUSTEXT"))
    assert text.count("passed over in flight") == 1 and text.endswith(
        "altitudes above terrain are taken as above home"
    )
    for name in ("DO_SET_CAM_TRIGG_DIST (206)", "DO_SET_ROI_LOCATION (195)"):
        assert name in text
    skip, way = ItemKind.SKIP, ItemKind.WAYPOINT
    kinds = [
        ItemKind.TAKEOFF,
        ItemKind.SPEED,
        way,
        skip,
        way,
        ItemKind.JUMP,
        skip,
        ItemKind.LAND_START,
        ItemKind.LAND,
    ]
    mission = station.vehicle.mission
    assert mission[1].airspeed == 8.0 and landing_sequence(mission) == 7
    assert [item.kind for item in mission] == kinds
    assert (mission[2].altitude, mission[4].duration, mission[5].jump_to) == (30.0, 12.0, 2)
    for number in (1, 3, 6, 7):
        request = mavlink.MAVLink_mission_request_int_message(1, 1, number)
        (item,) = of(station.exchange(voice.frame(request)), "MISSION_ITEM_INT")
        sent = SURVEY[number]
        assert (item.seq, item.frame, item.command, item.x, item.y, item.z) == (number, *sent[:2], *sent[3:])
        assert (item.param1, item.param2, item.param3, item.param4) == sent[2]


def test_a_mission_of_items_that_are_passed_over_alone_is_not_flown() -> None:
    skipped = MissionItem(ItemKind.SKIP, skipped=(2.0, 206.0, 25.0, 0.0, 1.0, 0.0, 0.0, 0.0, 0.0))
    assert check_mission((skipped, skipped)) == "no item is flown, all are passed over"
    assert check_mission((MissionItem(ItemKind.TAKEOFF, altitude=20.0), skipped)) == ""


@pytest.mark.parametrize(
    ("number", "change", "reason"),
    [(4, {3: 910000000}, "an item's place is not on the globe"), (1, {1: 208}, "DO_PARACHUTE (208) is not flown")],
)
def test_an_item_that_cannot_be_flown_is_refused_by_its_number(
    number: int, change: dict[int, Any], reason: str
) -> None:
    station, voice = Station(), Voice(255)
    item = [change.get(place, value) for place, value in enumerate(SURVEY[number])]
    replies = uploaded(station, voice, (*SURVEY[:number], tuple(item), *SURVEY[number + 1 :]))
    assert of(replies, "MISSION_ACK")[0].type != mavlink.MAV_MISSION_ACCEPTED
    text = "".join(each.text for each in of(replies, "STATUSTEXT"))
    assert text.startswith(f"mission item {number}: ") and reason in text and station.vehicle.mission == ()
