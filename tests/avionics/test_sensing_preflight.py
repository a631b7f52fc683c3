"""Gyro calibration at standstill and the sensor checks before arming."""

from __future__ import annotations

import json
import math
from collections.abc import Callable
from typing import NamedTuple

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from avionics import snapshot
from avionics.messages import ImuSample
from avionics.sensing import preflight
from avionics.sensing.preflight import Finding, Gains, Means, Reference, Rest, State
from wingbeat.constants import STANDARD_GRAVITY

GAINS = Gains()
DT = 0.005
DIP = math.radians(65.0)
FIELD = 0.506
REFERENCE = Reference(FIELD, DIP)
FIELD_NED = (FIELD * math.cos(DIP), 0.0, FIELD * math.sin(DIP))
GYRO_NOISE, ACCEL_NOISE, FIELD_NOISE = math.radians(0.38), 0.05, 0.002
HELD = Rotation.from_euler("ZYX", (0.7, 0.2, -0.1))
"""r_ned_from_frd of a vehicle in the hand"""

Attitude = Callable[[float], Rotation]


class Detected(NamedTuple):
    completed: list[float]
    """s; at which a standstill was completed"""
    state: State


def at_rest(time: float) -> Rotation:
    return HELD


def turning(rate: tuple[float, float, float]) -> Attitude:
    """A steady rotation by ``rate`` (rad/s, earth axes)."""
    return lambda time: Rotation.from_rotvec(np.array(rate) * time) * HELD


def unsteady(frequency: float, amplitude: float) -> Attitude:
    """A hand that sways by 0.3 degrees and trembles by ``amplitude`` (rad/s) about two axes."""
    angle = amplitude / (2.0 * math.pi * frequency)

    def attitude(time: float) -> Rotation:
        tremor, sway = angle * math.sin(2.0 * math.pi * frequency * time), 0.005 * math.sin(0.8 * math.pi * time)
        return HELD * Rotation.from_rotvec((tremor + sway, 0.7 * tremor, 0.5 * sway))

    return attitude


def detect(
    attitude: Attitude = at_rest,
    seconds: float = 3.0,
    offset: tuple[float, float, float] = (0.0, 0.0, 0.0),
    field: bool = True,
) -> Detected:
    """Run the detector over noisy samples of a motion, with a gyro ``offset`` in rad/s."""
    random = np.random.default_rng(7)
    state, completed, before = State(), [], attitude(0.0)
    for tick in range(1, round(seconds / DT) + 1):
        now = attitude(tick * DT)
        rate = (before.inv() * now).as_rotvec() / DT + offset + random.normal(0.0, GYRO_NOISE, 3)
        force = now.inv().apply((0.0, 0.0, -STANDARD_GRAVITY)) + random.normal(0.0, ACCEL_NOISE, 3)
        magnetic = now.inv().apply(FIELD_NED) + random.normal(0.0, FIELD_NOISE, 3) if field else np.zeros(3)
        imu = ImuSample(round(tick * DT * 1e6), *force.tolist(), *rate.tolist(), *magnetic.tolist())
        state, done = preflight.step(GAINS, state, imu, 1.0 if tick % 4 == 0 else None)
        completed += [tick * DT] if done else []
        before = now
    return Detected(completed, state)


@pytest.mark.parametrize("offset_deg", [0.0, 5.7, 20.0, 38.0])
def test_gyro_offset_is_measured_at_rest(offset_deg: float) -> None:
    """GIVEN an offset up to the data sheet's THEN it is known 1.5 s after boot within 0.1 deg/s."""
    offset = (math.radians(offset_deg), -math.radians(offset_deg), 0.0)
    found = detect(offset=offset)
    assert found.completed[0] == pytest.approx(1.5, abs=0.02)
    assert found.state.rest is not None
    assert np.degrees(found.state.rest.means.rate) == pytest.approx(np.degrees(offset), abs=0.1)
    assert preflight.findings(GAINS, found.state, REFERENCE) == ()


def test_gyro_offset_beyond_the_data_sheet_is_a_finding() -> None:
    found = detect(offset=(0.0, math.radians(45.0), 0.0))
    assert not found.completed
    assert preflight.findings(GAINS, found.state, REFERENCE) == (Finding.GYRO_OFFSET,)


@pytest.mark.parametrize("frequency", [4.0, 8.0, 12.0])
def test_unsteady_hand_is_a_standstill(frequency: float) -> None:
    """GIVEN tremor of 2 deg/s and sway WHEN the gyro is 8 deg/s off THEN the offset is known within 1 deg/s."""
    found = detect(unsteady(frequency, math.radians(2.0)), 10.0, (math.radians(8.0), 0.0, 0.0))
    assert found.completed and found.completed[0] < 6.0
    assert found.state.rest is not None
    assert np.degrees(found.state.rest.means.rate) == pytest.approx([8.0, 0.0, 0.0], abs=1.0)


@pytest.mark.parametrize("motion", [unsteady(3.0, 0.5), turning((0.0, 0.0, 0.1)), turning((0.05, 0.0, 0.0))])
def test_motion_is_no_standstill(motion: Attitude) -> None:
    """GIVEN a vehicle that is shaken, or turned steadily about any axis THEN the gyros stay uncalibrated."""
    found = detect(motion, 6.0)
    assert not found.completed
    assert preflight.findings(GAINS, found.state, REFERENCE) == (Finding.GYRO_UNCALIBRATED,)


def test_standstill_after_a_motion_is_found() -> None:
    shaken = unsteady(3.0, 0.5)
    found = detect(lambda time: shaken(min(time, 4.0)), 7.0)
    assert 5.4 < found.completed[0] < 6.2


def test_tilting_is_found_without_a_magnetometer() -> None:
    assert not detect(turning((0.05, 0.0, 0.0)), 6.0, field=False).completed
    assert detect(field=False).completed


def test_gap_between_samples_discards_the_window() -> None:
    state = detect(seconds=1.4).state
    late = ImuSample(2_000_000, 0.0, 0.0, -STANDARD_GRAVITY, 0.0, 0.0, 0.0, 0.2, 0.0, 0.4)
    after, completed = preflight.step(GAINS, state, late)
    assert not completed and after.windows == () and after.samples == 0


def resting(
    force: float = STANDARD_GRAVITY,
    strength: float = FIELD,
    dip: float = DIP,
    pressure: float = 0.0,
    spread: float = 0.5,
) -> State:
    field = (strength * math.cos(dip), 0.0, strength * math.sin(dip))
    return State(rest=Rest(Means((0.0, 0.0, 0.0), (0.0, 0.0, -force), field, pressure), spread))


@pytest.mark.parametrize(
    ("state", "expected"),
    [
        (resting(), ()),
        (resting(force=1.15 * STANDARD_GRAVITY), (Finding.ACCELEROMETER,)),
        (resting(force=0.85 * STANDARD_GRAVITY), (Finding.ACCELEROMETER,)),
        (resting(force=1.016 * STANDARD_GRAVITY), ()),
        (resting(strength=FIELD + 0.25), (Finding.FIELD_STRENGTH,)),
        (resting(dip=DIP - 0.15), (Finding.FIELD_DIP,)),
        (resting(dip=DIP + 0.08), ()),
        (resting(strength=0.0), ()),
        (resting(pressure=-30.0), (Finding.PITOT,)),
        (resting(pressure=30.0), (Finding.PITOT,)),
        (resting(pressure=30.0, spread=4.0), ()),
        (resting(pressure=12.0), ()),
    ],
)
def test_findings_at_rest(state: State, expected: tuple[Finding, ...]) -> None:
    """Wind fluctuates, an offset does not; a sensor that is not there is not checked."""
    assert preflight.findings(GAINS, state, REFERENCE) == expected


def test_unknown_reference_field_is_not_checked() -> None:
    assert preflight.findings(GAINS, resting(strength=1.0, dip=0.2), Reference(0.0, 0.0)) == ()


def test_dip_is_measured_in_any_attitude() -> None:
    found = detect()
    assert found.state.rest is not None
    assert preflight.dip(found.state.rest.means) == pytest.approx(DIP, abs=0.005)


def test_state_through_json() -> None:
    state = detect(seconds=1.8).state
    assert snapshot.builder(State)(json.loads(json.dumps(state))) == state
