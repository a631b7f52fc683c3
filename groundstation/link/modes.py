"""Names of flight modes: announced, or known for the autopilot."""

from __future__ import annotations

from collections.abc import Mapping

from avionics.link.dialect import mavlink
from avionics.link.vehicle import PX4_STYLE
from groundstation.link.vehicle_state import VehicleState

ARDUPILOT = 3
PX4 = 12


def known_modes(state: VehicleState) -> dict[str, int]:
    """Return upper-case names with custom modes; empty if neither the vehicle nor its type defines them."""
    return {canonical(name): number for number, name in state.mode_names} or _table(state)


def mode_numbers(state: VehicleState) -> dict[str, int]:
    """Return `known_modes`, and the usual names of the autopilot for modes announced under other names."""
    known = known_modes(state)
    there = set(known.values())
    return {**{name: number for name, number in _table(state).items() if number in there}, **known}


EQUIVALENT = (
    ("STABILIZED", "FBWA", "STABILIZE"),
    ("ALTITUDE_HOLD", "ALTITUDE", "ALTCTL", "FBWB", "ALT_HOLD"),
    ("AUTO", "MISSION"),
    ("RETURN", "RTL"),
    ("LAND", "AUTOLAND"),
    ("LOITER", "HOLD"),
)
"""names of the same mode on different autopilots, in order of preference"""


def equivalent(state: VehicleState, name: str) -> str:
    """Return the name under which the vehicle offers a mode, as `mode_numbers` spells it; ``name`` if it has none."""
    available, name = mode_numbers(state), canonical(name)
    names = next((group for group in EQUIVALENT if name in group), ())
    return next((one for one in (name, *names) if one in available), name)


def canonical(name: str) -> str:
    """Return a mode name in the notation of the tables."""
    return name.upper().replace(" ", "_").replace("-", "_")


def _table(state: VehicleState) -> dict[str, int]:
    if state.autopilot == ARDUPILOT:
        return _ardupilot(state.vehicle_type or 0)
    if state.autopilot == PX4:
        return _px4()
    return {numbers.mode.name: numbers.custom_mode for numbers in PX4_STYLE}


def mode_name(state: VehicleState) -> str:
    """Return the present mode's display name, as in events and `known_modes`; empty before a heartbeat."""
    key = mode_key(state)
    return key if key in known_modes(state) else key.replace("_", " ")


def mode_key(state: VehicleState) -> str:
    """Return the present mode in the notation of `known_modes`, or ``mode_5``; empty before a heartbeat."""
    if state.custom_mode is None:
        return ""
    names: Mapping[int, str] = {number: name for name, number in known_modes(state).items()}
    return names.get(state.custom_mode, f"mode_{state.custom_mode}")


def type_name(vehicle_type: int | None) -> str:
    """Return the display name of a MAV_TYPE: ``flapping wing``."""
    entry = mavlink.enums["MAV_TYPE"].get(vehicle_type)
    return "vehicle" if entry is None else str(entry.name).removeprefix("MAV_TYPE_").lower().replace("_", " ")


def autopilot_name(autopilot: int | None) -> str:
    """Return the display name of a MAV_AUTOPILOT: ``ardupilotmega``."""
    entry = mavlink.enums["MAV_AUTOPILOT"].get(autopilot)
    return "autopilot" if entry is None else str(entry.name).removeprefix("MAV_AUTOPILOT_").lower().replace("_", " ")


def uses_main_and_sub(state: VehicleState) -> bool:
    """Return whether DO_SET_MODE takes separate main and sub modes, as PX4 and Wingbeat do."""
    return state.autopilot != ARDUPILOT


def _ardupilot(vehicle_type: int) -> dict[str, int]:
    from pymavlink import mavutil

    names = mavutil.mode_mapping_byname(vehicle_type) or {}
    return {str(name): int(number) for name, number in names.items()}


def _px4() -> dict[str, int]:
    from pymavlink import mavutil

    return {name: main << 16 | sub << 24 for name, (_, main, sub) in mavutil.px4_map.items()}
