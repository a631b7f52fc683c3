"""The flight summary recovers what was put into a synthetic log."""

from __future__ import annotations

import io
import math
from pathlib import Path
from typing import Any

import pytest
from rich.console import Console

from avionics import messages as m
from avionics import topics
from groundstation.views.flight_report import flight_metrics_table
from logs.reader import open_log
from logs.recorder import McapRecorder
from logs.summary import FlightSummary, summarize
from sim_bridge import topics as truth_topics
from sim_bridge.messages import TruthState
from wingbeat.topic import Topic

LAUNCH, TOUCHDOWN, NOTICED, END = 4.0, 34.0, 35.0, 36.0
HOLD = (12.0, 28.0)
CAPTURED = 15.0
ALTITUDE_ERROR = 0.5
HEADING_ERROR = math.radians(3.0)
ROLL_ERROR, PITCH_ERROR = 0.02, 0.01


def zeros(kind: Any, **values: Any) -> Any:
    return kind(**{**dict.fromkeys(kind._fields, 0), **values})


def record(path: Path, truth: bool) -> FlightSummary:
    """A straight northbound flight: up to 40 m at 10 s, holds from 12 to 28 s, down at 34 s."""
    recorder = McapRecorder(path, start_epoch_ns=0)
    for tick in range(round(END * 50)):
        time_us = tick * 20_000
        t = time_us * 1e-6
        if truth:
            recorder.record(truth_topics.STATE, true_state(time_us, t))
        for topic, message in estimates(time_us, t):
            recorder.record(topic, message)
    recorder.close()
    with open_log(path) as log:
        return summarize(log)


def altitude_at(t: float) -> float:
    if t < HOLD[0]:
        return min(max(t - LAUNCH, 0.0) * 5.0, 40.0)
    if t < CAPTURED:
        return 30.0
    if t < HOLD[1]:
        return 40.0 - ALTITUDE_ERROR
    return max(40.0 - (t - HOLD[1]) * 40.0 / (TOUCHDOWN - HOLD[1]), 0.0)


def true_state(time_us: int, t: float) -> TruthState:
    half = 0.5 * 0.1
    flying = LAUNCH <= t < TOUCHDOWN
    return zeros(
        TruthState,
        time_us=time_us,
        north=8.0 * min(max(t - LAUNCH, 0.0), TOUCHDOWN - LAUNCH),
        down=-altitude_at(t) - 1.5,
        v_north=8.0 * math.cos(HEADING_ERROR) * flying,
        v_east=-8.0 * math.sin(HEADING_ERROR) * flying,
        v_down=1.25 if t > HOLD[1] else 0.0,
        quaternion_w=math.cos(half),
        quaternion_x=math.sin(half),
        airspeed=8.0 * flying,
        on_ground=int(not flying),
    )


def estimates(time_us: int, t: float) -> list[tuple[Topic, Any]]:
    flying = LAUNCH <= t < TOUCHDOWN
    noticed = m.Stage.LANDED if t >= NOTICED else m.Stage.FLARE
    stage = m.Stage.EN_ROUTE if flying else noticed if t > LAUNCH else m.Stage.WAIT_LAUNCH
    hold = HOLD[0] <= t < HOLD[1]
    altitude = altitude_at(t)
    return [
        (topics.ATTITUDE, zeros(m.Attitude, time_us=time_us, roll=0.1 + ROLL_ERROR, pitch=-PITCH_ERROR)),
        (topics.POWER, zeros(m.PowerState, time_us=time_us, power=14.0, energy=14.0 * t)),
        (topics.WING, zeros(m.WingState, time_us=time_us, frequency=3.6 * flying, flapping=int(flying))),
        (topics.AIR_DATA, zeros(m.AirData, time_us=time_us, airspeed=7.8)),
        (topics.ALTITUDE, zeros(m.Altitude, time_us=time_us, altitude=altitude + 0.25)),
        (topics.HEADING_LOOP, zeros(m.HeadingStatus, time_us=time_us, heading=-HEADING_ERROR)),
        (
            topics.EXCITATION,
            zeros(m.ExcitationStatus, time_us=time_us, active=int(30 < t < 31), manoeuvre=1 + int(t > 30.5)),
        ),
        (
            topics.NAVIGATION,
            zeros(
                m.NavigationStatus,
                time_us=time_us,
                mode=m.Mode.AUTO,
                stage=stage,
                item=1 if hold else 2,
                altitude_setpoint=40.0,
                heading_setpoint=0.0 if hold else t,
            ),
        ),
    ]


def test_against_truth(tmp_path: Path) -> None:
    summary = record(tmp_path / "a.mcap", truth=True)
    assert summary.against_truth
    assert summary.launch == pytest.approx(LAUNCH) and summary.airtime == pytest.approx(TOUCHDOWN - LAUNCH, abs=0.03)
    assert summary.energy == pytest.approx(14.0 * (TOUCHDOWN - LAUNCH), rel=0.01)
    assert summary.power == pytest.approx(14.0) and summary.frequency == pytest.approx(3.6)
    assert summary.highest == pytest.approx(40.0) and summary.distance == pytest.approx(240.0, rel=0.01)
    assert summary.manoeuvres == 2


def test_the_hold_counts_from_its_capture(tmp_path: Path) -> None:
    hold = record(tmp_path / "a.mcap", truth=True).hold
    assert hold is not None
    assert hold.start == pytest.approx(HOLD[0], abs=0.05)
    assert hold.settling == pytest.approx(CAPTURED - HOLD[0], abs=0.05)
    assert hold.altitude_rms == pytest.approx(ALTITUDE_ERROR, abs=0.01)
    assert hold.heading_rms == pytest.approx(HEADING_ERROR, rel=1e-6)


def test_estimate_errors(tmp_path: Path) -> None:
    estimate = record(tmp_path / "a.mcap", truth=True).estimate
    assert estimate is not None
    assert estimate.roll == pytest.approx(ROLL_ERROR, rel=1e-6)
    assert estimate.pitch == pytest.approx(PITCH_ERROR, rel=1e-6)
    assert estimate.altitude == pytest.approx(0.25, abs=1e-6)
    assert estimate.airspeed == pytest.approx(0.2, abs=1e-6)


def test_touchdown(tmp_path: Path) -> None:
    touchdown = record(tmp_path / "a.mcap", truth=True).touchdown
    assert touchdown is not None
    assert touchdown.time == pytest.approx(TOUCHDOWN, abs=0.03)
    assert (touchdown.sink, touchdown.speed) == (pytest.approx(1.25), pytest.approx(8.0))
    assert touchdown.bank == pytest.approx(0.1)


@pytest.mark.parametrize("truth", [True, False])
def test_when_the_flight_computer_was_sure_of_the_landing(tmp_path: Path, truth: bool) -> None:
    summary = record(tmp_path / "a.mcap", truth)
    assert summary.landed == pytest.approx(NOTICED, abs=0.03)
    console = Console(width=160, record=True, file=io.StringIO())
    console.print(flight_metrics_table(summary))
    told = console.export_text()
    assert "landed" in told and "at 35.0 s, detected by the flight computer" in told
    assert ("at 34.0 s   sink" in told) == truth


def test_without_truth_the_estimate_is_the_measure(tmp_path: Path) -> None:
    summary = record(tmp_path / "b.mcap", truth=False)
    assert not summary.against_truth and summary.touchdown is None and summary.estimate is None
    assert summary.hold is not None
    assert summary.hold.altitude_rms == pytest.approx(ALTITUDE_ERROR - 0.25, abs=0.01)
    assert summary.hold.heading_rms == pytest.approx(HEADING_ERROR, rel=1e-6)
    assert summary.airtime == pytest.approx(NOTICED - LAUNCH, abs=0.05)


def test_a_log_of_something_else_is_summed_up_as_nothing(tmp_path: Path) -> None:
    recorder = McapRecorder(tmp_path / "c.mcap", start_epoch_ns=0)
    recorder.record(topics.GPS, zeros(m.GpsFix, time_us=1000))
    recorder.close()
    with open_log(tmp_path / "c.mcap") as log:
        summary = summarize(log)
    assert summary.airtime is None and summary.hold is None and summary.energy is None and summary.manoeuvres == 0
