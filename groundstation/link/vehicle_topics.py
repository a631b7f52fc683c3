"""Vehicle topics from telemetry, so that ground recordings open like flight logs.

What telemetry does not carry is NaN, a flag or count 0. Rates are telemetry's.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import Any, NamedTuple

from avionics import messages as m
from avionics import topics as t
from avionics.link.vehicle import PROFILES
from groundstation.link.vehicle_state import VehicleState, is_wingbeat_vehicle
from wingbeat.quaternions import quaternion_from_euler
from wingbeat.topic import Topic

NAN = math.nan
_NO_SPEED = 65535


class Entry(NamedTuple):
    """One message for the log."""

    topic: Topic[Any]
    message: Any


Builder = Callable[[Any, int, VehicleState], Any]
"""(MAVLink message, us since boot, vehicle state) to a message of the topic, None for none"""


def _attitude(message: Any, time_us: int, state: VehicleState) -> m.Attitude:
    turn = (message.roll, message.pitch, message.yaw, message.rollspeed, message.pitchspeed, message.yawspeed)
    unknown = (NAN,) * 9
    return m.Attitude(
        time_us, *turn, *quaternion_from_euler(message.roll, message.pitch, message.yaw), *unknown, 0, 0
    )


def _altitude(message: Any, time_us: int, state: VehicleState) -> m.Altitude:
    return m.Altitude(time_us, message.relative_alt * 1e-3, -message.vz * 1e-2, *(NAN,) * 5)


def _position(message: Any, time_us: int, state: VehicleState) -> m.Position:
    place = (message.x, message.y, message.vx, message.vy)
    globe = (state.latitude or 0.0, state.longitude or 0.0)
    return m.Position(time_us, *place, NAN, NAN, *globe, NAN, 1, *(NAN,) * 8)


def _air_data(message: Any, time_us: int, state: VehicleState) -> m.AirData | None:
    """Convert air data of a Wingbeat vehicle; the airspeed of others is indicated, not true."""
    if not is_wingbeat_vehicle(state):
        return None
    return m.AirData(time_us, message.airspeed, *(NAN,) * 9)


def _gps(message: Any, time_us: int, state: VehicleState) -> m.GpsFix:
    course, speed = math.radians(message.cog * 1e-2), message.vel * 1e-2
    known = message.vel != _NO_SPEED and message.cog != _NO_SPEED
    north, east = (speed * math.cos(course), speed * math.sin(course)) if known else (NAN, NAN)
    horizontal, vertical = (mm * 1e-3 if mm else NAN for mm in (message.h_acc, message.v_acc))
    satellites = 0 if message.satellites_visible == 255 else message.satellites_visible
    return m.GpsFix(
        time_us,
        math.radians(message.lat * 1e-7),
        math.radians(message.lon * 1e-7),
        message.alt * 1e-3,
        north,
        east,
        NAN,
        horizontal,
        vertical,
        message.fix_type,
        satellites,
    )


def _mode(state: VehicleState) -> Any:
    """Return avionics.messages.Mode of a custom mode in the vehicle's MAVLink profile; 0 for an unknown one."""
    identity = next((each for each in PROFILES.values() if each.autopilot == state.autopilot), None)
    known = None if identity is None else identity.by_custom_mode(state.custom_mode or 0)
    return 0 if known is None else known


def _navigation(message: Any, time_us: int, state: VehicleState) -> m.NavigationStatus:
    return m.NavigationStatus(
        time_us,
        _mode(state),
        message.stage,
        int(bool(state.armed)),
        message.item,
        message.distance,
        message.cross_track,
        message.altitude_setpoint,
        message.heading_setpoint,
        message.frozen,
    )


def _same_names(kind: Any) -> Builder:
    """Return the converter of a Wingbeat message whose field names equal those of the topic."""

    def build(message: Any, time_us: int, state: VehicleState) -> Any:
        return kind(time_us, *(getattr(message, name) for name in kind._fields[1:]))

    return build


def _as_received(topic: Topic[Any]) -> Topic[Any]:
    return topic._replace(rate=topic.telemetry_rate, deterministic=False)


EVENTS = _as_received(t.EVENTS)
BUILDERS: dict[str, tuple[Topic[Any], Builder]] = {
    "ATTITUDE": (_as_received(t.ATTITUDE), _attitude),
    "GLOBAL_POSITION_INT": (_as_received(t.ALTITUDE), _altitude),
    "LOCAL_POSITION_NED": (_as_received(t.POSITION), _position),
    "VFR_HUD": (_as_received(t.AIR_DATA), _air_data),
    "GPS_RAW_INT": (_as_received(t.GPS), _gps),
    "WINGBEAT_WING_STATE": (_as_received(t.WING), _same_names(m.WingState)),
    "WINGBEAT_POWER": (_as_received(t.POWER), _same_names(m.PowerState)),
    "WINGBEAT_NAVIGATION": (_as_received(t.NAVIGATION), _navigation),
    "WINGBEAT_EXCITATION": (_as_received(t.EXCITATION), _same_names(m.ExcitationStatus)),
}
"""MAVLink message to its topic and converter"""


def entry_of(message: Any, time_us: int, state: VehicleState) -> Entry | None:
    """Convert a MAVLink message to a message of the vehicle's own topics, if there is one."""
    found = BUILDERS.get(message.get_type())
    if found is None:
        return None
    built = found[1](message, time_us, state)
    return None if built is None else Entry(found[0], built)
