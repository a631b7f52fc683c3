"""Contract of every control law of the table: bumpless, saturated, without windup, finite."""

from __future__ import annotations

import math
from collections.abc import Callable
from pathlib import Path
from typing import Any, NamedTuple

import pytest
from hypothesis import given
from hypothesis import strategies as st

from avionics import control_laws
from avionics.control_laws import LOOPS, Law
from avionics.guidance import altitude, heading
from avionics.stabilization import pitch, roll
from avionics.vehicles import load_vehicle
from wingbeat.errors import InputError

RAVEN = load_vehicle("robo_raven_ii_d")
DT = {"pitch": 0.01, "roll": 0.01, "altitude": 0.02, "heading": 0.02}
ROWS = [(loop, name) for loop, laws in LOOPS.items() for name in laws]


class Loop(NamedTuple):
    """What the contract needs to know of a loop."""

    initial: Any
    measured: Callable[[float], Any]
    """the measurement with the loop's controlled variable at this value"""
    command: Callable[[Any], float]
    """of a status"""
    limits: tuple[float, float]
    integral: Callable[[Any], float]
    """of a state"""
    integral_max: float


GAINS = RAVEN.gains
TABLE = {
    "pitch": Loop(
        pitch.initial(GAINS.pitch), lambda value: pitch.Measured(value, 0.0, 4.0, 0.0, 6.8), lambda s: s.elevator,
        (GAINS.pitch.elevator_min, GAINS.pitch.elevator_max), lambda s: s.integral, GAINS.pitch.integral_max,
    ),
    "roll": Loop(
        roll.State(), lambda value: roll.Measured(value, 0.0, 6.8), lambda s: s.roll_command, (-1.0, 1.0),
        lambda s: s.integral, GAINS.roll.integral_max,
    ),
    "altitude": Loop(
        altitude.initial(GAINS.altitude), lambda value: altitude.Measured(value, 0.0, 7.0), lambda s: s.throttle,
        (GAINS.altitude.throttle_min, GAINS.altitude.throttle_max), lambda s: s.integral, GAINS.altitude.integral_max,
    ),
    "heading": Loop(
        heading.State(), lambda value: heading.Measured(value, 0.0, 0.0, 0), lambda s: s.roll_setpoint,
        (-GAINS.heading.roll_max, GAINS.heading.roll_max), lambda s: s.integral, GAINS.heading.integral_max,
    ),
}  # fmt: skip


def run(loop: str, law: Law[Any, Any, Any], state: Any, setpoint: float, value: float, steps: int) -> tuple[Any, Any]:
    """State and status after constant input."""
    status = None
    for i in range(steps):
        state, status = law.step(
            getattr(GAINS, loop), state, i * 10_000, DT[loop], setpoint, TABLE[loop].measured(value)
        )
    return state, status


@pytest.mark.parametrize(("loop", "name"), ROWS)
@given(setpoint=st.floats(-1e3, 1e3), value=st.floats(-1e3, 1e3))
def test_command_is_finite_and_within_its_limits(loop: str, name: str, setpoint: float, value: float) -> None:
    row = TABLE[loop]
    _, status = run(loop, LOOPS[loop][name], row.initial, setpoint, value, 20)
    low, high = row.limits
    assert low <= row.command(status) <= high
    assert all(math.isfinite(number) for number in status)


@pytest.mark.parametrize(("loop", "name"), ROWS)
@pytest.mark.parametrize("side", [pytest.param(-1.0, marks=pytest.mark.validate), 1.0])
def test_integrator_does_not_wind_up(loop: str, name: str, side: float) -> None:
    """GIVEN ten minutes of a large error WHEN its sign changes THEN the command leaves its limit in two seconds."""
    row, law = TABLE[loop], LOOPS[loop][name]
    state, status = run(loop, law, row.initial, side * 1.5, 0.0, round(600.0 / DT[loop]))
    assert abs(row.integral(state)) <= row.integral_max
    saturated = row.command(status)
    _, status = run(loop, law, state, -side * 1.5, 0.0, round(2.0 / DT[loop]))
    assert side * (saturated - row.command(status)) > 0.05


@pytest.mark.parametrize("name", LOOPS["pitch"])
@pytest.mark.parametrize("setpoint", [-0.3, 0.1, 0.4])
def test_pitch_resumes_without_a_jump(name: str, setpoint: float) -> None:
    """GIVEN an elevator frozen for an identification input WHEN the loop resumes THEN the elevator is continuous."""
    law, gains, measured = control_laws.PITCH[name], GAINS.pitch, TABLE["pitch"].measured
    state, _ = run("pitch", law, pitch.initial(gains), 0.1, 0.05, 500)
    for i in range(100):
        state, held = law.hold_trim(gains, state, i, 0.01, setpoint, measured(0.1))
    _, resumed = law.step(gains, state, 0, 0.01, setpoint, measured(0.1))
    assert abs(resumed.elevator - held.elevator) < 0.1 * abs(gains.elevator_max)


@pytest.mark.parametrize("name", LOOPS["roll"])
def test_roll_resumes_without_a_jump(name: str) -> None:
    law, gains, measured = control_laws.ROLL[name], GAINS.roll, TABLE["roll"].measured
    state, _ = run("roll", law, roll.State(), 0.3, 0.25, 500)
    state, held = law.hold_trim(gains, state, 0, 0.4, measured(0.1))
    _, resumed = law.step(gains, state, 0, 0.01, 0.4, measured(0.1))
    assert abs(resumed.roll_command - held.roll_command) < 0.1


@pytest.mark.parametrize("name", LOOPS["altitude"])
def test_altitude_takes_over_from_the_stick_without_a_jump(name: str) -> None:
    law, gains, measured = control_laws.ALTITUDE[name], GAINS.altitude, TABLE["altitude"].measured
    direct, state = altitude.DirectCommand(0.7, 0.2), altitude.initial(gains)
    for i in range(100):
        state, before = law.follow(gains, state, i, 0.02, direct)
    _, after = law.step(gains, state, 0, 0.02, 40.0, measured(10.0))
    assert abs(after.throttle - before.throttle) <= gains.throttle_rate * 0.02 + 1e-12
    assert abs(after.pitch_setpoint - before.pitch_setpoint) <= gains.pitch_rate * 0.02 + 1e-12


@pytest.mark.parametrize("name", LOOPS["heading"])
def test_heading_takes_over_from_the_stick_without_a_jump(name: str) -> None:
    law, gains, measured = control_laws.HEADING[name], GAINS.heading, TABLE["heading"].measured
    state = heading.State()
    for i in range(100):
        state, before = law.follow(gains, state, i, 0.02, 0.4, measured(0.0))
    _, after = law.step(gains, state, 0, 0.02, -2.0, measured(0.0))
    assert abs(after.roll_setpoint - before.roll_setpoint) <= gains.roll_rate * 0.02 + 1e-12


def test_i_pd_is_a_pid_without_a_proportional_kick() -> None:
    """GIVEN a setpoint step at rest THEN the elevator steps with PID and not with I-PD, and both settle alike."""
    gains = GAINS.pitch._replace(integral_max=1.0)
    commands: dict[str, list[float]] = {}
    for name, law in control_laws.PITCH.items():
        state, commands[name], value = pitch.initial(gains), [], 0.0
        for i in range(3000):
            state, status = law.step(gains, state, i, 0.01, 0.1, pitch.Measured(value, 0.0, 0.0, 0.0, 6.8))
            value += 0.01 * (2.0 * (status.elevator - gains.elevator_trim) - value)
            commands[name].append(status.elevator - gains.elevator_trim)
    assert commands["pid"][0] == pytest.approx(gains.proportional * 0.1, rel=0.05)
    assert abs(commands["i_pd"][0]) < 0.1 * commands["pid"][0]
    assert commands["i_pd"][-1] == pytest.approx(commands["pid"][-1], abs=1e-3)
    assert commands["i_pd"][-1] == pytest.approx(0.05, abs=1e-3)


def test_a_vehicle_file_chooses_the_law(tmp_path: Path) -> None:
    def load(law: str) -> pitch.Gains:
        path = tmp_path / "mine.toml"
        path.write_text(RAVEN.file.text.replace("[pitch]\n", f'[pitch]\nlaw = "{law}"\n'), encoding="utf-8")
        return load_vehicle(path).gains.pitch

    assert load("i_pd") == GAINS.pitch._replace(law="i_pd")
    with pytest.raises(InputError, match=r'pitch.law = "i_dp" is unknown \(meant \'i_pd\'\?\); known: pid, i_pd$'):
        load("i_dp")
