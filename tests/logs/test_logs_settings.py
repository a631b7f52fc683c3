"""Parameters and missions of a flight, as it began and as they changed."""

from __future__ import annotations

import json
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import pytest

from avionics import parameters, snapshot
from avionics.autopilot import Autopilot
from avionics.calibration.procedure import Setting, applied
from avionics.guidance.mission import Channel as Excited
from avionics.guidance.mission import Excitation, ItemKind, MissionItem, Shape
from avionics.inputs import encode_command
from avionics.messages import Command, CommandKind, ImuSample, SensorFrame
from avionics.topics import EVENTS, INPUTS, SNAPSHOTS
from avionics.vehicles import load_vehicle
from logs.names import MISSION, PARAMETERS
from logs.reader import Log, open_log
from logs.recorder import McapRecorder
from logs.recording_notes import note_inputs
from logs.settings import Change, mission_document
from wingbeat.errors import InputError
from wingbeat.message import Event, Severity, Text
from wingbeat.topic import Topic

RAVEN = load_vehicle("robo_raven_ii_d")
TABLE = parameters.parameter_table(RAVEN.gains)
CLIMB = (MissionItem(ItemKind.TAKEOFF, altitude=20.0), MissionItem(ItemKind.HOLD, altitude=20.0, duration=10.0))
INPUT = Excitation(Excited.ELEVATOR, Shape.DOUBLET, 0.1, 0.5, 2.0, 3)


def simulate(path: Path, commands: Sequence[Command], ticks: int = 200) -> tuple[Log, Autopilot]:
    """What the flight computer recorded on the bench while it got ``commands``, each at its time."""
    with McapRecorder(path, start_epoch_ns=10**18) as recorder:
        autopilot = Autopilot(RAVEN, CLIMB, recorder.record)
        note_inputs(recorder, RAVEN, CLIMB)
        for tick in range(1, ticks):
            time_us = tick * 5000
            frame = SensorFrame(time_us, ImuSample(time_us, 0.0, 0.0, -9.81, 0.0, 0.0, 0.0, 0.2, 0.0, 0.4))
            due = [command for command in commands if command.time_us == time_us]
            autopilot.step(frame, due)
    return open_log(path), autopilot


def setting(time_us: int, name: str, value: float, source: str = "udpin") -> Command:
    return Command(time_us, CommandKind.SET_PARAMETER, name, value, None, source)


def test_parameters_are_those_at_boot_and_what_was_taken(tmp_path: Path) -> None:
    """GIVEN one that is taken, one out of range, one unknown THEN the log's last ones are the flight computer's."""
    high = TABLE["PITCH_P"].high
    commands = [
        setting(100_000, "PITCH_P", 0.123456789),
        setting(100_000, "ROLL_P", 0.25),
        setting(200_000, "PITCH_P", high * 3.0, "pilot"),
        setting(300_000, "NO_SUCH", 1.0),
        setting(300_000, "ROLL_P", float("nan")),
    ]
    log, autopilot = simulate(tmp_path / "a.mcap", commands)
    found = log.parameters
    assert found.initial == {name: parameters.get(RAVEN.gains, each) for name, each in TABLE.items()}
    assert found.changes == (
        Change(pytest.approx(0.1), "PITCH_P", parameters.single(0.123456789), "udpin"),
        Change(pytest.approx(0.1), "ROLL_P", 0.25, "udpin"),
        Change(pytest.approx(0.2), "PITCH_P", high, "pilot"),
    )
    assert found.at(0.05) == found.initial and found.at(0.15)["PITCH_P"] == parameters.single(0.123456789)
    now = autopilot.memory.gains
    assert found.at(10.0) == {name: parameters.get(now, each) for name, each in TABLE.items()}


def test_what_a_calibration_set_shows_in_the_next_snapshot(tmp_path: Path) -> None:
    """GIVEN a calibration between two snapshots, and a parameter that was set behind it."""
    settings = (Setting("imu", "accel_offset", 0, 0.25), Setting("imu", "accel_offset", 1, -0.125))
    _, autopilot = simulate(tmp_path / "a.mcap", [])
    memory = autopilot.state
    before = snapshot_of(memory)
    memory.gains = applied(memory.gains, settings)
    memory.gains = parameters.set_value(memory.gains, TABLE, "PITCH_P", 0.5).gains
    messages = [
        (SNAPSHOTS, Text(1_000_000, before)),
        (EVENTS, Event(2_000_000, Severity.NOTICE, "calibration", "ACCELEROMETER calibrated: 0.1 m/s^2 RMS left")),
        (INPUTS, Text(3_000_000, encode_command(setting(3_000_000, "PITCH_P", 0.5)))),
        (EVENTS, Event(3_000_000, Severity.INFO, "parameters", "PITCH_P = 0.5")),
        (SNAPSHOTS, Text(11_000_000, snapshot_of(memory))),
    ]
    found = recorded(tmp_path / "b.mcap", messages).parameters
    assert found.changes == (
        Change(pytest.approx(2.0), "IMU_ACCEL_OFS_1", 0.25, "calibration"),
        Change(pytest.approx(2.0), "IMU_ACCEL_OFS_2", -0.125, "calibration"),
        Change(pytest.approx(3.0), "PITCH_P", 0.5, "udpin"),
    )
    other = [(topic, m._replace(text='{"gains":[[1]]}') if topic is SNAPSHOTS else m) for topic, m in messages]
    assert [change.source for change in recorded(tmp_path / "c.mcap", other).parameters.changes] == ["udpin"]


def snapshot_of(memory: Any) -> str:
    return snapshot.encode(memory)


def recorded(path: Path, messages: Sequence[tuple[Topic, Any]]) -> Log:
    with McapRecorder(path, start_epoch_ns=10**18) as recorder:
        note_inputs(recorder, RAVEN, CLIMB)
        for topic, message in messages:
            recorder.record(topic, message)
    return open_log(path)


def test_settings_of_recordings_without_changes_topic(tmp_path: Path) -> None:
    """GIVEN a recording before `/system/changes` THEN settings and missions come from the texts of its events."""
    mission = Command(3_000_000, CommandKind.SET_MISSION, payload=CLIMB[:1])
    commands = [setting(1_000_000, "PITCH_P", 99.0), setting(2_000_000, "ROLL_P", 0.25), mission]
    texts = [
        (1_000_000, "parameters", Severity.INFO, "PITCH_P = 10 rad/s: 99 is not in its range, 0 to 10 rad/s"),
        (2_000_000, "parameters", Severity.WARNING, "ROLL_P refused: armed"),
        (3_000_000, "mission", Severity.INFO, "mission of 1 item"),
    ]
    messages: list[tuple[Topic, Any]] = [(INPUTS, Text(each.time_us, encode_command(each))) for each in commands]
    messages += [(EVENTS, Event(time_us, severity, source, text)) for time_us, source, severity, text in texts]
    log = recorded(tmp_path / "a.mcap", messages)
    assert log.parameters.changes == (Change(pytest.approx(1.0), "PITCH_P", 10.0, "udpin"),)
    assert [mission.time for mission in log.missions] == [0.0, pytest.approx(3.0)]


def test_missions_are_the_one_at_boot_and_those_that_were_taken(tmp_path: Path) -> None:
    asked = (CLIMB[0], MissionItem(ItemKind.EXCITE, excitation=INPUT), MissionItem(ItemKind.RETURN))
    empty = (MissionItem(ItemKind.JUMP, jump_to=7),)
    commands = [
        Command(100_000, CommandKind.SET_MISSION, payload=asked, source="script"),
        Command(200_000, CommandKind.SET_MISSION, payload=empty, source="script"),
    ]
    log, autopilot = simulate(tmp_path / "a.mcap", commands)
    assert autopilot.memory.mission == asked
    first, second = log.missions
    assert (first.time, list(first.items)) == (0.0, mission_document(CLIMB))
    assert (second.time, list(second.items)) == (pytest.approx(0.1), mission_document(asked))
    assert first.items[1]["kind"] == "HOLD" and second.items[1]["excitation"] == json.loads(json.dumps(INPUT))


def test_a_log_that_tells_neither(tmp_path: Path) -> None:
    McapRecorder(tmp_path / "a.mcap").close()
    log = open_log(tmp_path / "a.mcap")
    assert (log.parameters.initial, log.parameters.changes, log.missions) == ({}, (), ())


def test_what_cannot_be_read_is_one_line(tmp_path: Path) -> None:
    with McapRecorder(tmp_path / "a.mcap") as recorder:
        recorder.note(PARAMETERS, {"PITCH_P": "fast"})
        recorder.attach(MISSION, "application/json", b"{")
    log = open_log(tmp_path / "a.mcap")
    with pytest.raises(InputError, match="PITCH_P is not a number: 'fast'"):
        log.parameters.at(0.0)
    with pytest.raises(InputError, match=r"mission\.json is not a list of mission items"):
        tuple(log.missions)
    command = Command(1, CommandKind.SET_MISSION, payload=[[1, 2]])
    texts = [
        (INPUTS, Text(1, encode_command(command))),
        (INPUTS, Text(2, '{"kind":"SOAR"}')),
        (EVENTS, Event(1, Severity.INFO, "mission", "mission of 1 item")),
    ]
    with pytest.raises(InputError, match="of another version of the flight computer"):
        tuple(recorded(tmp_path / "b.mcap", texts).missions)
