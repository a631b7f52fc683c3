"""Attitude filters on recorded and simulated motion: ours beside `ahrs`, `imufusion` and `vqf` (``make bench``).

All get the same samples in sensor axes one after the other, with their default gains, no alignment or offset fitted.
Their earths differ: NWU (Madgwick of `ahrs`, `imufusion` by default), ENU (Mahony of `ahrs`, `vqf`), NED (ours). Each
is turned to ENU; that this is understood rightly is asserted on a slow motion of known attitude before it is told.
"""

from __future__ import annotations

import importlib.util
import os
import time
from collections.abc import Callable
from functools import cache
from math import sqrt
from pathlib import Path

import numpy as np
import pytest
from rows import Row, leave, peer
from scipy.spatial.transform import Rotation
from test_flight_speed import VEHICLE, computer

from avionics.estimation.ahrs import AhrsGains
from avionics.missions.script import scripted_start
from avionics.vehicles import load_vehicle as load_flight_vehicle
from logs.replay import imu
from sim_bridge.bridge.world import NEUTRAL
from sim_bridge.flight.world import Scenario, SimulatedWorld
from sim_bridge.vehicles import load_vehicle
from wingbeat.constants import STANDARD_GRAVITY

ROOT = Path(__file__).parents[2]
TRIAL = ROOT / "tests" / "data" / "broad" / "trial_16_fast_translation_25_to_75_s.npz"
SHARED = Path(os.environ.get("WINGBEAT_SHARED", ROOT.parent / "shared")) / "data" / "imu"
"""the four whole trials, where they are"""
FUSION = {
    "gain": 0.5,
    "gyroscope_range": 2000.0,
    "acceleration_rejection": 10.0,
    "magnetic_rejection": 10.0,
    "rejection_timeout": 5.0,
}
"""`imufusion` with its rejection of disturbances on, which it is by default without, and worse"""
Filter = Callable[[imu.Recording], imu.Array]
ENU_FROM_NWU = np.array([[sqrt(0.5), 0.0, 0.0, sqrt(0.5)]])
SETTLED, FLIGHT = 20.0, 60.0
"""s; after which errors on the slow motion count, and of the simulated flight"""
UNDERSTOOD = 2.0
"""deg; a wrong frame, sign or unit is tens of degrees off on the slow motion"""


def computed(recording: imu.Recording) -> imu.Array:
    return imu.orientations(recording, AhrsGains())


def madgwick(recording: imu.Recording) -> imu.Array:
    from ahrs.filters import Madgwick

    acc, gyr, mag = np.split(recording.sensors, 3, axis=1)
    return imu.multiply(ENU_FROM_NWU, Madgwick(gyr, acc, mag * 1e5, frequency=recording.rate).Q)


def mahony(recording: imu.Recording) -> imu.Array:
    from ahrs.filters import Mahony

    acc, gyr, mag = np.split(recording.sensors, 3, axis=1)
    return np.asarray(Mahony(gyr, acc, mag * 1e5, frequency=recording.rate).Q)


def fusion(recording: imu.Recording) -> imu.Array:
    """Degrees per second and g, as it asks for."""
    import imufusion

    acc, gyr, mag = np.split(recording.sensors, 3, axis=1)
    settings = imufusion.AhrsSettings(**FUSION, sample_rate=recording.rate)
    ahrs = imufusion.Ahrs().set_settings(settings).set_sample_period(1.0 / recording.rate)
    out = np.zeros((len(acc), 4))
    for i, (g, a, m) in enumerate(zip(np.degrees(gyr), acc / 9.80665, mag * 100.0, strict=True)):
        ahrs.update(g, a, m)
        out[i] = ahrs.get_quaternion()
    return imu.multiply(ENU_FROM_NWU, out)


def vqf(recording: imu.Recording) -> imu.Array:
    from vqf import VQF

    acc, gyr, mag = (np.ascontiguousarray(part) for part in np.split(recording.sensors, 3, axis=1))
    filtering, out = VQF(1.0 / recording.rate), np.zeros((len(acc), 4))
    for i in range(len(acc)):
        filtering.update(gyr[i], acc[i], mag[i])
        out[i] = filtering.getQuat9D()
    return out


PEERS: dict[str, tuple[str, Filter]] = {
    "Madgwick": ("ahrs", madgwick),
    "Mahony": ("ahrs", mahony),
    "imufusion": ("imufusion", fusion),
    "vqf": ("vqf", vqf),
}


@cache
def slow_motion() -> imu.Recording:
    """Two minutes of turning slowly through 40 degrees and all headings, without errors of sensors."""
    rate, at = 100.0, np.arange(12_000) / 100.0
    angles = np.stack([0.3 * at, 0.5 * np.sin(0.4 * at), 0.7 * np.sin(0.23 * at)], axis=1)
    enu = Rotation.from_euler("ZYX", angles)
    gyr = np.concatenate([np.zeros((1, 3)), (enu[:-1].inv() * enu[1:]).as_rotvec() * rate])
    acc, mag = enu.inv().apply([0.0, 0.0, STANDARD_GRAVITY]), enu.inv().apply([0.0, 0.2, -0.4])
    reference = np.roll(enu.as_quat(), 1, axis=1)
    sensors = np.concatenate([acc, gyr, mag], axis=1)
    return imu.Recording(Path("slow motion"), rate, sensors, reference, at > SETTLED)


@cache
def flapping_flight() -> imu.Recording:
    """Raw samples of the simulated sensors and the truth, from a second after the throw on.

    Without what the flight computer has besides: the stroke's period, the airspeed, a calibration before the flight.
    """
    world, autopilot = SimulatedWorld(load_vehicle(VEHICLE), Scenario(duration=FLIGHT)), computer()
    script, command, sensors, truth, flying = list(scripted_start()), NEUTRAL, [], [], []
    while not world.finished:
        frame = world.step(command)
        due = [entry for entry in script if entry.time_us <= frame.time_us]
        script = script[len(due) :]
        command = autopilot.step(frame, due)
        sensors.append(frame.imu[1:10])
        truth.append(world.plant.y[3:7].copy())
        flying.append(world.launched)
    reference = imu.multiply(np.array([north()]), np.array(truth))
    begun = np.flatnonzero(flying)[0] + 200
    return imu.Recording(Path("flapping flight"), 200.0, np.array(sensors), reference, np.arange(len(truth)) > begun)


def north() -> tuple[float, float, float, float]:
    """The quaternion from true NED to ENU of magnetic north, which is all that a filter here can know."""
    half = -0.5 * load_flight_vehicle(VEHICLE).gains.ahrs.declination
    turn = np.array([[np.cos(half), 0.0, 0.0, np.sin(half)]])
    w, x, y, z = imu.multiply(np.array([imu.ENU_FROM_NED]), turn)[0]
    return float(w), float(x), float(y), float(z)


def scored(recording: imu.Recording, run: Filter) -> tuple[float, float, float]:
    """Total and inclination error in deg, RMS, and processor time in us a sample."""
    begun = time.process_time()
    estimate = run(recording)
    spent = time.process_time() - begun
    total, _, inclination = (
        float(np.degrees(np.sqrt(np.mean(error[recording.counts] ** 2))))
        for error in imu.orientation_errors(estimate, recording.reference)
    )
    return total, inclination, 1e6 * spent / len(estimate)


@cache
def of_wingbeat(name: str) -> tuple[float, float, float]:
    each = [scored(recording, computed) for recording in motions()[name]]
    return tuple(np.mean(each, axis=0).tolist())  # type: ignore[return-value]


@cache
def motions() -> dict[str, list[imu.Recording]]:
    named = {"BROAD, shaken": [imu.load_recording(TRIAL)], "flapping flight, IMU alone": [flapping_flight()]}
    if SHARED.is_dir():
        named["BROAD, mean of four"] = [imu.load_recording(path) for path in imu.recordings([SHARED])]
    return named


@pytest.mark.bench
def test_ours_knows_the_slow_motion() -> None:
    assert scored(slow_motion(), computed)[0] < UNDERSTOOD


@pytest.mark.bench
@pytest.mark.parametrize("name", PEERS)
def test_attitude_beside(name: str) -> None:
    package, run = PEERS[name]
    if importlib.util.find_spec(package) is None:
        pytest.skip(f"the package {package} is not installed (extra `bench`)")
    total, *_ = scored(slow_motion(), run)
    print(f"{name}: {total:.2f} deg on the slow motion")  # noqa: T201
    assert total < UNDERSTOOD, "the peer is misunderstood"
    told = f"{peer(package)}, {name}" if name != package else peer(package)
    for motion, recordings in motions().items():
        theirs = np.mean([scored(recording, run) for recording in recordings], axis=0)
        for what, unit, mine, other in zip(
            ("total error", "inclination error", "time of a sample"), ("deg", "deg", "us"),
            of_wingbeat(motion), theirs,
            strict=True,
        ):  # fmt: skip
            leave(Row(f"attitude, {motion}: {what}", mine, float(other), unit, told))
