"""Hand-launch detection: throws of every kind are seen soon, and a bird waved about on the hand is not launched."""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import NamedTuple

import pytest
from surrogate_gains import VEHICLE

from avionics.autopilot import Autopilot
from avionics.guidance import modes, supervisor
from avionics.guidance.mission import ItemKind, MissionItem
from avionics.limits import low_pass
from avionics.messages import Mode, Stage
from avionics.state import AutopilotState
from avionics.tasks.guide import vertical_command

GAINS = VEHICLE.gains.modes
DT = 0.02
G = 9.80665
WAITING = modes.State(mode=Mode.AUTO, stage=Stage.WAIT_LAUNCH, armed=1)
ON_THE_HAND = modes.Conditions(
    forward_force=0.0, airspeed=0.0, altitude=0.0, climb_rate=0.0, roll=0.0, pitch=0.2, ground_speed=0.0,
    home_distance=0.0, fix_age=0.1, battery=1.0, settled=1, imu_fault=0, items=3, throttle_stick=0.0,
    requested_stage=Stage.CLIMB_OUT,
)  # fmt: skip
Accel = Callable[[float], float]
PITOT_LAG = 0.25
"""s; of the airspeed's filter"""


class Hand(NamedTuple):
    """What the bird is held in, and what it makes of that."""

    wind: float = 0.0
    """m/s; from ahead"""
    pitch: float = 0.2
    roll: float = 0.0
    pitot: bool = True
    tilt_error: float = 0.0
    """rad; by which the flight computer believes its pitch to be larger"""


CALM = Hand()


def launched_at(accel: Accel, seconds: float, hand: Hand = CALM) -> float | None:
    """When (s) a bird that is accelerated along its body counts as launched; None when it does not."""
    wind, pitch, roll, pitot, tilt_error = hand
    state, speed, airspeed = WAITING, 0.0, wind
    for tick in range(round(seconds / DT)):
        pushed = accel(tick * DT)
        speed += pushed * DT
        airspeed = low_pass(airspeed, max(speed + wind, 0.0), PITOT_LAG, DT)
        force = pushed + G * math.sin(pitch)
        seen = ON_THE_HAND._replace(forward_force=force, pitch=pitch + tilt_error, roll=roll)
        seen = seen._replace(airspeed=airspeed if pitot else 0.0)
        state, _ = supervisor.step(GAINS, state, DT, seen)
        if state.stage != Stage.WAIT_LAUNCH:
            return tick * DT
    return None


def throw(speed: float, duration: float = 0.3) -> Accel:
    """A push up to ``speed`` m/s, then a glide that slows down by 1 m/s^2."""
    return lambda time: speed / duration if time < duration else -1.0


@pytest.mark.parametrize("speed", [4.2, 6.0, 7.8])
@pytest.mark.parametrize("pitch", [-0.06, 0.2, 0.46])
@pytest.mark.parametrize("roll", [-0.26, 0.26])
@pytest.mark.parametrize("wind", [0.0, 4.0])
def test_a_throw_is_seen_within_half_a_second(speed: float, pitch: float, roll: float, wind: float) -> None:
    time = launched_at(throw(speed), 2.0, Hand(wind, pitch, roll))
    assert time is not None and time < (0.45 if speed >= 6.0 else 0.6)


@pytest.mark.parametrize("mode", [Mode.AUTO, Mode.ALTITUDE_HOLD])
def test_the_wings_begin_on_the_way_out_of_the_hand_and_stop_when_it_was_no_throw(mode: Mode) -> None:
    memory = Autopilot(VEHICLE, (MissionItem(ItemKind.TAKEOFF, altitude=20.0),), lambda topic, message: None).memory
    memory.modes = WAITING._replace(mode=mode)
    assert throttle_commanded(memory) == GAINS.wait_throttle
    begun, speed = None, 0.0
    for tick in range(15):
        push = throw(4.2)(tick * DT)
        speed += push * DT
        seen = ON_THE_HAND._replace(forward_force=push + G * math.sin(0.2), airspeed=speed)
        memory.modes, _ = supervisor.step(GAINS, memory.modes, DT, seen)
        if begun is None and throttle_commanded(memory) == VEHICLE.gains.altitude.throttle_max:
            begun = tick * DT
    assert begun is not None and begun < 0.2, "a tenth of a second before the hand lets go"
    assert memory.modes.stage == Stage.WAIT_LAUNCH, "not out of reach yet"
    for tick in range(100):
        braked = ON_THE_HAND._replace(forward_force=-speed / 0.1 if tick < 5 else G * math.sin(0.2))
        memory.modes, _ = supervisor.step(GAINS, memory.modes, DT, braked)
    assert memory.modes.stage == Stage.WAIT_LAUNCH, "the hand held on to it"
    assert throttle_commanded(memory) == GAINS.wait_throttle


def throttle_commanded(memory: AutopilotState) -> float | None:
    asked = vertical_command(memory)
    return None if asked is None else asked.throttle


@pytest.mark.parametrize("speed", [4.2, 6.0])
def test_a_throw_is_seen_without_a_pitot(speed: float) -> None:
    time = launched_at(throw(speed), 2.0, Hand(pitot=False))
    assert time is not None and time < 0.8


def waved(reach: float, frequency: float) -> Accel:
    """To and fro along the body by ``reach`` m to each side, ``frequency`` times a second."""
    omega = math.tau * frequency
    return lambda time: -reach * omega * omega * math.sin(omega * time) * min(time / 2.0, 1.0)


STRONGEST = 60.0
"""m/s^2; six g, more than an arm gives with a bird on it"""
WAVES = [
    (reach, frequency)
    for reach in (0.1, 0.3, 0.5, 0.55)
    for frequency in (0.4, 0.7, 1.0, 1.5, 2.0, 3.0)
    if reach * (math.tau * frequency) ** 2 <= STRONGEST
]


@pytest.mark.parametrize(("reach", "frequency"), WAVES)
@pytest.mark.parametrize("wind", [0.0, 2.0, 4.0])
@pytest.mark.parametrize("tilt_error", [-0.03, 0.0])
def test_waving_it_about_is_no_launch(reach: float, frequency: float, wind: float, tilt_error: float) -> None:
    assert launched_at(waved(reach, frequency), 12.0, Hand(wind, tilt_error=tilt_error)) is None


@pytest.mark.parametrize("pitot", [True, False])
def test_running_with_it_is_no_launch(pitot: bool) -> None:
    def steps(time: float) -> float:
        """Up to 4 m/s in two seconds, with a jolt of three g, 20 ms long, at every step."""
        stride = time % 0.35
        return (2.0 if time < 2.0 else 0.0) + (30.0 if stride < 0.02 else -30.0 if stride < 0.04 else 0.0)

    assert launched_at(steps, 6.0, Hand(1.0, pitot=pitot)) is None


def test_a_gust_on_the_hand_is_no_launch() -> None:
    assert launched_at(lambda time: 0.0, 5.0, Hand(wind=9.0)) is None


def test_a_jolt_on_the_hand_is_no_launch() -> None:
    assert launched_at(lambda time: 40.0 if time % 0.5 < 0.03 else -40.0 if time % 0.5 < 0.06 else 0.0, 10.0) is None


def test_a_bird_hanging_from_the_hand_is_not_launched() -> None:
    assert launched_at(throw(6.0), 2.0, Hand(pitch=1.4)) is None
    assert launched_at(throw(6.0), 2.0, Hand(roll=2.0)) is None


@pytest.mark.parametrize(("mode", "stage"), [(Mode.AUTO, Stage.CLIMB_OUT), (Mode.MANUAL, Stage.EN_ROUTE)])
def test_after_the_throw_the_navigation_or_the_pilot_flies(mode: Mode, stage: Stage) -> None:
    state, said = WAITING._replace(mode=mode), []
    seen = ON_THE_HAND._replace(forward_force=22.0, airspeed=6.0)
    for _ in range(30):
        state, notices = supervisor.step(GAINS, state, DT, seen)
        said += [notice.text for notice in notices]
        if "launched" in said:
            break
    assert (state.stage, said) == (stage, ["launched"])
    assert (state.push, state.push_way, state.launch_state) == (0.0, 0.0, 0)
