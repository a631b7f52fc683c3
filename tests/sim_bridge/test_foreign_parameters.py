"""Parameter files for ArduPlane and PX4: what is in them, and that their own readers take it."""

from __future__ import annotations

import math
import re
import subprocess
from pathlib import Path

import pytest
from foreign_bench import RAVEN
from pymavlink.mavparm import MAVParmDict

from avionics.vehicles import load_vehicle
from groundstation.command.main import main
from sim_bridge.bridge.foreign import mixer
from sim_bridge.bridge.foreign.launch import Push
from sim_bridge.bridge.foreign.outputs import Channels, Outputs, Pulses
from sim_bridge.bridge.foreign.parameters import (
    LINE_LENGTH,
    Parameter,
    Performance,
    Subject,
    ardupilot_file,
    ardupilot_parameters,
    check_push,
    px4_file,
    px4_parameters,
)
from wingbeat.errors import InputError

PERFORMANCE = Performance(6.8, 9.8, 1.5, 0.28, 0.1, -0.07)
PUSH = Push(20.0, 0.3)
SUBJECT = Subject(load_vehicle(RAVEN), PERFORMANCE, Channels(), Pulses(), PUSH)


def values(parameters: list[Parameter]) -> dict[str, float]:
    return {one.name: one.value for one in parameters}


@pytest.mark.validate
@pytest.mark.parametrize("kind", ["--ardupilot", "--px4"])
def test_the_command_writes_the_trim_of_the_vehicle_and_prints_what_to_start(
    kind: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    path = tmp_path / "raven"
    words = ["sim", kind, "--launch", "throw", "--channels", "elevator=-5", "--write-parameters", str(path)]
    assert main(words) == 0
    printed = capsys.readouterr().out
    assert f"wingbeat sim {kind} --launch=throw --channels=elevator=-5\n" in printed and str(path) in printed
    text = path.read_text()
    names = ("AIRSPEED_CRUISE", "AIRSPEED_MAX", "TECS_CLMB_MAX", "TKOFF_THR_MINACC", "ROLL_LIMIT_DEG")
    if kind == "--px4":
        names = ("FW_AIRSPD_TRIM", "FW_AIRSPD_MAX", "FW_T_CLMB_MAX", "FW_LAUN_AC_THLD", "FW_R_LIM")
    found = [float(re.search(rf"{name}[ =]+(\S+)", text)[1]) for name in names]  # type: ignore[index]
    assert found == pytest.approx([6.8, 9.8, 1.5, 12.0, 28.6], abs=0.26)
    assert main(words) == 2  # an existing file is not overwritten
    assert "exists" in capsys.readouterr().err and path.read_text() == text


@pytest.mark.parametrize(
    ("words", "message"),
    [
        (["--write-parameters", "NEW"], "--write-parameters is for --px4 and --ardupilot"),
        (["--ardupilot", "--wind", "3", "--write-parameters", "NEW"], "--wind has no effect on it"),
        (["--px4", "--log", "x.mcap", "--write-parameters", "NEW"], "--log has no effect on it"),
        (["--px4", "--channels", "rudder=17", "--write-parameters", "NEW"], "PX4 has 16 outputs"),
        (["--launch", "throw"], "--launch are for --px4 and --ardupilot"),
        (["--ardupilot", "--launch", "catapult"], "invalid choice: 'catapult'"),
        (["--ardupilot", "--write-parameters", "missing/NEW"], "there is no folder"),
    ],
)
def test_options_that_cannot_be_combined_are_refused_in_one_line(
    words: list[str],
    message: str,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
) -> None:
    monkeypatch.chdir(tmp_path)
    assert main(["sim", *words]) == 2
    captured = capsys.readouterr()
    assert message in captured.err and captured.err.count("\n") == 1 and captured.out == ""
    assert not list(tmp_path.iterdir())


def test_ardupilots_readers_take_every_value(tmp_path: Path) -> None:
    """MAVProxy's reader, and SITL's: lines of fewer than 99 characters, name and value first, names of up to 16."""
    parameters = ardupilot_parameters(SUBJECT)
    path = tmp_path / "raven.parm"
    path.write_text(ardupilot_file("A long title. " * 20, parameters))
    read = MAVParmDict()
    assert read.load(str(path))
    assert dict(read) == pytest.approx(values(parameters))
    lines = path.read_text().splitlines()
    assert max(len(line) for line in lines) <= LINE_LENGTH and max(len(one.name) for one in parameters) <= 16
    assert all(line.startswith("#") or re.fullmatch(r"\w+ +\S+ +# \S.*; \S.*", line) for line in lines)


def test_a_shell_exports_px4s_parameters_for_its_start_script(tmp_path: Path) -> None:
    parameters = px4_parameters(SUBJECT)
    path = tmp_path / "raven.px4.sh"
    path.write_text(px4_file("Title", parameters))
    script = ["sh", "-euc", f". '{path}'; env | grep ^PX4_PARAM_"]
    lines = subprocess.run(script, capture_output=True, text=True, check=True).stdout.splitlines()
    read = dict(line.removeprefix("PX4_PARAM_").split("=") for line in lines)
    assert {name: float(value) for name, value in read.items()} == pytest.approx(values(parameters))
    assert all("." not in read[one.name] for one in parameters if isinstance(one.value, int))
    assert max(len(one.name) for one in parameters) <= 16


def test_outputs_follow_channels_and_pulses() -> None:
    channels = Channels(aileron=0, elevator=-7, throttle=20, rudder=4)
    subject = SUBJECT._replace(channels=channels, pulses=Pulses(1000.0, 2000.0))
    found = values(ardupilot_parameters(subject))
    assert (found["SERVO7_FUNCTION"], found["SERVO7_REVERSED"], found["SERVO7_TRIM"]) == (19, 1, 1500)
    assert (found["SERVO20_FUNCTION"], found["SERVO20_TRIM"], found["SERVO20_MAX"]) == (70, 1000, 2000)
    assert [found[f"SERVO{number}_FUNCTION"] for number in (1, 2, 3, 4)] == [0, 0, 0, 21]
    assert found["SERVO_32_ENABLE"] == 1
    found = values(px4_parameters(subject._replace(channels=channels._replace(throttle=3))))
    assert [found[f"PWM_MAIN_FUNC{number}"] for number in (1, 2, 3, 4, 7)] == [0, 0, 101, 203, 202]
    assert found["PWM_MAIN_REV"] == 1 << 6


def test_launch_detection_is_on_for_a_throw_alone_and_below_what_the_throw_gives() -> None:
    ardupilot, px4 = values(ardupilot_parameters(SUBJECT)), values(px4_parameters(SUBJECT))
    assert 9.8 < ardupilot["TKOFF_THR_MINACC"] == px4["FW_LAUN_AC_THLD"] < 0.9 * PUSH.acceleration
    assert 0.1 * ardupilot["TKOFF_THR_DELAY"] < PUSH.duration and px4["FW_LAUN_AC_T"] < PUSH.duration
    by_throttle = SUBJECT._replace(push=None)
    assert values(ardupilot_parameters(by_throttle))["TKOFF_THR_MINACC"] == 0
    assert values(px4_parameters(by_throttle))["FW_LAUN_DETCN_ON"] == 0
    with pytest.raises(InputError, match="too weak"):
        check_push(Push(10.0, 0.3))


def test_the_elevators_output_at_the_trim_is_the_inverse_of_the_mixer() -> None:
    gains = mixer.gains_of(SUBJECT.vehicle)
    for wanted in (-1.0, -0.07, 0.0, 0.4, 1.0):
        command = mixer.step(gains, mixer.State(), 0, 1.0, Outputs(elevator=wanted))[2]
        assert mixer.elevator_output(gains, command.elevator) == pytest.approx(wanted)


def test_angles_and_fractions_have_the_units_of_the_autopilot() -> None:
    gains = SUBJECT.vehicle.gains
    ardupilot, px4 = values(ardupilot_parameters(SUBJECT)), values(px4_parameters(SUBJECT))
    roll = math.degrees(gains.heading.roll_max)
    assert ardupilot["ROLL_LIMIT_DEG"] == px4["FW_R_LIM"] == pytest.approx(roll, abs=0.05)
    assert (ardupilot["TRIM_THROTTLE"], px4["FW_THR_TRIM"]) == (28, 0.28)
    assert px4["FW_PSP_OFF"] == pytest.approx(5.7, abs=0.05)
