"""A recorded flight through the flight code again: bit for bit, from a snapshot, with another gain, damaged."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest
from replayed import later_part, record_flight

from avionics import topics
from avionics.missions import load_mission
from avionics.vehicles import load_vehicle
from groundstation.command import main, replay
from logs.names import MISSION
from logs.reader import open_log
from logs.recorder import McapRecorder
from logs.replay import comparison
from logs.replay.flight import changed, replay_flight
from logs.replay.recorded_flight import recorded_flight, recorded_mission
from wingbeat.errors import InputError


@pytest.fixture(scope="module")
def recording(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return record_flight(tmp_path_factory.mktemp("flown") / "flight.mcap")


def test_a_replay_says_the_same_in_every_bit(recording: Path) -> None:
    with open_log(recording) as log:
        done = replay_flight(log)
        assert done.ticks == len(log.columns(topics.IMU).time)
        assert [each for each in done.differences if not each.same] == []
        told = {each.topic: each.recorded for each in done.differences}
    expected = (topics.ACTUATORS, topics.ATTITUDE, topics.SNAPSHOTS, topics.EVENTS, topics.INPUTS, topics.PILOT)
    assert all(told[topic.name] > 0 for topic in expected)


def test_from_a_snapshot_too(recording: Path) -> None:
    with open_log(recording) as log:
        done = replay_flight(log, start=13.0, end=17.0)
        snapshots = log.texts(topics.SNAPSHOTS)
    assert done.start in [text.time_us * 1e-6 for text in snapshots] and 5.0 < done.start <= 13.0
    assert done.end == pytest.approx(17.0, abs=0.006)
    assert done.same and done.ticks == round((done.end - done.start) * 200.0)


def test_the_frames_are_those_that_were_flown(recording: Path) -> None:
    with open_log(recording) as log:
        flight = recorded_flight(log)
    assert [tick.frame.time_us for tick in flight.ticks[:3]] == [5000, 10000, 15000]
    kept = [tick.frame for tick in flight.ticks]
    assert sum(frame.adc is not None for frame in kept) == pytest.approx(len(kept) / 2, abs=1)
    assert sum(len(tick.inputs) for tick in flight.ticks) == len(kept) // 40 + len(kept) // 50 + 3
    assert flight.mission == load_mission("circuit")


def test_mission_of_an_earlier_version_is_read(recording: Path, tmp_path: Path) -> None:
    """GIVEN a recording whose mission has no airspeeds, which came later THEN its mission is read."""
    with open_log(recording) as log:
        items = json.loads(log.attachment(MISSION))
    assert items and all("airspeed" in item for item in items)
    for item in items:
        del item["airspeed"]
    with McapRecorder(tmp_path / "old.mcap") as recorder:
        recorder.attach(MISSION, "application/json", json.dumps(items).encode())
    with open_log(tmp_path / "old.mcap") as log:
        assert recorded_mission(log) == load_mission("circuit")


@pytest.mark.parametrize(("start", "end"), [(9.0, 5.0), (500.0, 600.0), (0.0, 0.0)])
def test_where_nothing_was_flown_nothing_is_the_same(recording: Path, start: float, end: float) -> None:
    with open_log(recording) as log, pytest.raises(InputError, match=r"no ticks from \S+ to \S+ s: the log covers"):
        replay_flight(log, None, start, end)


@pytest.mark.parametrize("name", ["pitch.proportional", "PITCH_P", "pitch_p"])
def test_a_gain_is_named_by_its_place_or_by_its_parameter(name: str) -> None:
    gains = load_vehicle("robo_raven_ii_d").gains
    assert changed(gains, {name: 0.2}).pitch == gains.pitch._replace(proportional=pytest.approx(0.2, rel=1e-6))


def test_with_another_gain_it_says_where_and_by_how_much_it_differs(recording: Path) -> None:
    with open_log(recording) as log:
        done = replay_flight(log, {"pitch.proportional": 0.2}, end=10.0)
    differing = {each.topic: each for each in done.differences if not each.same}
    sensors = {topics.IMU.name, topics.ENCODER.name, topics.GPS.name}
    assert topics.PITCH_LOOP.name in differing and not sensors & set(differing)
    pitch = differing[topics.PITCH_LOOP.name]
    assert pitch.first is not None and pitch.recorded == pitch.replayed
    assert all(field.differing > 0 and field.rms <= abs(field.largest) for field in pitch.fields)
    assert topics.ATTITUDE.name not in differing, "the sensors were as they were"


@pytest.mark.parametrize(("largest", "rounding"), [(2.0**-54, True), (1e-12, False)])
def test_a_difference_in_the_last_bits_is_told_from_one_that_means_something(largest: float, rounding: bool) -> None:
    was = np.linspace(-0.2, 0.2, 11)
    field = comparison._Field()
    field.take(was + largest * (np.arange(11) == 10), was, np.arange(11.0), np.arange(11) == 10)
    told = field.result("pitch", "rad")
    assert told.rounding is rounding and told.largest > 0.0
    assert ("in the last bits alone" in replay._difference_text(told)) is rounding


def test_another_gain_holds_from_a_snapshot_on(recording: Path) -> None:
    with open_log(recording) as log:
        done = replay_flight(log, {"pitch.proportional": 0.2}, start=13.0, end=14.0)
    assert topics.PITCH_LOOP.name in {each.topic for each in done.differences if not each.same}


@pytest.mark.parametrize(
    ("change", "reports"),
    [
        ({"pitch.nothing": 1.0}, "the flight computer has no gain 'pitch.nothing'"),
        ({"pitch.proportionl": 1.0}, r"no gain 'pitch.proportionl' \(meant 'pitch.proportional'\?\)"),
        ({"pitch.proportional": 1e9}, "out of range"),
    ],
)
def test_a_gain_that_cannot_be_is_refused(recording: Path, change: dict[str, float], reports: str) -> None:
    with open_log(recording) as log, pytest.raises(InputError, match=reports):
        replay_flight(log, change)


def test_a_log_without_raw_sensors_is_refused(tmp_path: Path) -> None:
    with McapRecorder(tmp_path / "a.mcap"):
        pass
    with open_log(tmp_path / "a.mcap") as log:
        assert recorded_mission(log) == ()
        with pytest.raises(InputError, match="no raw sensors"):
            recorded_flight(log)


LATER = [pytest.param(first, marks=pytest.mark.validate) for first in (13, 14)]


@pytest.mark.parametrize("first", [pytest.param(1, marks=pytest.mark.validate), 12, *LATER])
def test_a_later_file_of_a_recording_is_replayed_from_its_first_snapshot_on(
    recording: Path, tmp_path: Path, first: int
) -> None:
    """GIVEN a file that begins in flight, WHEN it is replayed THEN in every bit, and it says so."""
    with open_log(later_part(recording, tmp_path / "a-2.mcap", first)) as log:
        began = log.columns(topics.IMU).time[0]
        snapshots = log.texts(topics.SNAPSHOTS)
        done = replay_flight(log)
    assert done.start == snapshots[0].time_us * 1e-6 > began > 0.02
    assert done.same and done.ticks > 500
    assert "starts in flight" in done.late and f"{done.start:.3f} s" in done.late and "\n" not in done.late


def test_a_file_that_begins_in_flight_without_a_snapshot_is_refused(recording: Path, tmp_path: Path) -> None:
    path = later_part(recording, tmp_path / "a-2.mcap", 5, 14)
    with open_log(path) as log, pytest.raises(InputError, match="starts in flight and has no snapshot"):
        replay_flight(log)


def test_a_torn_log_is_replayed_up_to_where_it_ends(
    recording: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    torn = tmp_path / "torn.mcap"
    torn.write_bytes(recording.read_bytes()[: recording.stat().st_size // 2])
    with open_log(torn) as log:
        done = replay_flight(log, end=log.columns(topics.IMU).time[-1] - 0.3)
    assert done.ticks > 500 and done.same
    assert main.main(["replay", str(torn), "--end", "4"]) == 0
    told = capsys.readouterr().err
    assert told.startswith(f"wingbeat: {torn}: ") and told.count("\n") == 1
    assert told.endswith("the file was cut off before its end; readable data were replayed\n")


def test_the_command_tells_people_and_programs(recording: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert main.main(["replay", str(recording), "--end", "4"]) == 0
    reports = capsys.readouterr().out
    assert "s since boot: identical in every bit: " in reports and "starts in flight" not in reports
    assert main.main(["replay", str(recording), "--end", "9", "--set", "pitch.proportional=0.2", "--json"]) == 0
    document = json.loads(capsys.readouterr().out)
    assert not document["same"] and document["end"] == pytest.approx(9.0, abs=0.006)
    assert main.main(["replay", str(recording), "--end", "9", "--set", "pitch.proportional=0.2"]) == 0
    told = capsys.readouterr().out
    assert (
        "/stabilization/pitch" in told and "identical in every bit" in told and max(map(len, told.splitlines())) < 160
    )


@pytest.mark.validate
def test_the_command_tells_where_a_later_file_begins(
    recording: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    later = later_part(recording, tmp_path / "a-2.mcap", 12)
    assert main.main(["replay", str(later)]) == 0
    told = capsys.readouterr().out.splitlines()
    assert len([line for line in told if "starts in flight" in line]) == 1 and "in every bit" in " ".join(told)
    assert main.main(["replay", str(later), "--json"]) == 0
    document = json.loads(capsys.readouterr().out)
    assert document["same"] and "starts in flight" in document["late"]


@pytest.mark.parametrize("words", [[], ["flight.mcap", "--imu", "x"], ["flight.mcap", "--set", "pitch"]])
def test_a_wrong_command_line_is_one_line(words: list[str], capsys: pytest.CaptureFixture[str]) -> None:
    assert main.main(["replay", *words]) == 2
    err = capsys.readouterr().err
    assert err.startswith("wingbeat: ") and err.count("\n") == 1
