"""Telemetry of a MAVLink vehicle as one immutable state in SI.

``receive(state, message, now)`` returns the next state; a table gives one small function to each MAVLink message.
A quantity that was never received is None, so that a view does not show a zero for it.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import Any, NamedTuple

from avionics.link.dialect import mavlink
from avionics.link.vehicle import Home, Identity
from avionics.messages import Stage
from wingbeat.message import Severity

EVENTS_KEPT = 200
_UNKNOWN_U16 = 65535
_ARMED = 128
_FLOWN_BATTERY = 0
"""battery of SYS_STATUS; others supply payloads or are spare"""
_TYPE_GROUND_STATION = 6
_AUTOPILOT_INVALID = 8
_OUR_HARDWARE = Identity().uid
_OUR_WORDS = "WINGBEAT_"


class StatusLine(NamedTuple):
    """STATUSTEXT of the vehicle."""

    time: float | None
    """s; vehicle time since boot, None before its first time stamp"""
    severity: Severity
    """-; MAVLink severity"""
    text: str
    """-; one line"""


class VehicleState(NamedTuple):
    """Vehicle state received by the ground station; None for missing data."""

    system: int | None = None
    """-; MAVLink system id"""
    autopilot: int | None = None
    """-; MAV_AUTOPILOT"""
    is_wingbeat: bool = False
    """-; whether it is a Wingbeat flight computer, whatever autopilot type it reports: from AUTOPILOT_VERSION, or
    from a message of the Wingbeat dialect
    """
    vehicle_type: int | None = None
    """-; MAV_TYPE"""
    custom_mode: int | None = None
    """-; as in HEARTBEAT"""
    beats: int = 0
    """-; number of received heartbeats"""
    armed: bool | None = None
    """-; True if the wings are enabled"""
    time: float | None = None
    """s; vehicle time since boot"""
    received_at: float | None = None
    """s; time of the last message on the ground's monotonic clock"""
    messages: int = 0
    """-; number of received messages"""
    roll: float | None = None
    """rad; right wing down is positive"""
    pitch: float | None = None
    """rad; nose up is positive"""
    yaw: float | None = None
    """rad; clockwise from north"""
    airspeed: float | None = None
    """m/s; true"""
    groundspeed: float | None = None
    """m/s; over ground"""
    altitude: float | None = None
    """m; above home"""
    climb_rate: float | None = None
    """m/s; positive up"""
    throttle: float | None = None
    """-; 0 to 1"""
    latitude: float | None = None
    """rad; WGS-84"""
    longitude: float | None = None
    """rad; WGS-84"""
    north: float | None = None
    """m; from home"""
    east: float | None = None
    """m; from home"""
    satellites: int | None = None
    """-; used in the fix"""
    fix_type: int | None = None
    """-; 0 none, 2 two-, 3 three-dimensional"""
    voltage: float | None = None
    """V; supply. With `mean_supply` it is weighted with the current, so that voltage times ``current`` is ``power``
    """
    current: float | None = None
    """A; supply"""
    power: float | None = None
    """W; supply"""
    mean_supply: bool = False
    """-; whether the supply is a mean since the previous message, as for Wingbeat from its second message; else it
    is a sample
    """
    energy: float | None = None
    """J; drawn since boot"""
    charge: float | None = None
    """C; drawn since boot"""
    energy_time: float | None = None
    """s; since boot, of ``energy`` and ``charge``"""
    battery_remaining: float | None = None
    """-; 0 to 1"""
    flap_frequency: float | None = None
    """Hz; 0 when not flapping"""
    flap_angle: float | None = None
    """rad; mean of both wings, up is positive"""
    flap_left: float | None = None
    """rad; of the left wing, up is positive"""
    flap_right: float | None = None
    """rad; of the right wing, up is positive"""
    flap_phase: float | None = None
    """rad; 0 to 2 pi, 0 at the upward crossing of the stroke's middle"""
    flap_amplitude: float | None = None
    """rad; half the peak-to-peak stroke, mean of both wings"""
    flap_mean: float | None = None
    """rad; middle of the last stroke, up is positive"""
    stage: Stage | None = None
    """-; stage of the flight"""
    item: int | None = None
    """-; mission item being flown"""
    items: int | None = None
    """-; mission items aboard"""
    distance: float | None = None
    """m; to the item's place"""
    altitude_setpoint: float | None = None
    """m; to the position of the item"""
    heading_setpoint: float | None = None
    """rad; course to fly"""
    exciting: bool | None = None
    """-; True during an identification input"""
    capabilities: int | None = None
    """-; MAV_PROTOCOL_CAPABILITY"""
    home: Home | None = None
    """origin of north and east"""
    events: tuple[StatusLine, ...] = ()
    """lines received, oldest first, at most `EVENTS_KEPT`"""
    text_count: int = 0
    """-; lines received since the link was opened"""
    mode_names: tuple[tuple[int, str], ...] = ()
    """custom modes announced by AVAILABLE_MODES"""
    sentence: tuple[int, str] | None = None
    """id and text so far of a STATUSTEXT in chunks"""
    stamp: float | None = None
    """s; vehicle time since boot of the last SYSTEM_TIME: the time stamp of the STATUSTEXT that follows"""


def is_wingbeat_vehicle(state: VehicleState) -> bool:
    """Return whether it is a Wingbeat flight computer as far as known; a generic autopilot counts as one."""
    return state.is_wingbeat or state.autopilot == mavlink.MAV_AUTOPILOT_GENERIC


def new_events(state: VehicleState, count: int) -> tuple[StatusLine, ...]:
    """Return the lines received after the first ``count`` lines."""
    return state.events[-(state.text_count - count) :] if state.text_count > count else ()


Receiver = Callable[[VehicleState, Any], VehicleState]


def receive(state: VehicleState, message: Any, now: float) -> VehicleState:
    """Process one decoded MAVLink message received at ``now`` (s, any monotonic clock).

    The first autopilot is the vehicle; other systems and other ground stations on the link are ignored.
    """
    kind = message.get_type()
    if kind == "BAD_DATA" or message.get_srcSystem() != (state.system or message.get_srcSystem()):
        return state
    if kind == "HEARTBEAT" and not is_autopilot(message):
        return state
    receiver = RECEIVERS.get(kind)
    state = state._replace(messages=state.messages + 1, received_at=now)
    if kind != "STATUSTEXT" and state.stamp is not None:
        state = state._replace(stamp=None)
    if not state.is_wingbeat and kind.startswith(_OUR_WORDS):
        state = state._replace(is_wingbeat=True)
    if receiver is None:
        return state
    milliseconds = getattr(message, "time_boot_ms", None)
    if milliseconds and kind != "SYSTEM_TIME":
        state = state._replace(time=milliseconds * 1e-3)
    return receiver(state, message)


def is_autopilot(heartbeat: Any) -> bool:
    """Return whether a HEARTBEAT is that of an autopilot, not of a ground station, a gimbal or a router."""
    return bool(heartbeat.type != _TYPE_GROUND_STATION and heartbeat.autopilot != _AUTOPILOT_INVALID)


def _heartbeat(state: VehicleState, message: Any) -> VehicleState:
    return state._replace(
        system=message.get_srcSystem(),
        autopilot=message.autopilot,
        vehicle_type=message.type,
        custom_mode=message.custom_mode,
        beats=state.beats + 1,
        armed=bool(message.base_mode & _ARMED),
    )


def _attitude(state: VehicleState, message: Any) -> VehicleState:
    return state._replace(roll=message.roll, pitch=message.pitch, yaw=message.yaw)


def _hud(state: VehicleState, message: Any) -> VehicleState:
    return state._replace(
        airspeed=message.airspeed,
        groundspeed=message.groundspeed,
        climb_rate=message.climb,
        throttle=message.throttle / 100.0,
    )


def _global_position(state: VehicleState, message: Any) -> VehicleState:
    return state._replace(
        latitude=math.radians(message.lat * 1e-7),
        longitude=math.radians(message.lon * 1e-7),
        altitude=message.relative_alt * 1e-3,
    )


def _home(state: VehicleState, message: Any) -> VehicleState:
    latitude, longitude = math.radians(message.latitude * 1e-7), math.radians(message.longitude * 1e-7)
    return state._replace(home=Home(latitude, longitude, message.altitude * 1e-3))


def _local_position(state: VehicleState, message: Any) -> VehicleState:
    """Process LOCAL_POSITION_NED: only for Wingbeat its origin is home and its altitude used."""
    altitude = -message.z if is_wingbeat_vehicle(state) else state.altitude
    return state._replace(north=message.x, east=message.y, altitude=altitude)


def _gps(state: VehicleState, message: Any) -> VehicleState:
    satellites = message.satellites_visible
    return state._replace(fix_type=message.fix_type, satellites=None if satellites == 255 else satellites)


def _battery(state: VehicleState, message: Any) -> VehicleState:
    if message.id != _FLOWN_BATTERY:
        return state
    voltages = [cell for cell in message.voltages if cell != _UNKNOWN_U16]
    return _supply(
        state,
        sum(voltages) * 1e-3 if voltages else None,
        message.current_battery * 1e-2 if message.current_battery >= 0 else None,
        message.battery_remaining,
    )


def _system_status(state: VehicleState, message: Any) -> VehicleState:
    voltage = message.voltage_battery
    current = message.current_battery
    return _supply(
        state,
        voltage * 1e-3 if voltage != _UNKNOWN_U16 else None,
        current * 1e-2 if current >= 0 else None,
        message.battery_remaining,
    )


def _supply(state: VehicleState, voltage: float | None, current: float | None, percent: int) -> VehicleState:
    remaining = percent / 100.0 if percent >= 0 else state.battery_remaining
    if state.energy is not None:  # our own vehicle's message tells means, this one a phase of the stroke
        return state._replace(battery_remaining=remaining)
    voltage = state.voltage if voltage is None else voltage
    current = state.current if current is None else current
    power = state.power if voltage is None or current is None else voltage * current
    return state._replace(voltage=voltage, current=current, power=power, battery_remaining=remaining)


def _power(state: VehicleState, message: Any) -> VehicleState:
    mean = _mean_supply(state, message)
    voltage, current, power = mean or (float(message.voltage), float(message.current), float(message.power))
    return state._replace(
        voltage=voltage,
        current=current,
        power=power,
        mean_supply=mean is not None,
        energy=message.energy,
        charge=message.charge,
        energy_time=message.time_boot_ms * 1e-3,
        battery_remaining=message.battery_remaining,
    )


def _mean_supply(state: VehicleState, message: Any) -> tuple[float, float, float] | None:
    """Return mean V, A, W from energy and charge since the previous message; None without a sufficient interval.

    The samples in the message cover 10 ms. If their rate is a multiple of the flapping frequency, they always show
    the same phase of the stroke.
    """
    if state.energy is None or state.charge is None or state.energy_time is None:
        return None
    span = message.time_boot_ms * 1e-3 - state.energy_time
    energy, charge = message.energy - state.energy, message.charge - state.charge
    if span <= 0.2 or energy < 0.0 or charge < 0.0:
        return None
    voltage = energy / charge if charge > 0.0 else message.voltage
    return float(voltage), float(charge / span), float(energy / span)


def _wing(state: VehicleState, message: Any) -> VehicleState:
    return state._replace(
        flap_frequency=message.frequency,
        flap_angle=0.5 * (message.angle_left + message.angle_right),
        flap_left=message.angle_left,
        flap_right=message.angle_right,
        flap_phase=message.phase,
        flap_amplitude=0.5 * (message.amplitude_left + message.amplitude_right),
        flap_mean=message.mean_angle,
    )


def _navigation(state: VehicleState, message: Any) -> VehicleState:
    known = message.stage in Stage._value2member_map_
    # As in MISSION_CURRENT: item 0 is home on ArduPilot.
    first = 1 if state.autopilot == mavlink.MAV_AUTOPILOT_ARDUPILOTMEGA else 0
    return state._replace(
        stage=Stage(message.stage) if known else None,
        item=message.item + first,
        distance=message.distance,
        altitude_setpoint=message.altitude_setpoint,
        heading_setpoint=message.heading_setpoint,
    )


def _excitation(state: VehicleState, message: Any) -> VehicleState:
    return state._replace(exciting=bool(message.active))


def _mission_current(state: VehicleState, message: Any) -> VehicleState:
    total = getattr(message, "total", 0)
    return state._replace(item=message.seq, items=total if 0 < total < _UNKNOWN_U16 else state.items)


def _version(state: VehicleState, message: Any) -> VehicleState:
    ours = state.is_wingbeat or message.uid == _OUR_HARDWARE
    return state._replace(capabilities=message.capabilities, is_wingbeat=ours)


def _navigation_output(state: VehicleState, message: Any) -> VehicleState:
    """Process the guidance output of other autopilots; Wingbeat has a more precise message."""
    if state.stage is not None:
        return state
    bearing = math.radians(message.target_bearing)
    return state._replace(distance=float(message.wp_dist), heading_setpoint=bearing)


def _system_time(state: VehicleState, message: Any) -> VehicleState:
    """Process the time of the next message, which may be older than the telemetry; the telemetry time never
    decreases.
    """
    if not message.time_boot_ms:
        return state
    stamp = message.time_boot_ms * 1e-3
    return state._replace(stamp=stamp, time=stamp if state.time is None else max(state.time, stamp))


def _status_text(state: VehicleState, message: Any) -> VehicleState:
    """Join the chunks of a long STATUSTEXT; a chunk shorter than 50 characters is the last."""
    text = message.text if isinstance(message.text, str) else message.text.decode("utf-8", "replace")
    text = text.partition("\0")[0]
    number = getattr(message, "id", 0)
    if number:
        started, so_far = state.sentence or (number, "")
        text = (so_far if started == number else "") + text
        if len(message.text) == 50 and "\0" not in message.text:
            return state._replace(sentence=(number, text))
    clean = "".join(letter if letter.isprintable() else " " for letter in text).strip()
    heard = StatusLine(
        state.time if state.stamp is None else state.stamp, Severity(min(max(message.severity, 0), 7)), clean
    )
    return state._replace(
        events=(*state.events, heard)[-EVENTS_KEPT:], text_count=state.text_count + 1, sentence=None
    )


def _available_mode(state: VehicleState, message: Any) -> VehicleState:
    name = str(message.mode_name).partition("\0")[0].strip()
    if not name:
        return state
    others = tuple(entry for entry in state.mode_names if entry[0] != message.custom_mode)
    return state._replace(mode_names=(*others, (message.custom_mode, name)))


RECEIVERS: dict[str, Receiver] = {
    "HEARTBEAT": _heartbeat,
    "ATTITUDE": _attitude,
    "VFR_HUD": _hud,
    "GLOBAL_POSITION_INT": _global_position,
    "LOCAL_POSITION_NED": _local_position,
    "HOME_POSITION": _home,
    "GPS_RAW_INT": _gps,
    "BATTERY_STATUS": _battery,
    "SYS_STATUS": _system_status,
    "SYSTEM_TIME": _system_time,
    "MISSION_CURRENT": _mission_current,
    "AUTOPILOT_VERSION": _version,
    "NAV_CONTROLLER_OUTPUT": _navigation_output,
    "STATUSTEXT": _status_text,
    "AVAILABLE_MODES": _available_mode,
    "WINGBEAT_WING_STATE": _wing,
    "WINGBEAT_POWER": _power,
    "WINGBEAT_NAVIGATION": _navigation,
    "WINGBEAT_EXCITATION": _excitation,
}
"""MAVLink message to the function that processes it."""
