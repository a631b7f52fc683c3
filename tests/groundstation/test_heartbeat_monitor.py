"""A vehicle that falls silent is noticed: on a clock of our own, and on the lines of ``watch`` and ``record``."""

from __future__ import annotations

import json
from pathlib import Path

import pytest
from lossy_vehicle import LossyVehicle, on_the_air

from avionics.link.framing import Frame
from groundstation.command.main import main
from groundstation.link import heartbeat_monitor
from groundstation.link.frames import Arrival
from groundstation.link.heartbeat_monitor import HeartbeatMonitor
from groundstation.link.vehicle_state import VehicleState

Capture = pytest.CaptureFixture[str]


def frame(at: float, system: int = 1) -> Arrival:
    return Arrival(Frame(0, system, 1, b"", b""), None, at)


def listening() -> HeartbeatMonitor:
    return HeartbeatMonitor(lambda: VehicleState(system=1), 100.0)


def test_silence_is_told_after_five_seconds_then_once_a_minute() -> None:
    quiet = listening()
    told = {second: quiet.news(100.0 + second) for second in range(200)}
    assert {second: lines for second, lines in told.items() if lines} == {
        second: [f"no telemetry for {second} s"] for second in (5, 60, 120, 180)
    }


def test_who_speaks_again_is_told_and_the_silence_counted() -> None:
    quiet = listening()
    quiet.handle_frame(frame(101.0))
    assert quiet.news(105.9) == [] and quiet.silence(105.9) == 0.0
    assert quiet.news(106.0) == ["no telemetry for 5 s"] and quiet.silence(107.0) == 6.0
    quiet.handle_frame(frame(108.0, system=7))
    assert quiet.news(118.0) == []
    quiet.handle_frame(frame(119.0))
    assert quiet.news(119.0) == ["telemetry resumed after 18 s"]
    assert (quiet.news(123.0), quiet.silence(123.0)) == ([], 18.0)
    assert quiet.news(124.0) == ["no telemetry for 5 s"]


@pytest.fixture
def short(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(heartbeat_monitor, "NOTICED", 0.4)


@pytest.mark.usefixtures("short")
def test_watch_and_record_say_that_the_vehicle_is_silent(tmp_path: Path, capsys: Capture) -> None:
    # Who only answers a heartbeat a second is silent between two.
    with on_the_air(LossyVehicle()) as url:
        assert main(["gcs", url, "--no-record", "watch", "HEARTBEAT.type", "--duration", "1.3"]) == 0
        said = capsys.readouterr()
        assert "no telemetry for 0 s" in said.err and "telemetry resumed after 1 s" in said.err
        assert main(["gcs", url, "record", str(tmp_path / "a.mcap"), "--duration", "1.3"]) == 0
        said = capsys.readouterr()
        assert "no telemetry for 0 s" in said.err and ", silent for " in said.out
        assert main(["gcs", url, "record", str(tmp_path / "b.mcap"), "--duration", "1.3", "--json"]) == 0
    assert 0.4 <= json.loads(capsys.readouterr().out)["silence"] < 1.4
