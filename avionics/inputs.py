"""Inputs of a flight: JSON for the log, and effect of each command.

Within a tick MANUAL_CONTROL is processed first, then channel overrides, then commands in order. A replay that merges
the three logged topics by time therefore repeats the flight exactly. The topic of the sticks also contains the other
sources: these follow from frames and channels, and are not inputs.
"""

from __future__ import annotations

import copy
import json
import math
from collections.abc import Callable, Sequence
from typing import Any

from avionics import parameters, piloting, snapshot, topics
from avionics.calibration import procedure as calibration
from avionics.guidance import altitude as altitude_loop
from avionics.guidance import arming, excitation, failsafes, modes, navigation, offboard, throttle_descent
from avionics.guidance import fence as fence_border
from avionics.guidance.mission import Excitation, Fence, ItemKind, Mission, MissionItem, Rally, channel_names
from avionics.guidance.setpoint import Path, Received, Setpoint
from avionics.messages import Calibration, ChannelOverride, Command, CommandKind, Input, Mode, PilotInput, Stage
from avionics.missions import check_mission
from avionics.missions.excitations import check_excitation
from avionics.missions.limits import check_climb, check_fence, check_item, check_rally
from avionics.sensing.pilot import Act
from avionics.situation import conditions, position_usable, surroundings, unready
from avionics.state import AutopilotState
from wingbeat.documents import parse_json
from wingbeat.message import Event, Severity, Text
from wingbeat.text import pluralize
from wingbeat.topic import Publish, Topic

FORCED_DISARM = 21196.0
"""value of a DISARM that also applies in flight (number of MAVLink)"""


class Refused(Exception):
    """A denied command, without any change of the state."""

    def __init__(self, source: str, text: str) -> None:
        """Store the source of the event and the reason in one line."""
        super().__init__(text)
        self.source, self.text = source, text


def encode_command(command: Command) -> str:
    """Return the exact JSON of a command; `decode_command` is its inverse."""
    return json.dumps(
        {
            "time_us": command.time_us,
            "kind": command.kind.name,
            "name": command.name,
            "value": command.value,
            "payload": command.payload,
            "source": command.source,
        },
        separators=(",", ":"),
    )


def decode_command(text: str) -> Command:
    """Decode a command that `encode_command` wrote."""
    document = parse_json(text)
    kind = CommandKind[document["kind"]]
    payload = document["payload"]
    if payload is not None and kind in PAYLOADS:
        payload = snapshot.builder(PAYLOADS[kind])(payload)
    return Command(document["time_us"], kind, document["name"], document["value"], payload, document["source"])


PAYLOADS: dict[CommandKind, Any] = {
    CommandKind.SET_MISSION: Mission,
    CommandKind.SET_FENCE: Fence,
    CommandKind.SET_RALLY: Rally,
    CommandKind.EXCITE: Excitation,
    CommandKind.LOITER_AT: MissionItem,
    CommandKind.SET_SETPOINT: Setpoint,
    CommandKind.SET_MODE: Setpoint,
}
"""payload types of commands, for their JSON"""


def receive(s: AutopilotState, publish: Publish, inputs: Sequence[Input]) -> None:
    """Log and apply all inputs received since the last tick."""
    if not inputs:
        return
    time_us = max(s.clock.time_us, 0)
    for entry in inputs:
        if isinstance(entry, PilotInput):
            piloting.take_sticks(s, publish, entry._replace(time_us=time_us))
    for entry in inputs:
        if isinstance(entry, ChannelOverride):
            requested = piloting.take_override(s, publish, entry._replace(time_us=time_us))
            act(s, publish, requested, "override")
    for entry in inputs:
        if isinstance(entry, Command):
            command = _plain(entry._replace(time_us=time_us))
            publish(topics.INPUTS, Text(time_us, encode_command(command)))
            _apply(s, publish, command)


def refusal(s: AutopilotState, command: Command) -> str:
    """Return why ``command`` would be denied now, in one line; empty if accepted.

    The command is applied to a copy of the memory, without messages.
    """
    try:
        APPLY[command.kind](
            copy.copy(s), _manual_control_lost, _plain(command._replace(time_us=max(s.clock.time_us, 0)))
        )
    except Refused as refused:
        return refused.text
    return ""


def _manual_control_lost(topic: Topic[Any], message: Any) -> None:
    pass


def _apply(s: AutopilotState, publish: Publish, command: Command) -> None:
    try:
        APPLY[command.kind](s, publish, command)
    except Refused as refused:
        publish_event(s, publish, Severity.WARNING, refused.source, refused.text)


def act(s: AutopilotState, publish: Publish, requested: Sequence[Act], source: str) -> None:
    """Execute the commands of switches.

    They are logged with the channels that cause them, not as separate inputs.
    """
    for each in requested:
        _apply(s, publish, Command(s.clock.time_us, each.kind, each.name, source=source))


def publish_event(s: AutopilotState, publish: Publish, severity: Severity, source: str, text: str) -> None:
    """Publish one event at the time of the tick."""
    publish(topics.EVENTS, Event(max(s.clock.time_us, 0), severity, source, text))


def publish_parameter(s: AutopilotState, publish: Publish, name: str, value: float, source: str) -> None:
    """Publish the new value of a parameter, for programs that read the log."""
    document = {"parameter": name, "value": value, "source": source}
    publish(topics.CHANGES, Text(max(s.clock.time_us, 0), json.dumps(document)))


def publish_notices(s: AutopilotState, publish: Publish, notices: tuple[modes.Notice, ...]) -> None:
    """Publish the notices of the modes as events."""
    for notice in notices:
        publish_event(s, publish, notice.severity, "modes", notice.text)


def _plain(command: Command) -> Command:
    """Return the command with a plain payload: an excitation or a tuple of items."""
    payload = command.payload
    if isinstance(payload, MissionItem) and command.kind == CommandKind.EXCITE:
        payload = payload.excitation
    elif command.kind in (CommandKind.SET_MISSION, CommandKind.SET_RALLY):
        payload = tuple(payload or ())
    return command._replace(payload=payload)


def _taken(outcome: modes.Outcome, before: modes.State) -> modes.Outcome:
    """Return the outcome of a request to the modes.

    Raises:
        Refused: the state is unchanged, with a warning.
    """
    state, notices = outcome
    if state is before and notices and notices[0].severity <= Severity.WARNING:
        raise Refused("modes", notices[0].text)
    return outcome


def _arm(s: AutopilotState, publish: Publish, command: Command) -> None:
    if s.calibration.kind:
        text = f"arming denied: calibration {s.calibration.kind.name} active"
        raise Refused("calibration", text)
    landed = s.modes.stage == Stage.LANDED or s.navigation.item >= len(s.mission)
    was_armed = s.modes.armed
    breach = s.mission_breach if s.modes.mode == Mode.AUTO else ""
    reasons = (*unready(s), *([breach] if breach else []))
    s.modes, notices = _taken(arming.arm(s.gains.modes, s.modes, conditions(s)._replace(unready=reasons)), s.modes)
    if s.modes.armed and not was_armed:
        s.wing_check = s.wing_check._replace(jammed=0)
        s.tail_check = s.tail_check._replace(jammed=0)
        s.throttle_descent = throttle_descent.State()
        if landed:
            s.navigation = navigation.choose_item(s.navigation, 0)
    publish_notices(s, publish, notices)


def _disarm(s: AutopilotState, publish: Publish, command: Command) -> None:
    s.modes, notices = _taken(arming.disarm(s.modes, command.value == FORCED_DISARM), s.modes)
    publish_notices(s, publish, notices)


def _kill(s: AutopilotState, publish: Publish, command: Command) -> None:
    by = {"receiver": "kill switch", "override": "kill switch"}.get(command.source, "flight termination")
    s.modes, notices = arming.kill(s.modes, by)
    publish_notices(s, publish, notices)


def _set_mode(s: AutopilotState, publish: Publish, command: Command) -> None:
    name = command.name.upper()
    if name not in Mode.__members__:
        raise Refused("modes", f"unknown mode {command.name}; known: {', '.join(Mode.__members__)}")
    breach = s.mission_breach if name == Mode.AUTO.name else ""
    if breach and s.modes.mode != Mode.AUTO:
        raise Refused("modes", f"mode AUTO denied: {breach}")
    before = s.offboard
    if command.payload is not None and s.modes.mode != Mode.OFFBOARD:
        _set_setpoint(s, publish, command)
    try:
        s.modes, notices = _taken(modes.set_mode(s.gains.modes, s.modes, Mode[name], conditions(s)), s.modes)
    except Refused:
        s.offboard = before
        raise
    publish_notices(s, publish, notices)


def _set_parameter(s: AutopilotState, publish: Publish, command: Command) -> None:
    table = parameters.parameter_table(s.gains)
    if s.modes.armed and command.name in table and parameters.grounded(table[command.name]):
        raise Refused("parameters", f"{command.name} denied: armed, disarm first")
    change = parameters.set_value(s.gains, table, command.name, command.value)
    if not change.accepted:
        raise Refused("parameters", change.text)
    s.gains = change.gains
    publish_parameter(s, publish, command.name, change.value, command.source)
    publish_event(s, publish, Severity.INFO, "parameters", change.text)


def _set_mission(s: AutopilotState, publish: Publish, command: Command) -> None:
    mission: Mission = command.payload
    refusal = check_mission(mission)
    if mission and s.modes.stage not in modes.AIRBORNE:
        refusal = refusal or check_climb(mission)
    if refusal:
        raise Refused("mission", f"mission rejected: {refusal}")
    s.mission = mission
    s.navigation = navigation.choose_item(s.navigation, 0)
    publish(topics.CHANGES, Text(max(s.clock.time_us, 0), json.dumps({"mission": len(mission)})))
    publish_event(s, publish, Severity.INFO, "mission", f"mission accepted ({pluralize(len(mission), 'item')})")
    _warn_of_breach(s, publish)


def _set_fence(s: AutopilotState, publish: Publish, command: Command) -> None:
    fence: Fence = command.payload or Fence()
    refusal = check_fence(fence)
    if refusal:
        raise Refused("mission", f"fence rejected: {refusal}")
    s.fence, s.fence_clearance = fence, math.inf
    publish_event(s, publish, Severity.INFO, "mission", f"fence accepted ({pluralize(len(fence.zones), 'zone')})")
    _warn_of_breach(s, publish)


def _warn_of_breach(s: AutopilotState, publish: Publish) -> None:
    """Report a mission that leaves the plan's fence, which denies AUTO, or the vehicle's, which does not."""
    breach = s.mission_breach = fence_border.mission_breach(s.fence, s.mission)
    if breach:
        breach = f"{breach}: AUTO will be denied"
    else:
        breach = fence_border.mission_breach(fence_border.vehicle_fence(s.gains.modes), s.mission)
    if breach:
        publish_event(s, publish, Severity.WARNING, "mission", breach)


def _set_rally(s: AutopilotState, publish: Publish, command: Command) -> None:
    rally: Rally = command.payload
    refusal = check_rally(rally)
    if refusal:
        raise Refused("mission", f"rally points rejected: {refusal}")
    s.rally = rally
    publish_event(s, publish, Severity.INFO, "mission", f"rally accepted ({pluralize(len(rally), 'point')})")


def _loiter_at(s: AutopilotState, publish: Publish, command: Command) -> None:
    item: MissionItem = command.payload
    refusal = check_item(item) or modes.mode_refusal(s.gains.modes, s.modes, Mode.LOITER, conditions(s))
    refusal = refusal or _place_refusal(s, item)
    if refusal:
        raise Refused("navigation", f"loiter denied: {refusal}")
    s.modes, notices = modes.set_mode(s.gains.modes, s.modes, Mode.LOITER, conditions(s))
    s.navigation = navigation.loiter_at(s.gains.navigation, s.navigation, item, surroundings(s))
    publish_notices(s, publish, notices)
    text = f"loiter at {item.north:.0f} m N, {item.east:.0f} m E, {item.altitude:.0f} m"
    publish_event(s, publish, Severity.INFO, "navigation", text)


def _place_refusal(s: AutopilotState, item: MissionItem) -> str:
    """Return why a position is denied as a target; empty if accepted."""
    if not position_usable(s):
        return "no GPS position"
    return fence_border.target_refusal(s.gains.modes, s.fence, (item.north, item.east), item.altitude)


def _set_setpoint(s: AutopilotState, publish: Publish, command: Command) -> None:
    """Set a setpoint for OFFBOARD.

    In another mode the setpoint is a condition to enter OFFBOARD.
    """
    new: Setpoint = command.payload
    refusal = _setpoint_refusal(s, new)
    if refusal:
        raise Refused("offboard", f"setpoint rejected: {refusal}")
    flown = s.modes.mode == Mode.OFFBOARD
    last = s.offboard.setpoint if flown else None
    resolved = offboard.resolve(s.gains.navigation, last, new, surroundings(s))
    s.offboard = Received(resolved, max(s.clock.time_us, 0))
    if flown and resolved.altitude is None and last is not None and last.altitude is not None:
        # The ramp begins at the present altitude, which may differ much from the previous setpoint.
        s.navigation = s.navigation._replace(altitude=s.altitude.altitude)


def _setpoint_refusal(s: AutopilotState, new: Setpoint) -> str:
    if not all(math.isfinite(value) for value in new if value is not None):
        return "a value is not a number"
    if new.path == Path.CIRCLE_AT:
        altitude = s.altitude.altitude if new.altitude is None else new.altitude
        item = MissionItem(ItemKind.LOITER, new.north, new.east, max(altitude, 1.0), radius=new.radius)
        return check_item(item) or _place_refusal(s, item)
    return "" if new.altitude is None else _altitude_refusal(s, new.altitude)


def _altitude_refusal(s: AutopilotState, altitude: float) -> str:
    item = MissionItem(ItemKind.LOITER, altitude=altitude)
    return check_item(item) or fence_border.altitude_refusal(s.gains.modes, s.fence, altitude)


def _change_altitude(s: AutopilotState, publish: Publish, command: Command) -> None:
    """Change the altitude of LOITER or OFFBOARD."""
    refusal = _altitude_refusal(s, command.value)
    circling = s.modes.mode in (Mode.LOITER, Mode.OFFBOARD)
    if not refusal and command.name == Mode.LOITER.name and not circling:
        refusal = modes.mode_refusal(s.gains.modes, s.modes, Mode.LOITER, conditions(s))
    elif not refusal and not (circling and s.modes.stage in modes.AIRBORNE):
        refusal = "the mode is neither LOITER nor OFFBOARD" if not circling else "not in flight"
    if refusal:
        raise Refused("navigation", f"altitude change denied: {refusal}")
    if not circling:
        s.modes, notices = modes.set_mode(s.gains.modes, s.modes, Mode.LOITER, conditions(s))
        publish_notices(s, publish, notices)
    if s.modes.mode == Mode.OFFBOARD and s.offboard.setpoint is not None:
        s.offboard = s.offboard._replace(setpoint=s.offboard.setpoint._replace(altitude=command.value))
    s.navigation = navigation.change_altitude(s.gains.navigation, s.navigation, command.value, surroundings(s))
    publish_event(s, publish, Severity.INFO, "navigation", f"altitude setpoint {command.value:.0f} m")


def _change_speed(s: AutopilotState, publish: Publish, command: Command) -> None:
    """Change the airspeed (m/s; 0 for the default of the vehicle).

    The setpoint is valid until the mode changes or the mission changes it.
    """
    speed, refusal = command.value, ""
    if not s.gains.altitude.speed_max:
        refusal = "the vehicle has no range of airspeed"
    elif not 0.0 <= speed < math.inf:
        refusal = "the airspeed must be a positive number"
    elif s.modes.stage not in modes.AIRBORNE:
        refusal = "not in flight"
    elif s.modes.mode not in (Mode.AUTO, Mode.LOITER, Mode.OFFBOARD):
        refusal = "the mode is none of AUTO, LOITER, OFFBOARD"
    if refusal:
        raise Refused("navigation", f"airspeed change denied: {refusal}")
    s.navigation = navigation.change_airspeed(s.gains.navigation, s.navigation, speed, surroundings(s))
    text = altitude_loop.airspeed_text(s.gains.altitude, speed)
    publish_event(s, publish, Severity.INFO, "navigation", text)


def _set_current_item(s: AutopilotState, publish: Publish, command: Command) -> None:
    number = command.value
    if number != number or not 0 <= number < len(s.mission):
        text = f"item {number:g} denied: the mission has items 0 to {len(s.mission) - 1}"
        raise Refused("mission", text)
    s.navigation = navigation.choose_item(s.navigation, int(number))
    publish_event(s, publish, Severity.INFO, "mission", f"item {int(number)} selected")


def _excite(s: AutopilotState, publish: Publish, command: Command) -> None:
    refusal = _excitation_refusal(s, command.payload)
    if refusal:
        raise Refused("excitation", f"excitation denied: {refusal}")
    s.navigation = navigation.excite(s.navigation, command.payload, surroundings(s))
    publish_event(s, publish, Severity.INFO, "excitation", f"excitation requested ({channel_names(command.payload)})")


def _excitation_refusal(s: AutopilotState, requested: Any) -> str:
    if s.modes.mode not in (Mode.AUTO, Mode.ALTITUDE_HOLD):
        return "mode must be AUTO or ALTITUDE_HOLD"
    if s.modes.stage != Stage.EN_ROUTE:
        return "not en route"
    if s.excitation.phase != excitation.Phase.IDLE or s.navigation.extra is not None:
        return "another excitation is active"
    return check_excitation(requested if isinstance(requested, Excitation) else None)


def _calibrate(s: AutopilotState, publish: Publish, command: Command) -> None:
    """Begin a calibration; without a name cancel the active one."""
    if not command.name:
        if s.calibration.kind:
            publish_event(
                s, publish, Severity.NOTICE, "calibration", f"calibration {s.calibration.kind.name} canceled"
            )
        s.calibration = calibration.stop(s.calibration)
        publish(topics.CALIBRATION, calibration.status(s.calibration, command.time_us))
        return
    kind = Calibration.__members__.get(command.name, Calibration.NONE)
    flying = s.modes.stage in modes.AIRBORNE
    reason = calibration.refusal(s.calibration, kind, command.value, bool(s.modes.armed), flying)
    if not kind:
        reason = f"unknown calibration {command.name}"
    if reason:
        raise Refused("calibration", f"calibration denied: {reason}")
    s.calibration = calibration.start(s.calibration, kind, command.value)
    publish_event(s, publish, Severity.INFO, "calibration", calibration.WORDS[kind])
    publish(topics.CALIBRATION, calibration.status(s.calibration, command.time_us))


def _lose_link(s: AutopilotState, publish: Publish, command: Command) -> None:
    s.modes, notices = failsafes.set_link(s.modes, lost=True)
    publish_notices(s, publish, notices)


def _regain_link(s: AutopilotState, publish: Publish, command: Command) -> None:
    s.modes, notices = failsafes.set_link(s.modes, lost=False)
    publish_notices(s, publish, notices)


APPLY: dict[CommandKind, Callable[[AutopilotState, Publish, Command], None]] = {
    CommandKind.ARM: _arm,
    CommandKind.DISARM: _disarm,
    CommandKind.SET_MODE: _set_mode,
    CommandKind.SET_PARAMETER: _set_parameter,
    CommandKind.SET_MISSION: _set_mission,
    CommandKind.SET_CURRENT_ITEM: _set_current_item,
    CommandKind.EXCITE: _excite,
    CommandKind.CALIBRATE: _calibrate,
    CommandKind.LINK_LOST: _lose_link,
    CommandKind.LINK_REGAINED: _regain_link,
    CommandKind.KILL: _kill,
    CommandKind.SET_FENCE: _set_fence,
    CommandKind.SET_RALLY: _set_rally,
    CommandKind.LOITER_AT: _loiter_at,
    CommandKind.SET_SETPOINT: _set_setpoint,
    CommandKind.CHANGE_ALTITUDE: _change_altitude,
    CommandKind.CHANGE_SPEED: _change_speed,
}
