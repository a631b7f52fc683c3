"""What enters a flight from outside: its JSON for the log, and what each command does to the state.

Within a tick sticks of MANUAL_CONTROL are taken first, then overridden channels, then the commands in their order;
a replay that merges the three logged topics by time therefore repeats the flight exactly. On the topic of the sticks
those of the other sources stand too: they follow from frames and channels, and are no inputs.
"""

from __future__ import annotations

import json
import math
from collections.abc import Callable, Sequence
from typing import Any

from avionics import parameters, piloting, snapshot, topics
from avionics.calibration import procedure as calibration
from avionics.guidance import excitation, modes, navigation
from avionics.guidance.mission import Channel, Excitation, Fence, Mission, MissionItem, Rally
from avionics.messages import (
    Calibration,
    ChannelOverride,
    Command,
    CommandKind,
    Event,
    Input,
    Mode,
    PilotInput,
    Severity,
    Stage,
    Text,
)
from avionics.missions import check_mission
from avionics.missions.excitations import check_excitation
from avionics.missions.limits import check_fence, check_item, check_rally
from avionics.sensing.pilot import Act
from avionics.situation import conditions, surroundings, unready
from avionics.state import AutopilotState
from avionics.topics import Publish

FORCED_DISARM = 21196.0
"""value of a DISARM that is meant also in flight (MAVLink's number)"""


def encode_command(command: Command) -> str:
    """JSON of a command, exact; `decode_command` is its inverse."""
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
    """The command that `encode_command` wrote."""
    document = json.loads(text)
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
}
"""what a command carries, for its JSON"""


def receive(s: AutopilotState, publish: Publish, inputs: Sequence[Input]) -> None:
    """Log and apply everything that came since the last tick."""
    if not inputs:
        return
    time_us = max(s.clock.time_us, 0)
    for entry in inputs:
        if isinstance(entry, PilotInput):
            piloting.take_sticks(s, publish, entry._replace(time_us=time_us))
    for entry in inputs:
        if isinstance(entry, ChannelOverride):
            asked = piloting.take_override(s, publish, entry._replace(time_us=time_us))
            act(s, publish, asked, "override")
    for entry in inputs:
        if isinstance(entry, Command):
            command = _plain(entry._replace(time_us=time_us))
            publish(topics.INPUTS, Text(time_us, encode_command(command)))
            APPLY[command.kind](s, publish, command)


def act(s: AutopilotState, publish: Publish, asked: Sequence[Act], source: str) -> None:
    """Do what switches ask for: it is logged with the channels it follows from, not as an input of its own."""
    for each in asked:
        APPLY[each.kind](s, publish, Command(s.clock.time_us, each.kind, each.name, source=source))


def say(s: AutopilotState, publish: Publish, severity: Severity, source: str, text: str) -> None:
    """Publish one event at the time of the tick."""
    publish(topics.EVENTS, Event(max(s.clock.time_us, 0), severity, source, text))


def tell(s: AutopilotState, publish: Publish, notices: tuple[modes.Notice, ...]) -> None:
    """Publish what the modes have to say."""
    for notice in notices:
        say(s, publish, notice.severity, "modes", notice.text)


def _plain(command: Command) -> Command:
    """An excitation may come wrapped in a mission item; a mission as a list."""
    payload = command.payload
    if isinstance(payload, MissionItem) and command.kind == CommandKind.EXCITE:
        payload = payload.excitation
    elif command.kind in (CommandKind.SET_MISSION, CommandKind.SET_RALLY):
        payload = tuple(payload or ())
    return command._replace(payload=payload)


def _arm(s: AutopilotState, publish: Publish, command: Command) -> None:
    if s.calibration.kind:
        text = f"arming refused: {s.calibration.kind.name} is being calibrated"
        say(s, publish, Severity.WARNING, "calibration", text)
        return
    landed = s.modes.stage == Stage.LANDED or s.navigation.item >= len(s.mission)
    was_armed = s.modes.armed
    s.modes, notices = modes.arm(s.gains.modes, s.modes, conditions(s)._replace(unready=unready(s)))
    if s.modes.armed and not was_armed:
        s.wing_check = s.wing_check._replace(jammed=0)
        s.tail_check = s.tail_check._replace(jammed=0)
        if landed:
            s.navigation = navigation.choose_item(s.navigation, 0)
    tell(s, publish, notices)


def _disarm(s: AutopilotState, publish: Publish, command: Command) -> None:
    s.modes, notices = modes.disarm(s.modes, command.value == FORCED_DISARM)
    tell(s, publish, notices)


def _kill(s: AutopilotState, publish: Publish, command: Command) -> None:
    by = {"receiver": "kill switch", "override": "kill switch"}.get(command.source, "flight termination")
    s.modes, notices = modes.kill(s.modes, by)
    tell(s, publish, notices)


def _set_mode(s: AutopilotState, publish: Publish, command: Command) -> None:
    name = command.name.upper()
    if name not in Mode.__members__:
        say(
            s,
            publish,
            Severity.WARNING,
            "modes",
            f"unknown mode {command.name}; known: {', '.join(Mode.__members__)}",
        )
        return
    s.modes, notices = modes.set_mode(s.gains.modes, s.modes, Mode[name], conditions(s))
    tell(s, publish, notices)


def _set_parameter(s: AutopilotState, publish: Publish, command: Command) -> None:
    change = parameters.set_value(s.gains, parameters.parameter_table(s.gains), command.name, command.value)
    s.gains = change.gains
    say(s, publish, Severity.INFO if change.accepted else Severity.WARNING, "parameters", change.text)


def _set_mission(s: AutopilotState, publish: Publish, command: Command) -> None:
    mission: Mission = command.payload
    refusal = check_mission(mission)
    if refusal:
        say(s, publish, Severity.WARNING, "mission", f"mission refused: {refusal}")
        return
    s.mission = mission
    s.navigation = navigation.choose_item(s.navigation, 0)
    say(s, publish, Severity.INFO, "mission", f"mission of {len(mission)} items")


def _set_fence(s: AutopilotState, publish: Publish, command: Command) -> None:
    fence: Fence = command.payload or Fence()
    refusal = check_fence(fence)
    if refusal:
        say(s, publish, Severity.WARNING, "mission", f"fence refused: {refusal}")
        return
    s.fence, s.fence_clearance = fence, math.inf
    say(s, publish, Severity.INFO, "mission", f"fence of {len(fence.zones)} zones")


def _set_rally(s: AutopilotState, publish: Publish, command: Command) -> None:
    rally: Rally = command.payload
    refusal = check_rally(rally)
    if refusal:
        say(s, publish, Severity.WARNING, "mission", f"rally points refused: {refusal}")
        return
    s.rally = rally
    say(s, publish, Severity.INFO, "mission", f"{len(rally)} rally points")


def _loiter_at(s: AutopilotState, publish: Publish, command: Command) -> None:
    item: MissionItem = command.payload
    refusal = check_item(item) or modes.mode_refusal(s.gains.modes, s.modes, Mode.LOITER, conditions(s))
    if not refusal and not surroundings(s).valid:
        refusal = "no GPS position"
    if refusal:
        say(s, publish, Severity.WARNING, "navigation", f"circling there refused: {refusal}")
        return
    s.modes, notices = modes.set_mode(s.gains.modes, s.modes, Mode.LOITER, conditions(s))
    s.navigation = navigation.loiter_at(s.gains.navigation, s.navigation, item, surroundings(s))
    tell(s, publish, notices)
    text = f"circling {item.north:.0f} m north, {item.east:.0f} m east at {item.altitude:.0f} m"
    say(s, publish, Severity.INFO, "navigation", text)


def _set_current_item(s: AutopilotState, publish: Publish, command: Command) -> None:
    number = command.value
    if number != number or not 0 <= number < len(s.mission):
        text = f"item {number:g} refused: the mission has items 0 to {len(s.mission) - 1}"
        say(s, publish, Severity.WARNING, "mission", text)
        return
    s.navigation = navigation.choose_item(s.navigation, int(number))
    say(s, publish, Severity.INFO, "mission", f"item {int(number)}")


def _excite(s: AutopilotState, publish: Publish, command: Command) -> None:
    refusal = _excitation_refusal(s, command.payload)
    if refusal:
        say(s, publish, Severity.WARNING, "excitation", f"excitation refused: {refusal}")
        return
    s.navigation = navigation.excite(s.navigation, command.payload, surroundings(s))
    say(s, publish, Severity.INFO, "excitation", f"excitation of {_channels(command.payload)}")


def _channels(asked: Excitation) -> str:
    used = zip(Channel, asked.amplitudes(), strict=True)
    return " and ".join(channel.name.lower() for channel, amplitude in used if amplitude)


def _excitation_refusal(s: AutopilotState, asked: Any) -> str:
    if s.modes.mode not in (Mode.AUTO, Mode.ALTITUDE_HOLD):
        return "mode must be AUTO or ALTITUDE_HOLD"
    if s.modes.stage != Stage.EN_ROUTE:
        return "not en route"
    if s.excitation.phase != excitation.Phase.IDLE or s.navigation.extra is not None:
        return "one is being flown"
    return check_excitation(asked if isinstance(asked, Excitation) else None)


def _calibrate(s: AutopilotState, publish: Publish, command: Command) -> None:
    """Begin a calibration; without a name end the one that runs."""
    if not command.name:
        if s.calibration.kind:
            say(s, publish, Severity.NOTICE, "calibration", f"{s.calibration.kind.name} cancelled as asked")
        s.calibration = calibration.stop(s.calibration)
        publish(topics.CALIBRATION, calibration.status(s.calibration, command.time_us))
        return
    kind = Calibration.__members__.get(command.name, Calibration.NONE)
    flying = s.modes.stage in modes.AIRBORNE
    reason = calibration.refusal(s.calibration, kind, command.value, bool(s.modes.armed), flying)
    if not kind:
        reason = f"unknown kind {command.name}"
    if reason:
        say(s, publish, Severity.WARNING, "calibration", f"calibration refused: {reason}")
        return
    s.calibration = calibration.start(s.calibration, kind, command.value)
    say(s, publish, Severity.INFO, "calibration", calibration.WORDS[kind])
    publish(topics.CALIBRATION, calibration.status(s.calibration, command.time_us))


def _lose_link(s: AutopilotState, publish: Publish, command: Command) -> None:
    s.modes, notices = modes.set_link(s.modes, lost=True)
    tell(s, publish, notices)


def _regain_link(s: AutopilotState, publish: Publish, command: Command) -> None:
    s.modes, notices = modes.set_link(s.modes, lost=False)
    tell(s, publish, notices)


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
}
