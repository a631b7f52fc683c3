"""``wingbeat gcs`` with vehicles that speak as PX4 and ArduPilot do."""

from __future__ import annotations

import json
import math
from pathlib import Path

import pytest
from foreign_vehicles import HOME, ArduPlane, ForeignVehicle, Px4, ahrs_report
from lossy_vehicle import converse, on_the_air

from avionics.link.dialect import mavlink
from groundstation.command import gcs_order
from groundstation.command.main import main
from groundstation.link import frames, missions, parameters, waypoints
from groundstation.link.vehicle_state import VehicleState

Capture = pytest.CaptureFixture[str]
BOTH = pytest.mark.parametrize("kind", [Px4, ArduPlane])
MISSIONS = Path(__file__).parents[2] / "avionics" / "missions"


def gcs(*words: str) -> int:
    return main(["gcs", *words, "--no-record"])


@BOTH
def test_whole_numbers_are_read_and_set_in_the_vehicles_encoding(kind: type[ForeignVehicle], capsys: Capture) -> None:
    vehicle = kind()
    known = dict(vehicle.whole)
    with on_the_air(vehicle) as url:
        assert gcs(url, "param", "list", "--json") == 0
        listed = json.loads(capsys.readouterr().out)["parameters"]
        assert gcs(url, "param", "set", "COUNT", "1234567") == 0
        assert gcs(url, "param", "set", "COUNT", "0.5") == 2
    assert {row["name"]: row["value"] for row in listed if row["type"] == "int32"} == known
    assert vehicle.whole["COUNT"] == 1234567


@BOTH
@pytest.mark.parametrize("seed", [1, 2])
def test_whole_numbers_survive_a_lossy_link(kind: type[ForeignVehicle], seed: int) -> None:
    vehicle = kind(0.3, seed)
    encoding = parameters.is_bytewise(VehicleState(autopilot=kind.autopilot, capabilities=kind.capabilities))
    ended = converse(parameters.ParameterDownload(missions.Target(), encoding), vehicle)
    known = {parameter.name: parameter.value for parameter in ended.values.values()}
    assert known == {**vehicle.values, **vehicle.whole}


@BOTH
@pytest.mark.parametrize("seed", range(4))
def test_lists_settings_and_missions_are_whole_over_a_bad_radio(kind: type[ForeignVehicle], seed: int) -> None:
    """Given 30 % loss, 10 % doubled and 300 ms each way."""
    radio = {"limit": 240.0, "doubled": 0.1, "delay": 0.3}
    vehicle, target = kind(0.3, seed), missions.Target()
    encoding = parameters.is_bytewise(VehicleState(autopilot=kind.autopilot, capabilities=kind.capabilities))
    listed = converse(parameters.ParameterDownload(target, encoding), vehicle, **radio)
    known = {parameter.name: parameter for parameter in listed.values.values()}
    assert {name: parameter.value for name, parameter in known.items()} == {**vehicle.values, **vehicle.whole}
    for name, value in (("COUNT", 1234567), ("GAIN_7", 0.25)):
        assert not converse(parameters.ParameterWrite(target, known[name], value, encoding), vehicle, **radio).failure
    assert (vehicle.whole["COUNT"], vehicle.values["GAIN_7"]) == (1234567, 0.25)
    vehicle.mission = [missions.Item(3, 16, (0.0,) * 4, HOME[0] + 900 * n, HOME[1], 30.0 + n) for n in range(15)]
    download = converse(missions.MissionDownload(target), vehicle, **radio)
    assert download.items == tuple(vehicle.mission)


def test_capabilities_go_before_what_an_autopilot_is_known_for() -> None:
    assert parameters.is_bytewise(VehicleState(autopilot=12))
    assert not parameters.is_bytewise(VehicleState(autopilot=3))
    assert not parameters.is_bytewise(VehicleState(autopilot=12, capabilities=131072))
    assert parameters.is_bytewise(VehicleState(autopilot=3, capabilities=16))


@pytest.mark.parametrize(
    ("kind", "name", "number"),
    [
        (Px4, "rtl", 4 << 16 | 5 << 24),
        (Px4, "Mission", 4 << 16 | 4 << 24),
        (ArduPlane, "fbwa", 5),
        (ArduPlane, "RTL", 11),
    ],
)
def test_modes_by_the_names_of_their_autopilot(
    kind: type[ForeignVehicle], name: str, number: int, capsys: Capture
) -> None:
    vehicle = kind()
    with on_the_air(vehicle) as url:
        assert gcs(url, "mode", name, "--json") == 0
        assert json.loads(capsys.readouterr().out)["mode"] == name.upper()
        assert vehicle.custom_mode == number
        assert gcs(url, "mode", "hover") == 2


ARDUPILOT_SAYS = {0: "Manual", 5: "Fly By Wire A", 11: "RTL", 13: "Takeoff", 26: "Autoland"}
PX4_SAYS = {4 << 16 | 5 << 24: "Return", 4 << 16 | 4 << 24: "Mission", 4 << 16 | 3 << 24: "Hold"}


@pytest.mark.parametrize(
    ("kind", "announced", "names"),
    [
        (ArduPlane, ARDUPILOT_SAYS, ("FBWA", "fly-by-wire-a", "FLY_BY_WIRE_A")),
        (Px4, PX4_SAYS, ("RTL", "return", "Return")),
    ],
)
def test_a_mode_that_is_announced_by_another_name_has_its_usual_one_too(
    kind: type[ForeignVehicle], announced: dict[int, str], names: tuple[str, ...], capsys: Capture
) -> None:
    vehicle = kind()
    vehicle.announced = announced
    first = vehicle.custom_mode
    with on_the_air(vehicle) as url:
        for name in names:
            vehicle.custom_mode = first
            assert gcs(url, "mode", name, "--json") == 0
            assert json.loads(capsys.readouterr().out)["mode"] == names[-1].upper()
            assert announced[vehicle.custom_mode].upper().replace(" ", "_") == names[-1].upper()
        # What it does not announce it does not have.
        assert gcs(url, "mode", "ACRO") == 2
    assert "CRUISE" not in capsys.readouterr().err


@pytest.mark.parametrize(
    ("announced", "mode", "reports"),
    [(ARDUPILOT_SAYS, 26, ""), ({}, 11, "the vehicle has no mode AUTOLAND: RTL\n")],
    ids=["with AUTOLAND", "without"],
)
def test_an_aeroplane_of_ardupilot_takes_off_and_lands_by_its_modes(
    announced: dict[int, str], mode: int, reports: str, capsys: Capture
) -> None:
    vehicle = ArduPlane()
    vehicle.announced = announced
    with on_the_air(vehicle) as url:
        assert gcs(url, "takeoff", "--json") == 0
        assert json.loads(capsys.readouterr().out)["mode"] == "TAKEOFF"
        assert vehicle.custom_mode == 13 and vehicle.values["TKOFF_ALT"] == 50.0
        assert gcs(url, "land") == 0
    assert vehicle.custom_mode == mode and not vehicle.takeoffs
    assert capsys.readouterr().err == reports


@BOTH
@pytest.mark.parametrize("verb", ["takeoff", "return", "goto"])
def test_an_order_is_done_when_its_mode_is_shown(
    kind: type[ForeignVehicle], verb: str, monkeypatch: pytest.MonkeyPatch, capsys: Capture
) -> None:
    place = ("47.4", "8.55", "--altitude", "20") if verb == "goto" else ()
    vehicle = kind()
    vehicle.custom_mode = 0
    with on_the_air(vehicle) as url:
        assert gcs(url, verb, *place, "--json") == 0
    shown = {"takeoff": "TAKEOFF", "return": "RTL", "goto": "LOITER" if kind is Px4 else "GUIDED"}[verb]
    assert json.loads(capsys.readouterr().out)["mode"] == shown
    if verb == "takeoff" and kind is ArduPlane:
        return  # a change of mode, whose confirmation is tested with it
    monkeypatch.setattr(gcs_order, "SHOWN", 0.3)
    vehicle = kind()
    vehicle.custom_mode, vehicle.leads_to = 0, dict.fromkeys(vehicle.leads_to, 0)
    with on_the_air(vehicle) as url:
        assert gcs(url, verb, *place) == 1
    reports = capsys.readouterr()
    assert f"{verb} accepted, but the heartbeat shows " in reports.err and not reports.out


@BOTH
def test_our_mission_reaches_them_on_the_globe_and_comes_back_without_differences(
    kind: type[ForeignVehicle], capsys: Capture
) -> None:
    vehicle = kind()
    file = str(MISSIONS / "circuit.toml")
    with on_the_air(vehicle) as url:
        assert gcs(url, "mission", "upload", file) == 0
        first = vehicle.mission[0]
        assert (first.frame == 0 and (first.x, first.y) == HOME[:2]) is (kind is ArduPlane)
        assert all(item.frame not in (1, 4) for item in vehicle.mission)
        assert gcs(url, "mission", "diff", file) == 0
        vehicle.mission[-1] = vehicle.mission[-1]._replace(z=99.0)
        capsys.readouterr()
        assert gcs(url, "mission", "diff", file, "--json") == 1
        document = json.loads(capsys.readouterr().out)
    assert document["same"] is False and len(document["differences"]) == 1
    assert document["differences"][0]["vehicle"]["z"] == 99.0


def test_a_plain_list_keeps_its_home_for_ardupilot_alone(tmp_path: Path, capsys: Capture) -> None:
    path = tmp_path / "a.waypoints"
    home = missions.Item(0, 16, (0.0,) * 4, *HOME[:2], 488.0)
    point = missions.Item(3, 16, (0.0,) * 4, HOME[0] + 900, HOME[1], 30.0)
    jump = missions.Item(2, 177, (1.0, 2.0, 0.0, 0.0), 0, 0, 0.0)
    waypoints.write(path, (home, point, jump))
    for vehicle, expected in ((ArduPlane(), 3), (Px4(), 2)):
        with on_the_air(vehicle) as url:
            assert gcs(url, "mission", "upload", str(path)) == 0
            assert gcs(url, "mission", "diff", str(path)) == 0
        assert len(vehicle.mission) == expected
        # Behind home the waypoint is number 1, without it number 0.
        assert vehicle.mission[-1].parameters[0] == expected - 2


def test_home_is_called_home_where_the_list_begins_with_it(capsys: Capture) -> None:
    vehicle = ArduPlane()
    vehicle.mission = [
        missions.Item(0, 16, (0.0,) * 4, *HOME[:2], 488.0),
        missions.Item(3, 16, (0.0,) * 4, 0, 0, 30.0),
    ]
    with on_the_air(vehicle) as url:
        assert gcs(url, "mission", "show") == 0
    assert capsys.readouterr().out.splitlines()[1].split()[:2] == ["0", "home"]


@pytest.mark.parametrize(("kind", "altitude"), [(Px4, 488.0 + 25.0), (ArduPlane, 25.0)])
def test_altitudes_are_given_from_home_whatever_the_vehicle_counts_from(
    kind: type[ForeignVehicle], altitude: float
) -> None:
    vehicle = kind()
    with on_the_air(vehicle) as url:
        assert gcs(url, "takeoff", "--altitude", "25") == 0
        assert gcs(url, "goto", "--north", "100", "--east", "0", "--altitude", "25") == 0
    if kind is ArduPlane:
        assert not vehicle.takeoffs and vehicle.values["TKOFF_ALT"] == altitude
    else:
        assert vehicle.takeoffs[-1].param7 == altitude
    place = vehicle.places[-1]
    assert place.command == mavlink.MAV_CMD_DO_REPOSITION and place.z == altitude
    assert place.frame == (0 if kind is Px4 else 3)
    metres = math.radians((place.x - HOME[0]) * 1e-7) * 6_378_137.0
    assert metres == pytest.approx(100.0, abs=0.02) and place.y == HOME[1]


def test_goto_needs_one_place(capsys: Capture) -> None:
    with on_the_air(Px4()) as url:
        for words in (
            (),
            ("47.4",),
            ("47.4", "8.5", "--north", "1", "--east", "2"),
            ("97.4", "8.5", "--altitude", "9"),
        ):
            assert gcs(url, "goto", *words) == 2
    assert capsys.readouterr().err.count("\n") == 4


def test_a_place_that_is_none_is_told_before_the_vehicle_is_spoken_to(capsys: Capture) -> None:
    for words in (("47.4",), ("97.4", "8.5"), ("--north", "1"), ("47.4", "8.5", "--north", "1", "--east", "2")):
        assert gcs("udpout:127.0.0.1:9", "--timeout", "0.1", "goto", *words) == 2
    lines = capsys.readouterr().err.splitlines()
    assert len(lines) == 4 and not any("no vehicle on" in line for line in lines)


def test_a_message_of_another_dialect_is_read_in_its_place() -> None:
    packer = mavlink.MAVLink(None, 1, 1)
    first, last = (mavlink.MAVLink_attitude_message(n, 0, 0, 0, 0, 0, 0).pack(packer) for n in (1, 2))
    foreign = ahrs_report().pack(packer)
    found = frames.GroundReader().feed(first + foreign + last)
    assert [frames.read(frame).get_type() for frame in found] == ["ATTITUDE", "AHRS2", "ATTITUDE"]
    assert frames.read(found[1]).altitude == pytest.approx(0.5)


def test_a_foreign_message_with_a_wrong_checksum_is_none() -> None:
    raw = bytearray(ahrs_report().pack(mavlink.MAVLink(None, 1, 1)))
    raw[-1] ^= 0x55
    found = frames.GroundReader().feed(bytes(raw))
    assert [frames.read(frame) for frame in found] == [None]
