"""The recording of another autopilot's flight: read and identified as that of our own flight computer."""

from __future__ import annotations

import contextlib
import json
import socket
import threading
from pathlib import Path

import numpy as np
import pytest
from foreign_bench import RAVEN, RIG, Observed, PlanePilot, ScriptedArduPlane, ScriptedPx4, Serving, Stages
from ports import free_port
from test_foreign_command import reach

from avionics import topics
from groundstation.command.main import main
from logs.names import AUTOPILOT
from logs.reader import open_log
from sim_bridge import topics as truth_topics
from sim_bridge.bridge.foreign.outputs import Outputs
from sim_bridge.bridge.foreign.px4 import Px4Server
from sim_bridge.bridge.foreign.world import Interface
from sim_bridge.flight.world import Scenario
from sim_bridge.plant import Plant
from sim_bridge.vehicles import load_vehicle

DURATION, SHORT = 28.0, 12.0
"""s; with three maneuvers, and of a flight whose estimates are compared"""
MANEUVERS = (11.0, 17.0, 23.0)
"""s; each is a pause in the loops, a 3-2-1-1 of the elevator, and a pause"""
PAUSE, UNIT, AMPLITUDE, LENGTH = 1.0, 0.15, 0.2, 3.3
ESTIMATED = (
    topics.ATTITUDE, topics.WING, topics.AIR_DATA, topics.ALTITUDE, topics.POSITION, topics.POWER,
    topics.DRIVE_TORQUE,
)  # fmt: skip


class ExcitingPilot(PlanePilot):
    """A plane's autopilot whose mode changes to MANUAL for a 3-2-1-1, as by a script or by hand."""

    def __init__(self, altitude: float) -> None:
        super().__init__(altitude)
        self._trim = Outputs()

    def fly(self, motion: Observed) -> Outputs:
        outputs = super().fly(motion)
        since = next((motion.time - start for start in MANEUVERS if 0.0 <= motion.time - start < LENGTH), None)
        if since is None:
            self._trim = outputs
            return outputs
        units = (since - PAUSE) / UNIT
        sign = next((sign for end, sign in ((0, 0), (3, 1), (5, -1), (6, 1), (7, -1)) if units < end), 0)
        return self._trim._replace(aileron=outputs.aileron, elevator=self._trim.elevator + AMPLITUDE * sign)


@pytest.fixture(scope="module")
def recording(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return record_arduplane(tmp_path_factory.mktemp("short") / "arduplane.mcap", SHORT)


@pytest.fixture(scope="module")
def excited(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return record_arduplane(tmp_path_factory.mktemp("flight") / "arduplane.mcap", DURATION)


def record_arduplane(path: Path, duration: float) -> Path:
    """Record ``wingbeat sim --ardupilot``, flown by a scripted ArduPlane with maneuvers."""
    Plant(load_vehicle(RAVEN)).compile()
    port = free_port(socket.SOCK_DGRAM)
    words = ["sim", "--ardupilot", "--listen", f"udpin:127.0.0.1:{port}", "--log", str(path)]
    exit_codes: list[int] = []
    words += ["--duration", str(duration - 1e-4), "--vibration", "none"]  # with it the modes are not compared
    command = threading.Thread(target=lambda: exit_codes.append(main(words)), daemon=True)
    command.start()
    plane = ScriptedArduPlane(port)
    reach(plane)
    drain(plane)
    plane.fly(ExcitingPilot(15.0), duration - 1e-6)
    command.join(60.0)
    plane.close()
    assert exit_codes == [0]
    return path


def drain(plane: ScriptedArduPlane) -> None:
    """Read the answers to repeated packets, so that the next answer belongs to the next packet."""
    plane.socket.settimeout(0.2)
    with contextlib.suppress(TimeoutError):
        while plane.socket.recv(65536):
            pass
    plane.socket.settimeout(10.0)


def test_the_recording_has_estimates_beside_the_truth(recording: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """Attitude, airspeed and altitude of our sensing and estimation, on the sensors that it would have had."""
    assert main(["log", "info", str(recording), "--json"]) == 0
    summary = json.loads(capsys.readouterr().out)
    names = {topic["topic"] for topic in summary["topics"]}
    assert names >= {topic.name for topic in ESTIMATED}
    with open_log(recording) as log:
        assert (
            log.metadata[AUTOPILOT]["autopilot"] == "ArduPilot"
            and "elevator=2" in log.metadata[AUTOPILOT]["channels"]
        )
        truth, attitude, altitude = (log.columns(t) for t in (truth_topics.STATE, topics.ATTITUDE, topics.ALTITUDE))
        time = np.asarray(attitude["time_us"])
        late = time > 5e6
        quaternion = [np.asarray(truth[f"quaternion_{part}"]) for part in "wxyz"]
        w, x, y, z = quaternion
        pitch = np.interp(time, truth["time_us"], np.arcsin(2.0 * (w * y - z * x)))
        assert np.sqrt(np.mean((attitude["pitch"] - pitch)[late] ** 2)) < 0.04
        height = np.interp(altitude["time_us"], truth["time_us"], -np.asarray(truth["down"]))
        assert np.std(np.asarray(altitude["altitude"]) - height) < 0.6  # zero is the height of the launch


@pytest.mark.validate
def test_the_recording_identifies(excited: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """Torque constants and the short period are within their intervals; the maneuvers are found by the elevator.

    The inputs pitch the vehicle through 0.48 rad. Equation error, which integrates the full kinematics, holds the
    truth; output error of the linear model does not, and the disagreement is reported.
    """
    assert main(["identify", str(excited), "--json"]) == 0
    found = json.loads(capsys.readouterr().out)
    constant = next(one for one in found["torque"]["estimates"] if one["name"] == "K_tau")
    assert constant["low"] - 1e-3 < constant["truth"] < constant["high"] + 1e-3
    assert found["power"]["estimates"]
    assert found["modes"]["agree"] is False and any("linear model" in note for note in found["modes"]["notes"])
    method = next(one for one in found["modes"]["methods"] if one["method"].startswith("equation error"))
    for name in ("frequency", "damping"):
        estimate = method[name]
        assert estimate["value"] == pytest.approx(estimate["truth"], abs=3.0 * estimate["standard_error"])
    assert found["modes"]["manoeuvres"] == len(MANEUVERS)


def test_a_replay_of_another_autopilots_flight_is_refused(
    recording: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert main(["replay", str(recording)]) == 2
    assert "flown by ArduPilot, no Wingbeat flight to replay" in capsys.readouterr().err


def test_the_estimates_run_at_px4s_rate_too() -> None:
    stages = Stages(Scenario(duration=6.0, launch_time=float("inf"), rest_time=1.0), 250.0)
    url = f"tcp:127.0.0.1:{free_port(socket.SOCK_STREAM)}"
    serving = Serving(Px4Server(Interface(url, 1000.0), RIG, lambda text: None), stages)
    px4 = ScriptedPx4(serving.server.port)
    px4.greet()
    px4.fly(PlanePilot(5.0), 7.0)
    serving.result()
    log = stages.logs[0].messages
    assert set(log) >= {topic.name for topic in ESTIMATED}
    truth = {one.time_us: one for one in log[truth_topics.STATE.name]}
    errors = [one.altitude + truth[one.time_us].down for one in log[topics.ALTITUDE.name] if one.time_us in truth]
    assert len(errors) > 50 and np.std(errors) < 0.6
    assert not any(one.severity <= 3 for one in log[truth_topics.EVENTS.name])
