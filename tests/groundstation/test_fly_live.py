"""``wingbeat fly --live``: a viewer on Foxglove's protocol sees what is recorded, to the byte, while it is flown."""

from __future__ import annotations

import importlib
import json
import socket
import struct
import subprocess
import sys
import threading
import time
from pathlib import Path
from typing import Any, NamedTuple

import pytest
from foxglove_schemas_protobuf.FrameTransforms_pb2 import FrameTransforms
from mcap.reader import make_reader

from avionics import topics
from groundstation.command.live import recorded_file
from groundstation.command.main import main
from logs.live.server import ALONE, KNOWN
from logs.recorder import McapRecorder, Writing
from wingbeat.message import Event, Severity

pytest.importorskip("foxglove", reason="foxglove-sdk is not installed: pip install foxglove-sdk")
websockets = pytest.importorskip("websockets.sync.client")

Capture = pytest.CaptureFixture[str]
WANTED = ("/view/transforms", "/truth/state", "/attitude/ahrs", "/system/events")
SUBPROTOCOL = "foxglove.sdk.v1"
PATIENCE = 60.0
EPOCH_NS = 1_700_000_000_000_000_000
_DATA = struct.Struct("<BIQ")


class Observed(NamedTuple):
    """What a viewer was told and sent."""

    channels: dict[str, dict[str, Any]]
    """as advertised, by topic"""
    messages: list[tuple[str, int, bytes]]
    """topic, log time in ns, encoded"""
    clock: list[int]
    """ns since 1970; the server's time"""


def watch(url: str, observed: Observed) -> None:
    """Subscribe to `WANTED` as soon as they are there; ends with the connection."""
    with websockets.connect(url, subprotocols=[SUBPROTOCOL], max_size=None, open_timeout=PATIENCE) as viewer:
        names: dict[int, str] = {}
        try:
            for heard in viewer:
                if isinstance(heard, str):
                    _subscribe(viewer, json.loads(heard), observed, names)
                elif heard[0] == 2:
                    observed.clock.append(struct.unpack_from("<Q", heard, 1)[0])
                else:
                    _, number, log_ns = _DATA.unpack_from(heard)
                    observed.messages.append((names[number], log_ns, heard[_DATA.size :]))
        except websockets.ConnectionClosed:
            return


def _subscribe(viewer: Any, stated: dict[str, Any], observed: Observed, names: dict[int, str]) -> None:
    if stated["op"] != "advertise":
        return
    new = {channel["topic"]: channel for channel in stated["channels"]}
    observed.channels.update(new)
    asked = [new[topic]["id"] for topic in WANTED if topic in new]
    names |= {number: topic for topic in WANTED if topic in new for number in [new[topic]["id"]]}
    if asked:
        subscriptions = [{"id": number, "channelId": number} for number in asked]
        viewer.send(json.dumps({"op": "subscribe", "subscriptions": subscriptions}))


class FlightResult(NamedTuple):
    """A flight that was watched."""

    log: Path
    code: int
    out: str
    stated: list[str]
    """lines on stderr"""
    observed: Observed


@pytest.fixture(scope="module")
def recording(tmp_path_factory: pytest.TempPathFactory) -> FlightResult:
    log = tmp_path_factory.mktemp("live") / "flight.mcap"
    words = ["fly", "--live", "127.0.0.1:0", "--duration", "6", "--json", "--log", str(log)]
    flight = subprocess.Popen(
        [sys.executable, "-m", "groundstation.command.main", *words],
        cwd=log.parent,
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
    )
    assert flight.stderr is not None
    stated = [flight.stderr.readline().rstrip()]
    observed = Observed({}, [], [])
    viewer = threading.Thread(target=watch, args=(stated[0].split()[2], observed), daemon=True)
    viewer.start()
    out, rest = flight.communicate(timeout=180)
    viewer.join(PATIENCE)
    assert not viewer.is_alive()
    return FlightResult(log, flight.returncode, out, [*stated, *rest.splitlines()], observed)


@pytest.mark.validate
def test_where_to_look_is_told_once_and_the_flight_is_as_ever(recording: FlightResult) -> None:
    assert (recording.code, json.loads(recording.out)["log"]) == (0, str(recording.log))
    assert len(recording.stated) == 1, recording.stated
    (line,) = recording.stated
    assert line.startswith("live: open ws://127.0.0.1:") and line.endswith(" in Foxglove or Lichtblick")
    assert [path.name for path in recording.log.parent.iterdir()] == ["flight.mcap"]


@pytest.mark.validate
def test_every_topic_of_both_processes_is_offered_as_the_file_has_it(recording: FlightResult) -> None:
    with recording.log.open("rb") as file:
        summary = make_reader(file).get_summary()
    assert summary is not None
    offered = recording.observed.channels
    # Those that say nothing in this flight are offered too: a layout can be made before it begins.
    assert set(offered) == {topic.name for topic in KNOWN} >= {c.topic for c in summary.channels.values()}
    for channel in summary.channels.values():
        schema, stated = summary.schemas[channel.schema_id], offered[channel.topic]
        assert (stated["encoding"], stated["schemaName"]) == (channel.message_encoding, schema.name)
        assert stated["schemaEncoding"] == schema.encoding and stated["metadata"] == channel.metadata


@pytest.mark.validate
def test_a_viewer_is_sent_what_is_recorded(recording: FlightResult) -> None:
    with recording.log.open("rb") as file:
        recorded = [(c.topic, m.log_time, m.data) for _, c, m in make_reader(file).iter_messages(topics=list(WANTED))]
    observed = recording.observed.messages
    assert len(set(observed)) == len(observed) and set(observed) <= set(recorded)
    for topic in WANTED[:3]:
        ours, theirs = ([one for one in some if one[0] == topic] for some in (recorded, observed))
        # From the moment at which it had subscribed nothing is missing, to the last message of the flight.
        assert len(theirs) > 0.5 * len(ours) and theirs == ours[-len(theirs) :]
    frames = FrameTransforms.FromString(next(data for topic, _, data in observed if topic == "/view/transforms"))
    assert [frame.child_frame_id for frame in frames.transforms] == ["body", "left_wing", "right_wing", "tail"]


@pytest.mark.validate
def test_the_viewers_clock_is_the_flights(recording: FlightResult) -> None:
    times, clock = [log_ns for _, log_ns, _ in recording.observed.messages], recording.observed.clock
    assert clock == sorted(clock) and times[0] <= clock[-1] and abs(clock[-1] - max(times)) < 10**7
    assert len(set(clock)) > 10


def test_a_recording_of_another_process_is_shown_until_it_ends(tmp_path: Path) -> None:
    path, observed = tmp_path / "bench.mcap", Observed({}, [], [])
    command = [sys.executable, "-m", "groundstation.command.main", "log", "live", str(path), "--at", "127.0.0.1:0"]
    with McapRecorder(path, start_epoch_ns=EPOCH_NS) as recorder:
        shown = subprocess.Popen(command, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True)
        assert shown.stderr is not None
        viewer = threading.Thread(target=watch, args=(shown.stderr.readline().split()[2], observed), daemon=True)
        viewer.start()
        tick, until = 0, time.monotonic() + PATIENCE
        while len(observed.messages) < 100:
            assert viewer.is_alive() and time.monotonic() < until
            tick += 1
            recorder.record(topics.EVENTS, Event(tick * 50_000, Severity.INFO, "bench", f"word {tick}"))
            viewer.join(0.001)
    out, err = shown.communicate(timeout=PATIENCE)
    viewer.join(PATIENCE)
    assert (shown.returncode, out, err) == (0, "", "")
    assert observed.messages[-1][:2] == ("/system/events", EPOCH_NS + tick * 50_000_000)
    assert {topic.name for topic in ALONE} == set(observed.channels)


def test_what_nobody_records_is_not_followed(tmp_path: Path, capsys: Capture) -> None:
    path = tmp_path / "over.mcap"
    assert main(["log", "live", str(path)]) == 2
    McapRecorder(path).close()
    assert main(["log", "live", str(path)]) == 2
    gone, over = capsys.readouterr().err.splitlines()
    assert gone == f"wingbeat: cannot read {path}: No such file or directory"
    assert over == f"wingbeat: {path} is not being recorded: open the file in Foxglove or Lichtblick"


def test_a_recording_of_several_files_is_followed_in_the_one_that_grows(tmp_path: Path) -> None:
    path = tmp_path / "flight.mcap"
    with McapRecorder(path, start_epoch_ns=EPOCH_NS, writing=Writing(volume=1)) as recorder:
        for tick in range(1, 3):
            recorder.record(topics.EVENTS, Event(tick * 1_000_000, Severity.INFO, "test", "tick"))
            recorder.flush()
            assert recorder.paths[-1] == recorded_file(path)
        assert len(recorder.paths) > 2
    assert recorded_file(path) is None


def refused(words: list[str], folder: Path, capsys: Capture) -> str:
    """The one line for a flight that is not begun."""
    assert main(["fly", "--json", "--log", str(folder / "flight.mcap"), *words]) == 2
    said = capsys.readouterr()
    assert said.out == "" and len(said.err.splitlines()) == 1 and list(folder.iterdir()) == []
    return said.err.rstrip()


def test_a_port_in_use_is_told_before_anything_is_recorded(tmp_path: Path, capsys: Capture) -> None:
    with socket.socket() as taken:
        taken.bind(("127.0.0.1", 0))
        taken.listen()
        address = f"127.0.0.1:{taken.getsockname()[1]}"
        line = refused(["--live", address], tmp_path, capsys)
    assert line == f"wingbeat: no live view on {address}: Failed to bind port: Address already in use (os error 98)"


def test_a_missing_package_is_told_before_anything_is_recorded(
    tmp_path: Path, capsys: Capture, monkeypatch: pytest.MonkeyPatch
) -> None:
    def without(name: str, package: str | None = None) -> Any:
        if name == "foxglove":
            raise ImportError(name)
        return original(name, package)

    original = importlib.import_module
    monkeypatch.setattr(importlib, "import_module", without)
    assert "a live view needs foxglove-sdk, which is not installed" in refused(["--live"], tmp_path, capsys)
