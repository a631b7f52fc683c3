"""Joining, naming, summing up and exporting."""

from __future__ import annotations

import contextlib
import csv
import errno
import json
import os
import subprocess
import sys
import threading
from concurrent.futures import ThreadPoolExecutor
from datetime import datetime
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from mcap.reader import make_reader
from recorded import ALL_TOPICS, EPOCH_NS, FIXED_TOPICS, flight, record

from avionics import messages as m
from avionics import topics
from logs.export import csv_header, export_csv, export_npz
from logs.info import flight_summary, summary, topic_row
from logs.join import join
from logs.log_file import TopicInfo
from logs.names import JOINED, PARTS, recording_path, reserved
from logs.new_files import claim, draft, locked_name
from logs.reader import open_log
from sim_bridge import topics as truth_topics
from wingbeat.errors import InputError
from wingbeat.topic import Topic

# --- join -----------------------------------------------------------------------------------------------


def two_parts(folder: Path) -> tuple[list[Path], list[tuple[Topic, Any]]]:
    messages = flight(1.5)
    vehicle = record(folder / "avionics.part", [pair for pair in messages if pair[0].channel < 1000])
    world = record(folder / "world.part", [pair for pair in messages if pair[0].channel >= 1000])
    return [vehicle, world], messages


def test_a_joined_log_holds_everything_and_the_parts_are_gone(tmp_path: Path) -> None:
    parts, messages = two_parts(tmp_path)
    out = tmp_path / "flight.mcap"
    assert join(parts, out) == []
    assert list(tmp_path.iterdir()) == [out]
    log = open_log(out)
    assert log.complete and log.verify() == [] and len(log.attachments) == 2 and log.boot_ns == EPOCH_NS
    for topic in FIXED_TOPICS:
        times = [message.time_us for t, message in messages if t is topic]
        assert log.columns(topic)["time_us"].tolist() == times
    with out.open("rb") as file:
        reader = make_reader(file, validate_crcs=True)
        assert len(list(reader.iter_messages())) == len(messages)


def test_chunks_are_copied_as_they_are(tmp_path: Path) -> None:
    parts, _ = two_parts(tmp_path)

    def chunks(path: Path) -> set[bytes]:
        data = path.read_bytes()
        with path.open("rb") as file:
            found = make_reader(file).get_summary()
        assert found is not None
        return {data[c.chunk_start_offset : c.chunk_start_offset + c.chunk_length] for c in found.chunk_indexes}

    before = chunks(parts[0]) | chunks(parts[1])
    join(parts, tmp_path / "flight.mcap")
    assert chunks(tmp_path / "flight.mcap") == before


def test_joining_never_overwrites(tmp_path: Path) -> None:
    parts, _ = two_parts(tmp_path)
    out = tmp_path / "flight.mcap"
    out.write_bytes(b"precious")
    with pytest.raises(InputError, match="exists"):
        join(parts, out)
    assert out.read_bytes() == b"precious" and all(path.exists() for path in parts)


def test_a_channel_in_both_parts(tmp_path: Path) -> None:
    messages = flight(1.0, (topics.IMU, topics.EVENTS))
    parts = [record(tmp_path / "a", messages[:100]), record(tmp_path / "b", messages[100:])]
    join(parts, tmp_path / "c.mcap")
    log = open_log(tmp_path / "c.mcap")
    assert len(log.columns(topics.IMU).time) + len(log.events()) == len(messages)


def test_channels_that_contradict_each_other_are_bad_input(tmp_path: Path) -> None:
    other = Topic("/other", m.DriveTorque, topics.IMU.channel, 100.0)
    parts = [
        record(tmp_path / "a", flight(0.5, (topics.IMU,))),
        record(tmp_path / "b", flight(0.5, (other,))),
    ]
    with pytest.raises(InputError, match="/sensors/imu and /other"):
        join(parts, tmp_path / "c.mcap")
    assert sorted(path.name for path in tmp_path.iterdir()) == ["a", "b"]


def test_a_part_that_was_cut_off_is_joined_and_kept(tmp_path: Path) -> None:
    parts, messages = two_parts(tmp_path)
    parts[1].write_bytes(parts[1].read_bytes()[:-2000])
    (kept,) = join(parts, tmp_path / "flight.mcap")
    assert kept.path == parts[1] and kept.damage.endswith("the file was cut off before its end")
    assert parts[1].exists() and not parts[0].exists()
    log = open_log(tmp_path / "flight.mcap")
    assert summary(log)["incomplete"] == log.metadata[JOINED] == {parts[1].name: kept.damage}
    assert log.complete and len(log.columns(truth_topics.STATE).time) > 0
    assert len(log.columns(topics.IMU).time) == sum(topic is topics.IMU for topic, _ in messages)


def test_a_part_that_is_no_log_stops_the_joining(tmp_path: Path) -> None:
    parts, _ = two_parts(tmp_path)
    parts[1].write_bytes(b"")
    with pytest.raises(InputError, match=r"world\.part is empty"):
        join(parts, tmp_path / "flight.mcap")
    assert sorted(path.name for path in tmp_path.iterdir()) == ["avionics.part", "world.part"]
    with pytest.raises(InputError, match="no recordings to join"):
        join([], tmp_path / "flight.mcap")


# --- names ----------------------------------------------------------------------------------------------


def test_names_of_recordings(tmp_path: Path) -> None:
    when = datetime(2026, 11, 21, 13, 15, 0)

    def name_of(vehicle: str) -> Path:
        with reserved(vehicle, when, tmp_path) as path:
            return path

    first = name_of("robo_raven_ii_d")
    assert first == tmp_path / "robo_raven_ii_d-20261121-131500.mcap"
    first.touch()
    second = name_of("robo_raven_ii_d")
    assert second.name == "robo_raven_ii_d-20261121-131500-2.mcap"
    second.touch()
    assert name_of("robo_raven_ii_d").name == "robo_raven_ii_d-20261121-131500-3.mcap"
    assert name_of("some/where/my bird.toml").name == "my_bird-20261121-131500.mcap"
    assert name_of("../..").parent == tmp_path


@pytest.mark.parametrize("ending", PARTS)
def test_a_name_is_free_for_every_file_of_a_flight_or_it_is_not_taken(ending: str, tmp_path: Path) -> None:
    when = datetime(2026, 11, 21, 13, 15, 0)
    (tmp_path / f"bird-20261121-131500{ending}").touch()
    with reserved("bird", when, tmp_path) as path:
        assert path == tmp_path / "bird-20261121-131500-2.mcap"


def test_a_name_that_is_held_is_nobody_elses_and_leaves_no_mark(tmp_path: Path) -> None:
    when = datetime(2026, 11, 21, 13, 15, 0)
    with reserved("bird", when, tmp_path) as first, reserved("bird", when, tmp_path) as second:
        assert (first.name, second.name) == ("bird-20261121-131500.mcap", "bird-20261121-131500-2.mcap")
        with locked_name(first) as ours:
            assert not ours
        second.touch()
    with reserved("bird", when, tmp_path) as first, reserved("bird", when, tmp_path) as third:
        assert (first.name, third.name) == ("bird-20261121-131500.mcap", "bird-20261121-131500-3.mcap")
    assert list(tmp_path.iterdir()) == [tmp_path / "bird-20261121-131500-2.mcap"]


def test_a_name_whose_holder_was_killed_is_free_again(tmp_path: Path) -> None:
    path = tmp_path / "bird.mcap"
    code = (
        "import os, signal, sys\nfrom pathlib import Path\nfrom logs.new_files import locked_name\n"
        "with locked_name(Path(sys.argv[1])) as ours:\n    print(ours, flush=True)\n"
        "    os.kill(os.getpid(), signal.SIGKILL)"
    )
    done = subprocess.run([sys.executable, "-c", code, str(path)], capture_output=True, text=True, check=False)
    assert done.stdout == "True\n" and len(list(tmp_path.iterdir())) == 1, "its mark is left"
    with locked_name(path) as ours:
        assert ours
    assert not any(tmp_path.iterdir())


def test_many_that_look_for_a_name_at_once_have_one_each(tmp_path: Path) -> None:
    when, together = datetime(2026, 11, 21, 13, 15, 0), threading.Barrier(8)

    def take(_: int) -> Path:
        together.wait(20.0)
        with reserved("bird", when, tmp_path) as path:
            path.open("xb").close()
            return path

    with ThreadPoolExecutor(8) as pool:
        taken = list(pool.map(take, range(8)))
    assert len(set(taken)) == 8 and sorted(tmp_path.iterdir()) == sorted(taken)


# --- info -----------------------------------------------------------------------------------------------


def test_summary_measures_rates_and_gaps(tmp_path: Path) -> None:
    messages = [
        (topic, message)
        for topic, message in flight(2.0, (topics.IMU, topics.NAVIGATION, topics.EVENTS))
        if not (topic is topics.IMU and 1_000_000 < message.time_us <= 1_100_000)
    ]
    with open_log(record(tmp_path / "a.mcap", messages)) as log:
        found = summary(log, flight_summary(log))
    assert json.loads(json.dumps(found)) == found and found["flight"]["log_duration"] == found["duration"]
    assert (found["vehicle"], found["complete"], found["messages"]) == ("robo_raven_ii_d", True, len(messages))
    rows = {row["topic"]: row for row in found["topics"]}
    imu = rows["/sensors/imu"]
    assert imu["rate"] == pytest.approx(200.0) and imu["nominal_rate"] == 200.0
    assert (imu["gaps"], imu["longest_gap"]) == (1, pytest.approx(0.105))
    assert rows["/guidance/navigation"]["gaps"] == 0
    assert rows["/system/events"]["rate"] is None and rows["/system/events"]["messages"] == 2
    assert [event["time"] for event in found["events"]] == [1.0, 2.0]
    assert found["attachments"] == [{"name": "vehicle.toml", "media_type": "application/toml", "bytes": 15}]


def topic_info(messages: int) -> TopicInfo:
    return TopicInfo("/ulg/controls", 1, "controls", "protobuf", messages, None, None, None)


def test_messages_that_come_at_one_and_two_periods_in_turn_have_no_gaps() -> None:
    """As PX4 logs its actuator controls: jitter, and one real gap."""
    times = np.cumsum([0.0025, 0.005, 0.0025, 0.0025, 0.005] * 200 + [0.16, 0.0025, 0.005])
    row = topic_row(topic_info(len(times)), times)
    assert (row["gaps"], row["longest_gap"]) == (1, pytest.approx(0.16))
    lost = np.delete(np.arange(1000) * 0.005, np.arange(5, 995, 10))
    assert topic_row(topic_info(len(lost)), lost)["gaps"] == 99


def test_summary_of_a_log_with_one_message(tmp_path: Path) -> None:
    found = summary(open_log(record(tmp_path / "a.mcap", flight(0.005, (topics.IMU,)))))
    assert found["topics"][0]["messages"] == 1 and found["topics"][0]["rate"] is None


# --- export ---------------------------------------------------------------------------------------------


def test_csv_holds_every_digit(tmp_path: Path) -> None:
    messages = flight(0.3)
    log = open_log(record(tmp_path / "a.mcap", messages))
    paths = export_csv(log, tmp_path / "out", [topic.name for topic in FIXED_TOPICS])
    assert {path.name for path in paths} >= {"sensors_imu.csv", "truth_state.csv"}
    with (tmp_path / "out" / "attitude_ahrs.csv").open() as file:
        rows = list(csv.reader(file))
    assert rows[0][:4] == ["time [s]", "time_us [us]", "roll [rad]", "pitch [rad]"]
    recorded = [message for topic, message in messages if topic is topics.ATTITUDE]
    assert [tuple(map(float, row[1:])) for row in rows[1:]] == [tuple(map(float, message)) for message in recorded]
    assert [float(row[0]) for row in rows[1:]] == pytest.approx([1e-6 * message.time_us for message in recorded])
    assert len(csv_header(log.columns(topics.ADC))) == 121


def test_csv_of_every_topic(tmp_path: Path) -> None:
    log = open_log(record(tmp_path / "a.mcap", flight(0.3)))
    assert len(export_csv(log, tmp_path / "out")) == len(ALL_TOPICS)
    assert "event" in (tmp_path / "out" / "system_events.csv").read_text()


def test_export_never_overwrites(tmp_path: Path) -> None:
    log = open_log(record(tmp_path / "a.mcap", flight(0.1, (topics.IMU, topics.WING))))
    taken = tmp_path / "main_wing.csv"
    taken.write_text("precious")
    with pytest.raises(InputError, match="exists"):
        export_csv(log, tmp_path)
    with pytest.raises(InputError, match="exists"):
        export_npz(log, taken)
    with pytest.raises(InputError, match="no topic /x"):
        export_csv(log, tmp_path, ["/x"])
    with pytest.raises(InputError, match="cannot write"):
        export_csv(log, taken / "folder")
    assert taken.read_text() == "precious"
    assert sorted(path.name for path in tmp_path.iterdir()) == ["a.mcap", "main_wing.csv"]


def test_npz(tmp_path: Path) -> None:
    log = open_log(record(tmp_path / "a.mcap", flight(0.3)))
    with np.load(export_npz(log, tmp_path / "a.npz"), allow_pickle=False) as arrays:
        assert np.array_equal(arrays["main_wing/phase"], log.columns(topics.WING)["phase"])
        assert arrays["sensors_adc/voltage_counts"].shape == (30, 60)
        assert ["phase", "rad"] in arrays["main_wing/units"].tolist()
        assert not any(name.endswith("/text") for name in arrays)


def test_a_new_file_has_its_name_with_all_that_is_in_it_or_not_at_all(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """GIVEN a file that is made beside its place WHEN it is moved there THEN its place is never an empty file."""
    path, seen = tmp_path / "a.csv", []
    link, replace = os.link, Path.replace

    def linked(source: Path, target: Path) -> None:
        seen.append(target.exists())
        link(source, target)

    def replaced(source: Path, target: Path) -> Path:
        seen.append(target.exists())
        return replace(source, target)

    monkeypatch.setattr(os, "link", linked)
    monkeypatch.setattr(Path, "replace", replaced)
    with draft(path) as (file, name):
        file.write(b"all")
        claim(name, path)
    assert seen == [False] and path.read_bytes() == b"all"
    assert list(tmp_path.iterdir()) == [path]


@pytest.mark.parametrize("links", [True, False])
def test_the_place_of_another_is_never_taken(tmp_path: Path, monkeypatch: pytest.MonkeyPatch, links: bool) -> None:
    """On a file system without hard links too."""

    def no_links(*_: object) -> None:
        raise OSError(errno.EPERM, "Operation not permitted")

    if not links:
        monkeypatch.setattr(os, "link", no_links)
    for content in (b"first", b"second"):
        with contextlib.suppress(InputError), draft(tmp_path / "a.csv") as (file, name):
            file.write(content)
            claim(name, tmp_path / "a.csv")
    assert (tmp_path / "a.csv").read_bytes() == b"first"
    assert len(list(tmp_path.iterdir())) == 1


def test_latest_is_the_newest_flight(tmp_path: Path) -> None:
    """GIVEN recordings of different age and a part of a flight WHEN latest is named THEN it is the newest flight."""
    for age, name in enumerate(("b.mcap", "a.mcap", "c.world.mcap", "d.txt")):
        (tmp_path / name).touch()
        os.utime(tmp_path / name, (1e9 + age, 1e9 + age))
    assert recording_path("latest", tmp_path) == tmp_path / "a.mcap"
    assert recording_path("other.mcap", tmp_path) == Path("other.mcap")


def test_latest_without_recordings_is_one_line(tmp_path: Path) -> None:
    with pytest.raises(InputError, match="no recording in"):
        recording_path("latest", tmp_path)
