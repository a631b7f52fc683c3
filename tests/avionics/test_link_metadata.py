"""Component metadata as a ground station reads it: message, general file, parameter file, checksums."""

from __future__ import annotations

import json
import lzma
import math
import runpy
import time
from pathlib import Path
from typing import Any

import pytest
from link_station import PATIENCE, greet, running
from link_vehicle import FakeVehicle
from link_wires import Voice, Wire
from ports import free_port
from pymavlink import mavftp, mavutil

from avionics.link.dialect import mavlink
from avionics.link.ground import Files, GroundLink
from avionics.link.metadata import GENERAL, PARAMETERS, component_metadata
from avionics.parameters import parameter_table
from avionics.vehicles.loader import load_vehicle
from avionics.view import shown_parameter

VEHICLES = ("robo_raven_ii_d", "arizona_100cm")
KEYS = {
    "name", "type", "shortDesc", "longDesc", "units", "default", "decimalPlaces", "min", "max", "group", "category",
    "values",
}  # fmt: skip
"""of the parameter schema, those in use"""
GENERAL_KEYS = {"version", "vendorName", "modelName", "firmwareVersion", "metadataTypes"}


class Defaults:
    """A parameter file without changes."""

    def __init__(self, vehicle: FakeVehicle) -> None:
        self._values = {each.name: each.value for each in vehicle.parameters}

    def defaults(self) -> dict[str, float]:
        return self._values

    def stored(self) -> dict[str, float]:
        return {}

    def save(self, values: Any) -> None:
        raise OSError


def fake_vehicle(name: str) -> FakeVehicle:
    """A fake with the parameter table of a real vehicle."""
    gains, vehicle = load_vehicle(name).gains, FakeVehicle()
    vehicle.parameters = [shown_parameter(gains, each) for each in parameter_table(gains).values()]
    return vehicle


def request(vehicle: FakeVehicle, message_id: int) -> Any:
    """The message that answers REQUEST_MESSAGE."""
    wire = Wire("udpin:127.0.0.1:1")
    link = GroundLink([wire], vehicle, files=Files(Defaults(vehicle)))
    command = mavlink.MAV_CMD_REQUEST_MESSAGE
    wire.put(Voice(255).frame(mavlink.MAVLink_command_long_message(1, 1, command, 0, message_id, 0, 0, 0, 0, 0, 0)))
    link.poll(0.01)
    (message,) = [each for each in wire.incoming() if each.get_msgId() == message_id]
    return message


def read_files(vehicle: FakeVehicle, general_uri: str) -> tuple[bytes, bytes]:
    """The general file and the parameter file that it names, with pymavlink's client."""
    port = free_port()
    link = GroundLink([f"udpin:127.0.0.1:{port}"], vehicle, files=Files(Defaults(vehicle)))
    with running(link, vehicle):
        client = mavutil.mavlink_connection(f"udpout:127.0.0.1:{port}", source_system=255, dialect="development")
        try:
            greet(client)
            ftp = mavftp.MAVFTP(client, target_system=1, target_component=1)
            general = fetch(ftp, general_uri)
            (entry,) = json.loads(lzma.decompress(general))["metadataTypes"]
            return general, fetch(ftp, entry["uri"])
        finally:
            client.close()


def fetch(ftp: Any, uri: str) -> bytes:
    got: list[bytes] = []
    path = uri.removeprefix("mftp://")
    ftp.cmd_get([path, "-"], callback=lambda file: got.append(file.read() if file is not None else b""))
    deadline = time.monotonic() + PATIENCE
    while not got and time.monotonic() < deadline:
        ftp.process_ftp_reply("OpenFileRO", timeout=PATIENCE)
    assert got and got[0], f"{uri} not received"
    return got[0]


@pytest.mark.parametrize("name", VEHICLES)
def test_metadata_describes_every_parameter(name: str) -> None:
    """GIVEN a vehicle WHEN 397 and its files are read THEN checksums match and each parameter has unit and text."""
    vehicle = fake_vehicle(name)
    message = request(vehicle, mavlink.MAVLINK_MSG_ID_COMPONENT_METADATA)
    packed, table = read_files(vehicle, message.uri)
    assert mavlink_crc(packed) == message.file_crc
    general = json.loads(lzma.decompress(packed))
    (kind,) = general["metadataTypes"]
    assert set(general) == GENERAL_KEYS and kind["type"] == 1 and mavlink_crc(table) == kind["fileCrc"]
    described = {each["name"]: each for each in json.loads(lzma.decompress(table))["parameters"]}
    assert list(described) == [each.name for each in vehicle.parameters] and len(described) > 250
    for each in vehicle.parameters:
        entry = described[each.name]
        assert set(entry) <= KEYS and entry["type"] == "Float"
        assert entry.get("units", "") == each.unit
        assert entry["shortDesc"] != each.key and len(entry["shortDesc"]) > 5, each.name
        assert entry["default"] == each.value
        assert entry.get("min", -math.inf) == each.minimum and entry.get("max", math.inf) == each.maximum


@pytest.mark.parametrize("name", VEHICLES)
def test_metadata_lists_the_values_of_choices(name: str) -> None:
    """GIVEN parameters with whole numbers WHEN the metadata is built THEN each allowed value of a choice is named."""
    vehicle = fake_vehicle(name)
    files = component_metadata(vehicle.parameters, None, (1, 2, 3))
    described = {each["name"]: each for each in json.loads(lzma.decompress(files[PARAMETERS]))["parameters"]}
    chosen = {each.name: each for each in vehicle.parameters if "values" in described[each.name]}
    whole = {each.name for each in vehicle.parameters if each.is_integer}
    assert whole - set(chosen) == {"PRE_WINDOWS"}  # the only count
    for each in chosen.values():
        values = [entry["value"] for entry in described[each.name]["values"]]
        assert values[0] == each.minimum and values[-1] == each.maximum and each.value in values
        assert all(entry["description"] for entry in described[each.name]["values"])


def test_component_information_basic_names_the_vehicle() -> None:
    """GIVEN a client WHEN 396 is requested THEN vendor, version and capabilities are those of AUTOPILOT_VERSION."""
    basic = request(fake_vehicle(VEHICLES[0]), mavlink.MAVLINK_MSG_ID_COMPONENT_INFORMATION_BASIC)
    version = request(fake_vehicle(VEHICLES[0]), mavlink.MAVLINK_MSG_ID_AUTOPILOT_VERSION)
    assert (basic.vendor_name, basic.software_version) == ("Wingbeat", "0.1.0")
    assert basic.capabilities == version.capabilities and basic.serial_number == f"{version.uid:x}"
    # Size and seed of the checksum in MAVLink's common dialect.
    assert (basic.crc_extra, basic.unpacker.size) == (50, 160)


def test_component_information_names_the_same_file() -> None:
    """GIVEN an older client WHEN 395 is requested THEN file and checksum are those of 397."""
    vehicle = fake_vehicle(VEHICLES[0])
    older = request(vehicle, mavlink.MAVLINK_MSG_ID_COMPONENT_INFORMATION)
    newer = request(vehicle, mavlink.MAVLINK_MSG_ID_COMPONENT_METADATA)
    assert (older.general_metadata_uri, older.general_metadata_file_crc) == (newer.uri, newer.file_crc)
    assert older.peripherals_metadata_uri == "" and older.peripherals_metadata_file_crc == 0


def test_metadata_without_storage_has_no_default() -> None:
    """GIVEN no parameter file WHEN the metadata is built THEN no default is claimed."""
    files = component_metadata(fake_vehicle(VEHICLES[0]).parameters, None, (1, 2, 3))
    assert json.loads(lzma.decompress(files[GENERAL]))["firmwareVersion"] == "1.2.3"
    table = json.loads(lzma.decompress(files[PARAMETERS]))["parameters"]
    assert table and not any("default" in each for each in table)


def mavlink_crc(data: bytes) -> int:
    """CRC-32 bit by bit, with initial value 0 and no inversion."""
    crc = 0
    for byte in data:
        crc ^= byte
        for _ in range(8):
            crc = crc >> 1 ^ (0xEDB88320 if crc & 1 else 0)
    return crc


def test_parameter_reference_is_current() -> None:
    """GIVEN docs/parameters.md WHEN generated again THEN it is equal (else ``make docs/parameters.md``)."""
    root = Path(__file__).parents[2]
    reference = runpy.run_path(str(root / "docs" / "write_parameters.py"))["reference"]()
    assert (root / "docs" / "parameters.md").read_text(encoding="utf-8") == reference
