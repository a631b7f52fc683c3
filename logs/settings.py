"""Parameters and missions of a recorded flight, at boot and as they changed."""

from __future__ import annotations

import json
from collections import Counter, defaultdict
from collections.abc import Iterable, Iterator, Mapping
from typing import Any, NamedTuple

from avionics import parameters, snapshot, topics
from avionics.gains import FlightGains
from avionics.guidance.mission import Mission
from avionics.messages import Command, CommandKind
from logs.log_file import LogFile
from logs.names import MISSION, PARAMETERS
from wingbeat.documents import parse_json
from wingbeat.errors import InputError
from wingbeat.message import Event, Severity

CALIBRATION = "calibration"
"""Source of a change by a calibration."""
Values = dict[str, float]
Item = dict[str, Any]


class Change(NamedTuple):
    """Change of a parameter in flight."""

    time: float
    """s; since boot"""
    name: str
    value: float
    """in the parameter's unit, valid from ``time``"""
    source: str
    """origin of the request: a link's name, "script", "pilot", or `CALIBRATION`"""


class Parameters(NamedTuple):
    """The parameters of a flight."""

    initial: Values
    """by name, at boot; empty if the log does not contain them"""
    changes: tuple[Change, ...]
    """in order of time, without denied requests"""

    def at(self, time: float) -> Values:
        """Return all parameters valid at ``time`` (s since boot)."""
        return self.initial | {change.name: change.value for change in self.changes if change.time <= time}


class ActiveMission(NamedTuple):
    """Mission that is active from a time on."""

    time: float
    """s; since boot, 0 for the mission loaded at boot"""
    items: tuple[Item, ...]
    """fields of `avionics.guidance.mission.MissionItem` by name; the kind by its name"""


def mission_document(mission: Mission) -> list[Item]:
    """Convert a mission to JSON types."""
    items = [item._asdict() | {"kind": item.kind.name} for item in mission]
    plain: list[Item] = json.loads(json.dumps(items))
    return plain


def initial_parameters(log: LogFile) -> Values:
    """Return every parameter at boot by name; empty if the log does not contain them.

    Raises:
        InputError: one is not a number.
    """
    return {name: _number(name, text) for name, text in log.metadata.get(PARAMETERS, {}).items()}


def parameters_of(log: LogFile) -> Parameters:
    """Return the parameters of a flight and their changes; see `logs.reader.Log.parameters`."""
    initial, documents = initial_parameters(log), list(_changes(log))
    if not documents:
        return _from_events(log, initial)
    changes = (
        Change(time_us * 1e-6, str(each["parameter"]), float(each["value"]), str(each["source"]))
        for time_us, each in documents
        if "parameter" in each
    )
    return Parameters(initial, tuple(sorted(changes, key=lambda change: change.time)))


def missions_of(log: LogFile) -> tuple[ActiveMission, ...]:
    """Return the missions of a flight; see `logs.reader.Log.missions`."""
    loaded = [item.data for item in log.attachments if item.name == MISSION]
    first = [ActiveMission(0.0, tuple(_items(log, loaded[0])))] if loaded else []
    documents = list(_changes(log))
    if documents:
        accepted = Counter((time_us, each["mission"]) for time_us, each in documents if "mission" in each)
    else:
        accepted = _missions_from_events(log)
    flown = []
    for command in _commands(log):
        if command.kind == CommandKind.SET_MISSION:
            key = (command.time_us, len(command.payload or ()))
            if accepted[key] > 0:
                accepted[key] -= 1
                items = tuple(mission_document(_mission(log, command.payload)))
                flown.append(ActiveMission(command.time_us * 1e-6, items))
    return (*first, *flown)


def _changes(log: LogFile) -> Iterator[tuple[int, dict[str, Any]]]:
    """Time in us and content of `avionics.topics.CHANGES`; empty for recordings before that topic."""
    if topics.CHANGES.name in log.topics:
        for text in log.texts(topics.CHANGES):
            yield text.time_us, parse_json(text.text)


def _commands(log: LogFile) -> list[Command]:
    """Commands that entered the flight, with their payloads as logged."""
    if topics.INPUTS.name not in log.topics:
        return []
    return list(_decoded(text.text for text in log.texts(topics.INPUTS)))


def _decoded(texts: Iterable[str]) -> Iterator[Command]:
    for text in texts:
        try:
            document = parse_json(text)
            yield Command(**document | {"kind": CommandKind[document["kind"]]})
        except (ValueError, KeyError, TypeError):
            continue  # a command that this version does not know changes no parameter and no mission of it


# --- recordings before the topic of changes: from the texts of events --------------------------------------

_CLIPPED = " is not in its range, "
"""in the text of a value that was limited to its range"""


def _from_events(log: LogFile, initial: Values) -> Parameters:
    events = _events(log)
    requested = list(_accepted(_commands(log), events))
    calibrated = _calibrated(log, Parameters(initial, tuple(requested)), events)
    return Parameters(initial, tuple(sorted(requested + calibrated, key=lambda change: change.time)))


def _missions_from_events(log: LogFile) -> Counter[tuple[int, int]]:
    """Time in us and number of items of every accepted mission."""
    texts = _answers(_events(log), "mission")
    return Counter(
        (time_us, int(text.split()[2]))
        for time_us, answers in texts.items()
        for text in answers
        if text.startswith("mission of ")
    )


def _events(log: LogFile) -> list[Event]:
    return log.events(topics.EVENTS) if topics.EVENTS.name in log.topics else []


def _answers(events: Iterable[Event], source: str) -> Mapping[int, list[str]]:
    """INFO texts of one module by time in us."""
    texts: dict[int, list[str]] = defaultdict(list)
    for event in events:
        if event.source == source and event.severity == Severity.INFO:
            texts[event.time_us].append(event.text)
    return texts


def _accepted(commands: Iterable[Command], events: Iterable[Event]) -> Iterator[Change]:
    """Accepted settings: the flight computer answered each in the same tick."""
    answers = _answers(events, "parameters")
    for command in commands:
        texts = answers[command.time_us]
        text = next((text for text in texts if text.startswith(f"{command.name} = ")), None)
        if command.kind == CommandKind.SET_PARAMETER and text is not None:
            texts.remove(text)
            yield Change(command.time_us * 1e-6, command.name, _limited(text, command.value), command.source)


def _limited(text: str, requested: float) -> float:
    """The accepted value: that of the answer if it was limited to its range."""
    if _CLIPPED not in text:
        return parameters.single(requested)
    return float(text.partition(" = ")[2].split()[0].rstrip(":"))


def _calibrated(log: LogFile, known: Parameters, events: Iterable[Event]) -> list[Change]:
    """Changes by calibrations, from the first snapshot after each of them."""
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
        # Earlier calibrations rank below settings since then.
        before = known.initial | {change.name: change.value for change in found} | _until(known, after.time_us)
        found += [
            Change(time_us * 1e-6, name, value, CALIBRATION)
            for name, value in values.items()
            if value != before[name]
        ]
    return found


def _until(known: Parameters, time_us: int) -> Values:
    return {change.name: change.value for change in known.changes if change.time <= time_us * 1e-6}


def _values(text: str) -> Values:
    """All parameters in a snapshot, none if this version cannot read it."""
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
        raise InputError(f"{log.path}: its {MISSION} is not a list of mission items")
    return items


def _mission(log: LogFile, payload: Any) -> Mission:
    try:
        mission: Mission = snapshot.builder(Mission)(payload)
    except (ValueError, KeyError, TypeError, IndexError):
        raise InputError(f"{log.path}: a mission in it is of another version of the flight computer") from None
    return mission
