"""Generated MAVLink module: Wingbeat messages and the standard ones in use.

The generator of pymavlink writes the module at first use into the cache of the user, under a name that is a hash of
all its inputs; later starts only import it. The IDs and CRC_EXTRA are those of the full dialects, because the
definitions are copied unchanged from the XML files of pymavlink.
"""

from __future__ import annotations

import contextlib
import hashlib
import importlib.util
import io
import os
import sys
import tempfile
import xml.etree.ElementTree as ET
from copy import deepcopy
from pathlib import Path
from typing import Any

import pymavlink

_NAMES = """
    HEARTBEAT PROTOCOL_VERSION SYS_STATUS SYSTEM_TIME PING SET_MODE AUTOPILOT_VERSION STATUSTEXT TIMESYNC
    PARAM_REQUEST_READ PARAM_REQUEST_LIST PARAM_VALUE PARAM_SET PARAM_ERROR
    MISSION_ITEM MISSION_ITEM_INT MISSION_REQUEST MISSION_REQUEST_INT MISSION_REQUEST_LIST MISSION_COUNT
    MISSION_CLEAR_ALL MISSION_ACK MISSION_CURRENT MISSION_SET_CURRENT MISSION_ITEM_REACHED
    MISSION_REQUEST_PARTIAL_LIST MISSION_WRITE_PARTIAL_LIST
    COMMAND_LONG COMMAND_INT COMMAND_ACK MESSAGE_INTERVAL REQUEST_DATA_STREAM DATA_STREAM
    AVAILABLE_MODES CURRENT_MODE AVAILABLE_MODES_MONITOR COMPONENT_INFORMATION COMPONENT_METADATA
    COMPONENT_INFORMATION_BASIC
    ATTITUDE ATTITUDE_QUATERNION ATTITUDE_TARGET VFR_HUD GLOBAL_POSITION_INT LOCAL_POSITION_NED GPS_RAW_INT
    GPS_GLOBAL_ORIGIN HOME_POSITION SET_HOME_POSITION EXTENDED_SYS_STATE BATTERY_STATUS WIND_COV
    SERVO_OUTPUT_RAW NAV_CONTROLLER_OUTPUT ALTITUDE VIBRATION ESTIMATOR_STATUS POWER_STATUS RC_CHANNELS
    RC_CHANNELS_RAW RC_CHANNELS_OVERRIDE RADIO_STATUS SCALED_IMU SCALED_IMU2 SCALED_IMU3 RAW_IMU HIGHRES_IMU
    SCALED_PRESSURE SCALED_PRESSURE2 SCALED_PRESSURE3 POSITION_TARGET_GLOBAL_INT POSITION_TARGET_LOCAL_NED
    SET_POSITION_TARGET_GLOBAL_INT SET_POSITION_TARGET_LOCAL_NED SET_ATTITUDE_TARGET
    EKF_STATUS_REPORT FLIGHT_INFORMATION LOG_REQUEST_LIST LOG_ENTRY LOG_REQUEST_DATA LOG_DATA LOG_ERASE
    LOG_REQUEST_END DISTANCE_SENSOR FENCE_STATUS ODOMETRY ACTUATOR_OUTPUT_STATUS UTM_GLOBAL_POSITION MANUAL_CONTROL
    NAMED_VALUE_FLOAT NAMED_VALUE_INT DEBUG DEBUG_VECT FILE_TRANSFER_PROTOCOL SETUP_SIGNING
    HIL_SENSOR HIL_GPS HIL_RC_INPUTS_RAW HIL_ACTUATOR_CONTROLS HIL_STATE_QUATERNION HIL_CONTROLS
"""
STANDARD_MESSAGES = frozenset(_NAMES.split())
"""messages copied from the standard dialects, used by flight computer and ground station"""

_SOURCES = ("minimal", "standard", "common", "development", "ardupilotmega")
_PASSED_ON = (*_SOURCES, "uAvionix", "icarous", "loweheiser", "cubepilot", "csAirLink")
"""dialects with messages that are checked and forwarded between links, whether or not they are decoded here"""
_OWN_XML = Path(__file__).with_name("wingbeat.xml")

_RETIRED = """
<mavlink><messages>
  <message id="300" name="PROTOCOL_VERSION">
    <field type="uint16_t" name="version"/>
    <field type="uint16_t" name="min_version"/>
    <field type="uint16_t" name="max_version"/>
    <field type="uint8_t[8]" name="spec_version_hash"/>
    <field type="uint8_t[8]" name="library_version_hash"/>
  </message>
  <message id="395" name="COMPONENT_INFORMATION">
    <field type="uint32_t" name="time_boot_ms"/>
    <field type="uint32_t" name="general_metadata_file_crc"/>
    <field type="char[100]" name="general_metadata_uri"/>
    <field type="uint32_t" name="peripherals_metadata_file_crc"/>
    <field type="char[100]" name="peripherals_metadata_uri"/>
  </message>
  <message id="396" name="COMPONENT_INFORMATION_BASIC">
    <field type="uint32_t" name="time_boot_ms"/>
    <field type="uint64_t" name="capabilities"/>
    <field type="uint32_t" name="time_manufacture_s"/>
    <field type="char[32]" name="vendor_name"/>
    <field type="char[32]" name="model_name"/>
    <field type="char[24]" name="software_version"/>
    <field type="char[24]" name="hardware_version"/>
    <field type="char[32]" name="serial_number"/>
  </message>
  <message id="397" name="COMPONENT_METADATA">
    <field type="uint32_t" name="time_boot_ms"/>
    <field type="uint32_t" name="file_crc"/>
    <field type="char[100]" name="uri"/>
  </message>
</messages></mavlink>
"""
"""messages that are not in the definitions of pymavlink and that ground stations still request"""


def standard_definitions() -> Path:
    """Return the folder of the XML files of pymavlink."""
    return Path(pymavlink.__file__).parent / "dialects" / "v20"


def slim_definition() -> ET.Element:
    """Return one MAVLink definition without includes.

    It contains the standard messages in use, their enums, and the Wingbeat messages.
    """
    enums: dict[str, ET.Element] = {}
    messages: dict[str, ET.Element] = {}
    own = ET.parse(_OWN_XML).getroot()
    wanted = STANDARD_MESSAGES | {message.get("name") for message in own.iter("message")}
    for tree in (*_standard_trees(), ET.fromstring(_RETIRED), own):
        _strip_descriptions(tree)
        _add_enums(enums, tree)
        for message in tree.iter("message"):
            if message.get("name") in wanted:
                messages.setdefault(str(message.get("name")), message)
    used = {field.get("enum") for message in messages.values() for field in message.iter("field")}
    root = ET.Element("mavlink")
    ET.SubElement(root, "version").text = "3"
    chosen = ET.SubElement(root, "enums")
    chosen.extend(enum for name, enum in enums.items() if name in used)
    ET.SubElement(root, "messages").extend(messages.values())
    return root


def _standard_trees() -> list[ET.Element]:
    return [ET.parse(standard_definitions() / f"{source}.xml").getroot() for source in _SOURCES]


def _strip_descriptions(tree: ET.Element) -> None:
    # Descriptions are half of the size and import time of the generated module.
    for element in tree.iter():
        if element.tag in ("description", "field"):
            element.text = ""


def _add_enums(enums: dict[str, ET.Element], tree: ET.Element) -> None:
    for enum in tree.iter("enum"):
        slim = deepcopy(enum)
        for entry in slim.iter("entry"):
            _remove_all(entry, ("param", "deprecated", "superseded", "wip"))
        known = enums.setdefault(str(enum.get("name")), slim)
        if known is not slim:
            present = {entry.get("name") for entry in known.iter("entry")}
            known.extend(entry for entry in slim.iter("entry") if entry.get("name") not in present)


def _remove_all(element: ET.Element, tags: tuple[str, ...]) -> None:
    for tag in tags:
        for child in element.findall(tag):
            element.remove(child)


def fingerprint() -> str:
    """Return the hash of all inputs of the generated module.

    The inputs are the XML, the list of messages and the version of pymavlink.
    """
    digest = hashlib.sha256(_OWN_XML.read_bytes())
    digest.update(Path(__file__).read_bytes())
    digest.update(str(pymavlink.__version__).encode())
    return digest.hexdigest()[:16]


def cache_folder() -> Path:
    """Return the folder of the generated module.

    It is ``WINGBEAT_CACHE``, or the cache folder of the user on this platform.
    """
    chosen = os.environ.get("WINGBEAT_CACHE")
    if chosen:
        return Path(chosen) / "dialect"
    if sys.platform == "darwin":
        base = Path.home() / "Library" / "Caches"
    elif sys.platform == "win32":
        base = Path(os.environ.get("LOCALAPPDATA") or Path.home() / "AppData" / "Local")
    else:
        base = Path(os.environ.get("XDG_CACHE_HOME") or Path.home() / ".cache")
    return base / "wingbeat" / "dialect"


def generate(folder: Path) -> Path:
    """Write the module into ``folder`` and return its path.

    Concurrent calls are safe: each process writes into a temporary folder and moves the finished file in one step.

    Raises:
        OSError: the folder cannot be written.
    """
    from pymavlink.generator import mavgen

    target = folder / f"wingbeat_dialect_{fingerprint()}.py"
    folder.mkdir(parents=True, exist_ok=True)
    with tempfile.TemporaryDirectory(dir=folder, prefix="generating-") as scratch:
        definition = Path(scratch) / "wingbeat_slim.xml"
        ET.ElementTree(slim_definition()).write(definition, encoding="utf-8", xml_declaration=True)
        output = Path(scratch) / target.name
        options = mavgen.Opts(str(output), wire_protocol="2.0", language="Python3", validate=False)
        with contextlib.redirect_stdout(io.StringIO()):
            mavgen.mavgen(options, [str(definition)])
            table = _wire_table([*(standard_definitions() / f"{name}.xml" for name in _PASSED_ON), definition])
        with output.open("a", encoding="utf-8") as module:
            module.write(f"\n\nwire_table = {table!r}\n")
        output.replace(target)
    return target


def _wire_table(definitions: list[Path]) -> dict[int, tuple[int, int, int, int]]:
    """Return CRC_EXTRA, target offsets and size by message ID.

    The offsets are those of target system and component (-1: none). The size excludes extensions.
    """
    from pymavlink.generator import mavparse

    messages = [message for path in definitions for message in mavparse.MAVXML(str(path), "2.0").message]
    return {
        message.id: (
            message.crc_extra,
            message.target_system_ofs if message.message_flags & mavparse.FLAG_HAVE_TARGET_SYSTEM else -1,
            message.target_component_ofs if message.message_flags & mavparse.FLAG_HAVE_TARGET_COMPONENT else -1,
            message.wire_min_length,
        )
        for message in messages
    }


def load_dialect() -> Any:
    """Import the generated module; write it first unless the cache has a valid one."""
    path = cache_folder() / f"wingbeat_dialect_{fingerprint()}.py"
    try:
        return _load(path if path.exists() else generate(path.parent))
    except (OSError, ImportError, SyntaxError, ValueError, AttributeError):
        # A cache that is damaged or read-only must not prevent a flight.
        with tempfile.TemporaryDirectory(prefix="wingbeat-dialect-") as folder:
            return _load(generate(Path(folder)))


def _load(path: Path) -> Any:
    specification = importlib.util.spec_from_file_location("wingbeat_dialect", path)
    if specification is None or specification.loader is None:
        raise ImportError(f"cannot load {path}")
    module = importlib.util.module_from_spec(specification)
    specification.loader.exec_module(module)
    if not hasattr(module, "MAVLink_wingbeat_end_message") or not hasattr(module, "wire_table"):
        raise ImportError(f"{path} is incomplete")
    return module


mavlink: Any = load_dialect()
"""generated module, without types"""
