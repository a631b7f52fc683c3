"""Inputs of a recorded flight, tick by tick."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any, NamedTuple

from avionics import snapshot, topics
from avionics.guidance.mission import ItemKind, Mission, MissionItem
from avionics.inputs import decode_command
from avionics.messages import Input, PilotInput, PilotSource, SensorFrame
from avionics.sensors import SENSORS
from avionics.vehicles import FlightVehicle
from logs.attached import flight_vehicle
from logs.names import AUTOPILOT, MISSION
from logs.reader import Log
from wingbeat.documents import parse_json
from wingbeat.errors import InputError
from wingbeat.message import Text
from wingbeat.topic import Topic

INPUTS = (topics.INPUTS, topics.PILOT, topics.OVERRIDE)


class Tick(NamedTuple):
    """Inputs of the flight computer in one tick."""

    frame: SensorFrame
    inputs: tuple[Input, ...]


class RecordedFlight(NamedTuple):
    """Flight as recorded, ready for replay."""

    vehicle: FlightVehicle
    """configuration of the flight computer at boot, parameters included"""
    mission: Mission
    """initial mission"""
    ticks: list[Tick]
    snapshots: list[Text]
    """of the whole state, in order of time, each taken at the end of the tick at its time"""
    from_boot: bool = True
    """whether the first tick is the first since boot; if not, there is a snapshot"""

    @property
    def late(self) -> str:
        """Notice, one line, if the file begins in flight and can be replayed from its first snapshot only; else
        empty.
        """
        if self.from_boot:
            return ""
        first = self.snapshots[0].time_us * 1e-6
        return f"the file starts in flight: replayed from its first snapshot, {first:.3f} s since boot"


def recorded_flight(log: Log) -> RecordedFlight:
    """Read all inputs of a flight from a log.

    Raises:
        InputError: another autopilot flew, the log has no raw sensors or no vehicle file (it is not of a Wingbeat
            flight computer), begins in flight without a snapshot of the memory, or is damaged.
    """
    if AUTOPILOT in log.metadata:
        raise InputError(f"{log.path}: flown by {log.metadata[AUTOPILOT]['autopilot']}, no Wingbeat flight to replay")
    vehicle = flight_vehicle(log)
    if vehicle is None or topics.IMU.name not in log.topics:
        raise InputError(f"{log.path} cannot be replayed: no raw sensors of a Wingbeat flight computer")
    texts = log.texts(topics.SNAPSHOTS) if topics.SNAPSHOTS.name in log.topics else []
    from_boot = _from_boot(log)
    if not (from_boot or texts):
        raise InputError(f"{log.path} cannot be replayed alone: it starts in flight and has no snapshot")
    return RecordedFlight(vehicle, recorded_mission(log), list(_ticks(log)), texts, from_boot)


def _from_boot(log: Log) -> bool:
    """Return whether the first tick is recorded; rejected frames are recorded but not counted."""
    if topics.HEALTH.name not in log.topics:
        return True
    counted = log.columns(topics.HEALTH)
    if not len(counted.time):
        return True
    frames = log.columns(topics.IMU)["time_us"] <= counted["time_us"][0]
    return int(frames.sum()) >= int(counted["ticks"][0])


def recorded_mission(log: Log) -> Mission:
    """Return the initial mission of a flight; empty if the log contains none.

    Raises:
        InputError: the document is damaged or of another version.
    """
    if all(attachment.name != MISSION for attachment in log.attachments):
        return ()
    try:
        items = parse_json(log.attachment(MISSION).decode())
        return tuple(_item(item) for item in items)
    except (ValueError, KeyError, TypeError, AttributeError):
        raise InputError(f"{log.path}: the mission it began with cannot be read") from None


def _item(document: dict[str, Any]) -> MissionItem:
    document = document | {"kind": int(ItemKind[document["kind"]])}
    # A recording of an earlier version has fewer fields, and the builder fills in the defaults of those at the end.
    known = [document[name] for name in MissionItem._fields if name in document]
    item: MissionItem = snapshot.builder(MissionItem)(known)
    return item


def _ticks(log: Log) -> Iterator[Tick]:
    """Return the ticks in the order in which their messages were written: inputs, IMU, other samples.

    If a file begins within a tick, the messages of that tick are omitted.
    """
    present = [topic for topic in (*(sensor.topic for sensor in SENSORS), *INPUTS) if topic.name in log.topics]
    kinds, rows = log.order(present)
    messages = [_messages(log, topic) for topic in present]
    inputs: list[Input] = []
    taken: tuple[Input, ...] = ()
    samples: dict[str, Any] = {}
    for kind, row in zip(kinds.tolist(), rows.tolist(), strict=True):
        topic, message = present[kind], messages[kind][row]
        if topic in INPUTS:
            if message is not None:
                inputs.append(message)
            continue
        if topic is topics.IMU:
            if topics.IMU.name in samples:
                yield _tick(samples, taken)
            samples, taken, inputs = {}, tuple(inputs), []
        samples[topic.name] = message
    if topics.IMU.name in samples:
        yield _tick(samples, taken)


def _tick(samples: dict[str, Any], inputs: tuple[Input, ...]) -> Tick:
    read: dict[str, Any] = {sensor.field: samples.get(sensor.topic.name) for sensor in SENSORS}
    return Tick(SensorFrame(samples[topics.IMU.name].time_us, **read), inputs)


def _messages(log: Log, topic: Topic[Any]) -> list[Any]:
    """Messages of a topic as the flight computer takes them; None for sticks that follow from logged channels."""
    if topic is topics.INPUTS:
        return [decode_command(text.text) for text in log.texts(topic)]
    columns = log.columns(topic)
    names = topic.message._fields
    missing = [name for name in names if name not in columns]
    if missing:
        raise InputError(f"{log.path}: {topic.name} is of another version: it has no {', '.join(missing)}")
    values = [[tuple(v) for v in columns[n].tolist()] if columns[n].ndim == 2 else columns[n].tolist() for n in names]
    found = [topic.message(*row) for row in zip(*values, strict=True)]
    if topic is topics.PILOT:
        return [_sticks(one) for one in found]
    return found


def _sticks(sticks: PilotInput) -> PilotInput | None:
    if sticks.source != PilotSource.MANUAL_CONTROL:
        return None
    return sticks._replace(source=PilotSource.MANUAL_CONTROL)
