"""Missions as text and JSON.

The commands are MAVLink's own, of any vehicle, and those of our dialect; of one that is not known here the parameters
are shown as they came.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from typing import Any, NamedTuple

from avionics.guidance.excitation import SWEEPS
from avionics.guidance.mission import Channel, Excitation, ItemKind, Shape
from avionics.link.dialect import mavlink
from avionics.link.excitation_codec import DECODERS, decode_excitation
from avionics.link.mission_codec import LOCAL_FRAMES, SKIPPED, read_speed, wire_scale
from avionics.link.wire_item import ItemRefused
from groundstation.link.commands import command_name
from groundstation.link.missions import Item
from groundstation.link.waypoints import wire_item
from groundstation.views import tables, wording
from groundstation.views.terminal import open_console
from wingbeat.text import pluralize

MISSION_FRAME = mavlink.MAV_FRAME_MISSION
SEA_FRAMES = frozenset((mavlink.MAV_FRAME_GLOBAL, mavlink.MAV_FRAME_GLOBAL_INT))
TERRAIN_FRAMES = frozenset((mavlink.MAV_FRAME_GLOBAL_TERRAIN_ALT, mavlink.MAV_FRAME_GLOBAL_TERRAIN_ALT_INT))
ENU = mavlink.MAV_FRAME_LOCAL_ENU
AIMED = frozenset((mavlink.MAV_CMD_DO_SET_ROI_LOCATION, mavlink.MAV_CMD_DO_SET_ROI, mavlink.MAV_CMD_NAV_ROI))
"""commands of `SKIPPED` whose last three parameters are a position"""


class MissionItemView(NamedTuple):
    """Mission item in SI units and radians; None for numbers that it lacks."""

    does: str
    """-; description"""
    north: float | None = None
    """m; from home, of a position in a local frame"""
    east: float | None = None
    """m; from home, of a position in a local frame"""
    latitude: float | None = None
    """rad; WGS-84, of a global position"""
    longitude: float | None = None
    """rad; WGS-84, of a global position"""
    altitude: float | None = None
    """m; above ``altitude_above``"""
    altitude_above: str | None = None
    """-; home, sea or terrain"""
    duration: float | None = None
    """s; of a hold or loiter"""
    heading: float | None = None
    """rad; clockwise from north, of a hold or landing"""
    radius: float | None = None
    """m; positive clockwise"""
    turns: float | None = None
    """-; number of loiter turns"""
    acceptance: float | None = None
    """m; acceptance radius of a waypoint"""
    jump_to: int | None = None
    """-; number of the next item after a jump"""
    repeats: int | None = None
    """-; number of jumps, -1 for no limit"""
    excitation: Excitation | None = None
    """-; the identification input"""
    airspeed: float | None = None
    """m/s; setpoint from this item on"""


def item_view(item: Item) -> MissionItemView:
    """Convert an item to SI units."""
    known = KINDS.get(item.command)
    if known is not None:
        return known(item)
    return _placed(item, wording.words(command_name(item.command)))


def _positive(value: float) -> float | None:
    return value if math.isfinite(value) and value > 0.0 else None


def _finite(value: float) -> float | None:
    return value if math.isfinite(value) else None


def _nonzero(value: float) -> float | None:
    return value if math.isfinite(value) and value != 0.0 else None


def _radians(degrees: float) -> float | None:
    return math.radians(degrees) if math.isfinite(degrees) else None


def _placed(item: Item, does: str) -> MissionItemView:
    """Add position and altitude, which are the same for most commands."""
    if _has_no_place(item):
        return MissionItemView(does)
    scale, above = wire_scale(item.frame), _above(item.frame)
    down = item.frame in LOCAL_FRAMES and item.frame != ENU
    one = MissionItemView(does, altitude=(-item.z if down else item.z) + 0.0, altitude_above=above)
    if not item.x and not item.y:
        return one
    x, y = item.x / scale, item.y / scale
    if item.frame in LOCAL_FRAMES:
        north, east = (y, x) if item.frame == ENU else (x, y)
        return one._replace(north=north, east=east)
    return one._replace(latitude=math.radians(x), longitude=math.radians(y))


def _has_no_place(item: Item) -> bool:
    """Return whether the last three parameters are not a position, as for camera commands in any frame."""
    return item.frame == MISSION_FRAME or (item.command in SKIPPED and item.command not in AIMED)


def _above(frame: int) -> str:
    if frame in SEA_FRAMES:
        return "sea"
    return "terrain" if frame in TERRAIN_FRAMES else "home"


def _waypoint(item: Item) -> MissionItemView:
    wait, acceptance = item.parameters[:2]
    return _placed(item, "fly to")._replace(duration=_positive(wait), acceptance=_positive(acceptance))


def _land(item: Item) -> MissionItemView:
    return _placed(item, "land")._replace(heading=_radians(item.parameters[3]))


def _level_text(item: Item) -> MissionItemView:
    duration, heading = item.parameters[:2]
    return _placed(item, "hold course")._replace(duration=_finite(duration), heading=_radians(heading))


def _jump(item: Item) -> MissionItemView:
    target, repeats = (int(value) if math.isfinite(value) else None for value in item.parameters[:2])
    return MissionItemView(f"go on with item {target}", jump_to=target, repeats=repeats)


def _speed(item: Item) -> MissionItemView:
    speed = read_speed(item.parameters)
    if speed is None:
        return MissionItemView(f"change speed: {_raw(item) or 'nothing'}")
    return MissionItemView("change airspeed" if speed else "default airspeed", airspeed=speed or None)


def _circle(does: str, radius_at: int, **amounts: int) -> Callable[[Item], MissionItemView]:
    """Return the view of a loiter whose radius and ``amounts`` are the parameters with these indices, from 0."""

    def read(item: Item) -> MissionItemView:
        values: dict[str, Any] = {name: _positive(item.parameters[at]) for name, at in amounts.items()}
        return _placed(item, does)._replace(radius=_nonzero(item.parameters[radius_at]), **values)

    return read


def _excite(item: Item) -> MissionItemView:
    try:
        requested = decode_excitation(wire_item(item))
    except ItemRefused as refused:
        return MissionItemView(f"{wording.words(command_name(item.command))}: {refused}")
    return MissionItemView(wording.words(Shape(requested.shape).name), excitation=requested)


KINDS: dict[int, Callable[[Item], MissionItemView]] = {
    ItemKind.WAYPOINT: _waypoint,
    ItemKind.LOITER: _circle("circle without end", 2),
    ItemKind.CIRCLE: _circle("circle", 2, turns=0),
    mavlink.MAV_CMD_NAV_LOITER_TIME: _circle("circle", 2, duration=0),
    mavlink.MAV_CMD_NAV_LOITER_TO_ALT: _circle("circle to altitude", 1),
    ItemKind.RETURN: lambda item: MissionItemView("return to launch"),
    ItemKind.LAND: _land,
    ItemKind.TAKEOFF: lambda item: _placed(item, "take off to"),
    ItemKind.JUMP: _jump,
    ItemKind.SPEED: _speed,
    ItemKind.LAND_START: lambda item: _placed(item, "landing sequence"),
    ItemKind.HOLD: _level_text,
    **dict.fromkeys(DECODERS, _excite),
}
"""converter of an item, by command"""


def mission_record(number: int, item: Item) -> dict[str, Any]:
    """Return an item as a JSON object: the fields of `MissionItemView`, and those of MISSION_ITEM_INT."""
    text = item_view(item)._asdict()
    if text["excitation"] is not None:
        text["excitation"] = _excitation_record(text["excitation"])
    return {"number": number, **text, **item._asdict()}


def _excitation_record(requested: Excitation) -> dict[str, Any]:
    elevator, throttle, rudder = requested.amplitudes()
    kept = {name: getattr(requested, name) for name in ("width", "settle", "repeats", "low", "high")}
    amplitudes = {"elevator": elevator, "throttle": throttle, "rudder": rudder}
    return {
        "shape": Shape(requested.shape).name,
        **amplitudes,
        **kept,
        "loops": "active" if requested.loops else "frozen",
    }


def difference_lines(part: str, number: int, file_item: Item | None, vehicle_item: Item | None) -> list[str]:
    """Return two lines, of the file and of the vehicle, about a different item."""
    ours, theirs = ("nothing" if item is None else _line(item) for item in (file_item, vehicle_item))
    return [f"{part} {number}  file     {ours}", f"{'':{len(part) + len(str(number)) + 1}}  vehicle  {theirs}"]


def _line(item: Item) -> str:
    text = item_view(item)
    return "  ".join(part for part in (text.does, _place(text), _altitude(text), _how(text, item)) if part)


def print_mission(items: Sequence[Item], home_first: bool = False) -> None:
    """Print the vehicle's mission, one row per item; with ``home_first`` number 0 is home."""
    if not items:
        print("the vehicle has no mission")
        return
    table = tables.plain_table(("", "right"), ("what", ""), ("place", ""), ("altitude", "right"), ("how", ""))
    for number, row in enumerate(mission_rows(items, home_first)):
        table.add_row(str(number), *row)
    open_console().print(table)


def mission_rows(items: Sequence[Item], home_first: bool = False) -> list[tuple[str, str, str, str]]:
    """Return what each item does, its place, its altitude and its other values, as text."""
    texts = [item_view(item) for item in items]
    if home_first and texts:
        texts[0] = texts[0]._replace(does="home")
    return [(t.does, _place(t), _altitude(t), _how(t, item)) for t, item in zip(texts, items, strict=True)]


def _place(text: MissionItemView) -> str:
    if text.north is not None and text.east is not None:
        return f"{text.north:+.1f} m N  {text.east:+.1f} m E"
    if text.latitude is not None and text.longitude is not None:
        return f"{math.degrees(text.latitude):.6f}°  {math.degrees(text.longitude):.6f}°"
    return ""


def _altitude(text: MissionItemView) -> str:
    if text.altitude is None:
        return ""
    beside = {"sea": " above the sea", "terrain": " above the terrain"}
    return f"{round(text.altitude, 2):g} m{beside.get(text.altitude_above or '', '')}"


def _how(text: MissionItemView, item: Item) -> str:
    """Format the values of an item other than position and altitude, with units."""
    if item.command not in KINDS:
        return _raw(item)
    if text.excitation is not None:
        return _input(text.excitation)
    parts = [
        "" if text.turns is None else pluralize(text.turns, "turn"),
        "" if text.duration is None else f"for {text.duration:g} s",
        "" if text.heading is None else f"heading {wording.bearing(text.heading)}",
        "" if text.airspeed is None else f"{text.airspeed:g} m/s",
        _radius(text.radius),
        "" if text.acceptance is None else f"reached within {text.acceptance:g} m",
        _repeats(text.repeats),
    ]
    return "  ".join(part for part in parts if part)


def _radius(radius: float | None) -> str:
    if radius is None:
        return ""
    return f"radius {abs(radius):g} m" + ("" if radius > 0.0 else " counter-clockwise")


def _repeats(repeats: int | None) -> str:
    if repeats is None:
        return ""
    return "for ever" if repeats < 0 else pluralize(repeats, "time")


def _raw(item: Item) -> str:
    """Format the raw parameters of an unknown command."""
    scale = wire_scale(item.frame)
    places = (item.x / scale, item.y / scale, item.z) if _has_no_place(item) else ()
    values = enumerate((*item.parameters, *places), 1)
    return "  ".join(f"parameter {n} {value:g}" for n, value in values if math.isfinite(value) and value)


def _input(requested: Excitation) -> str:
    amplitudes = zip(Channel, requested.amplitudes(), strict=True)
    parts = [_amplitude(channel, value) for channel, value in amplitudes if value]
    if requested.shape in SWEEPS or requested.shape == Shape.MULTISINE:
        parts.append(f"{requested.low:g} to {requested.high:g} Hz")
    length = "steps of" if requested.shape in (Shape.DOUBLET, Shape.MULTISTEP_3211) else "over"
    parts.append(f"{'period' if requested.shape == Shape.MULTISINE else length} {requested.width:g} s")
    parts += [f"settling {requested.settle:g} s", pluralize(requested.repeats, "time")]
    return "  ".join([*parts, "loops active" if requested.loops else "loops frozen"])


def _amplitude(channel: Channel, value: float) -> str:
    number = f"±{value:.2f}" if channel == Channel.THROTTLE else f"±{math.degrees(value):.1f}°"
    return f"{channel.name.lower()} {number}"
