"""What a flight was flown with: parameters and mission, as it began and as they changed."""

from __future__ import annotations

import json
from collections import defaultdict
from collections.abc import Iterable, Iterator, Mapping
from typing import Any, NamedTuple

from avionics import parameters, snapshot, topics
from avionics.guidance.mission import Mission
from avionics.messages import Command, CommandKind
from avionics.vehicles.gains import FlightGains
from logs.log_file import LogFile
from logs.names import MISSION, PARAMETERS
from wingbeat.documents import parse_json
from wingbeat.errors import InputError
from wingbeat.message import Event, Severity

CALIBRATION = "calibration"
"""Source of a change that a calibration made."""
CLIPPED = " is not in its range, "
"""what the flight computer says of a value that it took only in part"""

Values = dict[str, float]
Item = dict[str, Any]


class Change(NamedTuple):
    """A parameter that got a value in flight."""

    time: float
    """s; since boot"""
    name: str
    value: float
    """in the parameter's unit, as it held from then on"""
    source: str
    """who asked: a link's name, "script", "pilot", or `CALIBRATION`"""


class Parameters(NamedTuple):
    """The parameters of a flight."""

    initial: Values
    """by name, at boot; empty where the log does not say"""
    changes: tuple[Change, ...]
    """in order of time; what was asked and refused is none"""

    def at(self, time: float) -> Values:
        """All parameters as they held at ``time`` (s since boot)."""
        return self.initial | {change.name: change.value for change in self.changes if change.time <= time}


class FlownMission(NamedTuple):
    """A mission that held from some time on."""

    time: float
    """s; since boot, 0 for the one that was loaded then"""
    items: tuple[Item, ...]
    """the fields of `avionics.guidance.mission.MissionItem` by name, the kind by its name"""


def mission_document(mission: Mission) -> list[Item]:
    """A mission in the types of JSON."""
    items = [item._asdict() | {"kind": item.kind.name} for item in mission]
    plain: list[Item] = json.loads(json.dumps(items))
    return plain


def initial_parameters(log: LogFile) -> Values:
    """Every parameter at boot by its name; empty where the log does not say.

    Raises:
        InputError: one is not a number.
    """
    return {name: _number(name, text) for name, text in log.metadata.get(PARAMETERS, {}).items()}


def parameters_of(log: LogFile) -> Parameters:
    """The parameters of a flight and how they changed; see `logs.reader.Log.parameters`."""
    initial = initial_parameters(log)
    events, commands = _events(log), _commands(log)
    asked = list(_taken(commands, events))
    found = _calibrated(log, Parameters(initial, tuple(asked)), events)
    return Parameters(initial, tuple(sorted(asked + found, key=lambda change: change.time)))


def missions_of(log: LogFile) -> tuple[FlownMission, ...]:
    """The missions of a flight; see `logs.reader.Log.missions`."""
    loaded = [item.data for item in log.attachments if item.name == MISSION]
    first = [FlownMission(0.0, tuple(_items(log, loaded[0])))] if loaded else []
    answers = _answers(_events(log), "mission")
    sent = [command for command in _commands(log) if command.kind == CommandKind.SET_MISSION]
    return (*first, *(
        FlownMission(command.time_us * 1e-6, tuple(mission_document(_mission(log, command.payload))))
        for command in sent
        if any(text.startswith("mission of ") for text in answers[command.time_us])
    ))  # fmt: skip


# --- commands -------------------------------------------------------------------------------------------


def _commands(log: LogFile) -> list[Command]:
    """What entered the flight, payloads as they stand in the log."""
    if topics.INPUTS.name not in log.topics:
        return []
    return list(_decoded(text.text for text in log.texts(topics.INPUTS)))


def _events(log: LogFile) -> list[Event]:
    """What the flight computer said."""
    return log.events(topics.EVENTS) if topics.EVENTS.name in log.topics else []


def _decoded(texts: Iterable[str]) -> Iterator[Command]:
    for text in texts:
        try:
            document = parse_json(text)
            yield Command(**document | {"kind": CommandKind[document["kind"]]})
        except (ValueError, KeyError, TypeError):
            continue  # a command that this version does not know changes no parameter and no mission of it


def _answers(events: Iterable[Event], source: str) -> Mapping[int, list[str]]:
    """What one module said of commands that it took, by time in us."""
    said: dict[int, list[str]] = defaultdict(list)
    for event in events:
        if event.source == source and event.severity == Severity.INFO:
            said[event.time_us].append(event.text)
    return said


def _taken(commands: Iterable[Command], events: Iterable[Event]) -> Iterator[Change]:
    """The settings that the flight computer took: it answered each in the same tick."""
    answers = _answers(events, "parameters")
    for command in commands:
        said = answers[command.time_us]
        text = next((text for text in said if text.startswith(f"{command.name} = ")), None)
        if command.kind == CommandKind.SET_PARAMETER and text is not None:
            said.remove(text)
            yield Change(command.time_us * 1e-6, command.name, _held(text, command.value), command.source)


def _held(text: str, asked: float) -> float:
    """The value that was taken, as the answer tells it where that is not the one asked for."""
    if CLIPPED not in text:
        return parameters.single(asked)
    return float(text.partition(" = ")[2].split()[0].rstrip(":"))


# --- calibrations ---------------------------------------------------------------------------------------


def _calibrated(log: LogFile, known: Parameters, events: Iterable[Event]) -> list[Change]:
    """What calibrations changed, as the first snapshot behind each of them shows it."""
    times = [event.time_us for event in events if event.source == CALIBRATION and " calibrated: " in event.text]
    if not times or topics.SNAPSHOTS.name not in log.topics:
        return []
    snapshots = log.texts(topics.SNAPSHOTS)
    found: list[Change] = []
    for time_us in times:
        after = next((text for text in snapshots if text.time_us > time_us), None)
        values = _values(after.text) if after is not None else {}
        if after is None or values.keys() != known.initial.keys():
            continue  # a snapshot of another version: its numbers may have changed their places
        # What was found before counts below what was asked since.
        before = known.initial | {change.name: change.value for change in found} | _asked(known, after.time_us)
        found += [
            Change(time_us * 1e-6, name, value, CALIBRATION)
            for name, value in values.items()
            if value != before[name]
        ]
    return found


def _asked(known: Parameters, until_us: int) -> Values:
    return {change.name: change.value for change in known.changes if change.time <= until_us * 1e-6}


def _values(text: str) -> Values:
    """All parameters in a snapshot, none where this version cannot read it."""
    try:
        gains = snapshot.builder(FlightGains)(parse_json(text)["gains"])
        return {name: parameters.get(gains, each) for name, each in parameters.parameter_table(gains).items()}
    except (ValueError, KeyError, TypeError, IndexError, AttributeError):
        return {}


# --- documents ------------------------------------------------------------------------------------------


def _number(name: str, text: str) -> float:
    try:
        return float(text)
    except ValueError:
        raise InputError(f"the log's parameter {name} is not a number: {text!r}") from None


def _items(log: LogFile, data: bytes) -> list[Item]:
    try:
        items = parse_json(data.decode())
    except ValueError:
        items = None
    if not isinstance(items, list) or not all(isinstance(item, dict) for item in items):
        raise InputError(f"{log.path}: its {MISSION} is no list of mission items")
    return items


def _mission(log: LogFile, payload: Any) -> Mission:
    try:
        mission: Mission = snapshot.builder(Mission)(payload)
    except (ValueError, KeyError, TypeError, IndexError):
        raise InputError(f"{log.path}: a mission in it is of another version of the flight computer") from None
    return mission
