"""Attitude loops of ArduPlane and PX4: margins recomputed with python-control, values by hand, files read back."""

from __future__ import annotations

import math
from functools import cache
from pathlib import Path

import control
import numpy as np
import pytest
from pymavlink.mavparm import MAVParmDict
from tuning_bench import OMEGA, VEHICLES, S, designed, model, vehicle

from sim_bridge.bridge.foreign.parameters import LINE_LENGTH, Parameter
from sim_bridge.flight.tuning.aircraft import Aircraft
from sim_bridge.flight.tuning.autopilots import ARDUPLANE, FIRMWARE, PX4, AxisLoop, axis_process, design_axes
from sim_bridge.tuning.margins import LIMITS, response
from wingbeat.errors import InputError


@cache
def loops(name: str, key: str) -> list[AxisLoop]:
    return design_axes(FIRMWARE[key], model(name), vehicle(name))


def parameters(name: str, key: str) -> list[Parameter]:
    return FIRMWARE[key].parameters(model(name), vehicle(name).gains, designed(name), loops(name, key))


def rate_and_angle(name: str, axis: str) -> tuple[np.ndarray, np.ndarray]:
    """Response of body rate and angle to the full output, from A and B alone."""
    one, gains = model(name), vehicle(name).gains
    if axis == "pitch":
        trim, tail = gains.pitch.elevator_trim, gains.tail
        travel = max(tail.elevator_max - trim, trim - tail.elevator_min)
        a, b, rate = one.a, one.elevator, 2
    else:
        assert one.lateral is not None
        a, b, rate, travel = one.lateral.a, one.lateral.rudder, 1, gains.tail.rudder_share
    plant = control.ss(a, np.reshape(b, (4, 1)) * travel, np.eye(4), np.zeros((4, 1)))
    states = plant(S)[:, 0, :]
    return states[rate], states[3]


def open_loop(name: str, key: str, loop: AxisLoop) -> np.ndarray:
    """The loop of the firmware, cut at the surface, with exact delays."""
    rate, angle = rate_and_angle(name, loop.name)
    servo = np.exp(-S * {"ardupilot": 0.03, "px4": 0.016}[key]) / (
        1.0 + vehicle(name).airframe.tail_time_constant * S
    )
    w = 2.0 * math.pi * {"ardupilot": 20.0, "px4": 40.0}[key]
    gyro = w * w / (S * S + math.sqrt(2.0) * w * S + w * w)
    setpoint = 1.0 / (1.0 + S / (2.0 * math.pi * 3.0)) if key == "ardupilot" else 1.0
    scale = 180.0 / math.pi / 45.0 if key == "ardupilot" else 1.0
    pi = scale * (loop.proportional + loop.integral / S)
    return pi * servo * (gyro * rate + setpoint * angle / loop.time_constant)


@pytest.mark.parametrize("key", FIRMWARE)
@pytest.mark.parametrize(
    "name", [VEHICLES[0], *(pytest.param(one, marks=pytest.mark.validate) for one in VEHICLES[1:])]
)
def test_margins_agree_with_python_control(name: str, key: str) -> None:
    """GIVEN the designed gains WHEN the loop is rebuilt from A, B and delays THEN the margins agree."""
    assert [loop.name for loop in loops(name, key)] == ["pitch", "roll"]
    for loop in loops(name, key):
        found = open_loop(name, key, loop)
        gains, phases, *_ = control.stability_margins(control.frd(found, OMEGA), returnall=True)
        gain_db = min(abs(20.0 * math.log10(gain)) for gain in gains if gain > 0.0)
        phase = min(abs(angle) for angle in phases)
        assert loop.margins.gain_db == pytest.approx(gain_db, abs=0.1)
        assert math.degrees(loop.margins.phase) == pytest.approx(phase, abs=0.5)
        assert gain_db >= LIMITS.gain_margin_db and phase >= 45.0 and loop.margins.stable
        crossover = OMEGA[np.flatnonzero(np.abs(found) > 1.0)[-1]]
        assert crossover <= model(name).flapping_rate / 3.0


def test_output_of_a_rate_error_by_hand() -> None:
    """GIVEN P = 0.2 and a rate error of 0.1 rad/s
    WHEN ArduPlane computes degrees(0.1 * 0.2) = 1.146 deg of 45 and PX4 0.02 of 1
    THEN the surface moves by 0.02546 and 0.02 of its travel.
    """
    assert ARDUPLANE.output * 0.2 * 0.1 == pytest.approx(0.025465, rel=1e-4)
    assert PX4.output * 0.2 * 0.1 == pytest.approx(0.02)


def test_process_of_an_integrator_by_hand() -> None:
    """GIVEN pitch acceleration 50 times the elevator, no servo lag, travel 0.5 rad, T = 0.5 s
    WHEN PX4's loop is sampled at 2 rad/s THEN it is 25 (1/(2i) + 2/(2i)^2), but for delay and filter.
    """
    a = np.zeros((4, 4))
    a[3, 2] = 1.0
    one, bird = model("robo_raven_ii_d"), vehicle("robo_raven_ii_d")
    gains = bird.gains._replace(
        tail=bird.gains.tail._replace(elevator_min=-0.5, elevator_max=0.5),
        pitch=bird.gains.pitch._replace(elevator_trim=0.0),
    )
    plain = one._replace(a=a, elevator=np.array([0.0, 0.0, 50.0, 0.0]), drive=None)
    aircraft = Aircraft(plain, bird.airframe._replace(tail_time_constant=0.0), gains)
    exact = PX4._replace(delay=1e-6, gyro_cutoff=1e4)
    (value, _), *_ = response(axis_process(exact, aircraft, "pitch", 0.5).sensed, np.array([2.0]))[:, 0, :].T
    assert value == pytest.approx(-12.5 - 12.5j, rel=1e-3)


def test_ardupilot_file_is_read_by_pymavlink(tmp_path: Path) -> None:
    wanted = parameters("robo_raven_ii_d", "ardupilot")
    text = ARDUPLANE.file("title", wanted)
    path = tmp_path / "a.param"
    path.write_text(text)
    read = MAVParmDict()
    assert read.load(str(path), use_excludes=False)
    assert {name: read[name] for name in read} == {one.name: pytest.approx(one.value, rel=1e-3) for one in wanted}
    assert max(map(len, text.splitlines())) <= LINE_LENGTH
    gains = {gain: value for loop in loops("robo_raven_ii_d", "ardupilot") for gain, value in loop.gains.items()}
    assert set(gains) >= {"PTCH_RATE_P", "PTCH_RATE_I", "PTCH2SRV_TCONST", "RLL_RATE_P", "RLL2SRV_TCONST"}
    assert all(read[name] == pytest.approx(value) for name, value in gains.items())
    assert read["SCALING_SPEED"] == read["AIRSPEED_CRUISE"] == pytest.approx(model("robo_raven_ii_d").airspeed, 1e-2)


def test_px4_file_has_the_columns_of_qgroundcontrol() -> None:
    wanted = parameters("robo_raven_ii_d", "px4")
    lines = [line for line in PX4.file("title", wanted).splitlines() if not line.startswith("#")]
    rows = [line.split("\t") for line in lines]
    assert [row[:3] for row in rows] == [["1", "1", one.name] for one in wanted]
    assert [float(row[3]) for row in rows] == pytest.approx([one.value for one in wanted], rel=1e-3)
    kinds = {row[2]: row[4] for row in rows}
    assert kinds["FW_ARSP_SCALE_EN"] == "6" and kinds["FW_PR_P"] == "9"
    assert all(len(one.name) <= 16 for one in wanted)


def test_model_without_lateral_motion_and_drive_has_pitch_alone() -> None:
    one = model("robo_raven_ii_d")._replace(lateral=None, drive=None)
    bird = vehicle("robo_raven_ii_d")
    (loop,) = design_axes(PX4, one, bird)
    names = {entry.name for entry in PX4.parameters(one, bird.gains, designed("robo_raven_ii_d"), [loop])}
    assert "FW_PR_P" in names and not names & {"FW_RR_P", "FW_THR_TRIM"}


def test_loop_that_cannot_keep_the_margins_is_an_error() -> None:
    with pytest.raises(InputError, match="pitch: no gains give the loop of PX4 6 dB and 45 degrees"):
        design_axes(PX4._replace(delay=2.0), model("robo_raven_ii_d"), vehicle("robo_raven_ii_d"))
