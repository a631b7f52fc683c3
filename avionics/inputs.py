"""What enters a flight from outside: its JSON for the log, and what each command does to the state.

Within a tick the sticks are taken first, then the commands in their order; a replay that merges the two logged
topics by time therefore repeats the flight exactly.
"""

from __future__ import annotations

import json
import math
from collections.abc import Callable, Sequence
from typing import Any

from avionics import parameters, snapshot, topics
from avionics.calibration import procedure as calibration
from avionics.guidance import excitation, modes, navigation
from avionics.guidance.mission import Channel, Excitation, Mission, MissionItem
from avionics.limits import clip
from avionics.messages import Calibration, Command, CommandKind, Event, Mode, PilotInput, Severity, Stage, Text
from avionics.missions import check_mission
from avionics.missions.excitations import check_excitation
from avionics.situation import conditions, surroundings
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
    if payload is not None and kind == CommandKind.SET_MISSION:
        payload = snapshot.builder(Mission)(payload)
    elif payload is not None and kind == CommandKind.EXCITE:
        payload = snapshot.builder(Excitation)(payload)
    return Command(document["time_us"], kind, document["name"], document["value"], payload, document["source"])


def receive(s: AutopilotState, publish: Publish, inputs: Sequence[Command | PilotInput]) -> None:
    """Log and apply everything that came since the last tick."""
    time_us = max(s.clock.time_us, 0)
    for entry in inputs:
        if isinstance(entry, PilotInput):
            _take_sticks(s, publish, entry._replace(time_us=time_us))
    for entry in inputs:
        if isinstance(entry, Command):
            command = _plain(entry._replace(time_us=time_us))
            publish(topics.INPUTS, Text(time_us, encode_command(command)))
            APPLY[command.kind](s, publish, command)


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
    if isinstance(payload, MissionItem):
        payload = payload.excitation
    elif command.kind == CommandKind.SET_MISSION:
        payload = tuple(payload or ())
    return command._replace(payload=payload)


def _take_sticks(s: AutopilotState, publish: Publish, sticks: PilotInput) -> None:
    if not math.isfinite(sum(sticks[1:])):
        s.plausibility = s.plausibility._replace(rejected=s.plausibility.rejected + 1)
        return
    _, pitch, roll, yaw, throttle = sticks
    s.pilot = PilotInput(
        sticks.time_us, clip(pitch, -1.0, 1.0), clip(roll, -1.0, 1.0), clip(yaw, -1.0, 1.0), clip(throttle, 0.0, 1.0)
    )
    publish(topics.PILOT, s.pilot)


def _arm(s: AutopilotState, publish: Publish, command: Command) -> None:
    if s.calibration.kind:
        text = f"arming refused: {s.calibration.kind.name} is being calibrated"
        say(s, publish, Severity.WARNING, "calibration", text)
        return
    landed = s.modes.stage == Stage.LANDED or s.navigation.item >= len(s.mission)
    was_armed = s.modes.armed
    s.modes, notices = modes.arm(s.gains.modes, s.modes, conditions(s))
    if s.modes.armed and not was_armed and landed:
        s.navigation = navigation.choose_item(s.navigation, 0)
    tell(s, publish, notices)


def _disarm(s: AutopilotState, publish: Publish, command: Command) -> None:
    s.modes, notices = modes.disarm(s.modes, command.value == FORCED_DISARM)
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
}
