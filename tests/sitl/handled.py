"""A vehicle that waits for its launch while it is carried: motion in the hand, on foot and in a car.

Sources: walking by Bachmann and Ammann, Vibrations in Structures Induced by Man and Machines, IABSE 1987, as
harmonics of the step rate; road by ISO 8608, class C at 20 m/s; car by the quarter-car model of the
International Roughness Index (Sayers, Transportation Research Record 1501, 1995). Motion in the hand: chosen.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.signal import butter, cont2discrete, dlsim, sosfiltfilt
from scipy.spatial.transform import Rotation

from avionics import topics
from avionics.autopilot import Autopilot
from avionics.messages import Stage
from avionics.missions import load_mission
from avionics.missions.script import scripted_start
from avionics.vehicles import load_vehicle as load_flight_vehicle
from sim_bridge.environment.home import COLLEGE_PARK
from sim_bridge.observation import Observation
from sim_bridge.sensors.suite import SensorSuite, sensor_spec
from sim_bridge.vehicles import load_vehicle
from sim_bridge.vibration.flight import vibration_of
from wingbeat.constants import STANDARD_GRAVITY
from wingbeat.topic import Topic

RATE = 200.0
REST = 8.0
"""s; at rest for the alignment, the arming and the filters"""
Array = NDArray[np.float64]
IN_HAND = np.array((0.0, 0.2, 0.0))
"""rad; roll, pitch, yaw at rest"""


class Motion(NamedTuple):
    """Carried motion, sampled at `RATE`."""

    acceleration: Array
    """m/s^2, (n, 3); NED"""
    turn: Array
    """rad, (n, 3); roll, pitch, yaw"""
    wind: float
    """m/s; from ahead, relative to the ground; NaN without flow along the pitot, as in a car"""


def band_noise(generator: np.random.Generator, count: int, low: float, high: float, rms: float) -> Array:
    """Return ``count`` samples of noise between two frequencies in Hz."""
    sos = butter(2, (low, high), "band", fs=RATE, output="sos")
    noise = sosfiltfilt(sos, generator.standard_normal(count + 2000))[1000:-1000]
    return np.asarray(noise * (rms / np.std(noise)))


def in_the_hand(seed: int, seconds: float) -> Motion:
    """Waved by 0.1 m RMS per axis, 0.3 to 1.5 Hz, turned by 0.3 rad, with a jolt of 3 g every five seconds."""
    generator, count = np.random.default_rng(seed), round(seconds * RATE)
    position = np.column_stack([band_noise(generator, count, 0.3, 1.5, 0.1) for _ in range(3)])
    acceleration = np.gradient(np.gradient(position, axis=0), axis=0) * RATE**2
    pulse = 3.0 * STANDARD_GRAVITY * np.sin(np.linspace(0.0, math.pi, 4))
    for start in range(500, count - 20, 1000):
        axis, sign = generator.integers(3), generator.choice((-1.0, 1.0))
        acceleration[start : start + 4, axis] += sign * pulse
        acceleration[start + 6 : start + 10, axis] -= sign * pulse
    turn = np.column_stack([band_noise(generator, count, 0.1, 1.0, rms) for rms in (0.3, 0.3, 0.5)])
    return Motion(acceleration, turn + IN_HAND, 2.0)


def walking(seed: int, seconds: float) -> Motion:
    """On foot at 1.4 m/s: 1.5 to 2.5 steps a second, with the load factors of Bachmann and Ammann."""
    generator, count = np.random.default_rng(seed), round(seconds * RATE)
    steps = np.cumsum(2.0 + band_noise(generator, count, 0.02, 0.2, 0.2)) / RATE
    factors = {
        0: {0.5: 0.1, 1.0: 0.2, 2.0: 0.1},
        1: {0.5: 0.1, 1.0: 0.1, 1.5: 0.1},
        2: {1.0: 0.4, 2.0: 0.1, 3.0: 0.1},
    }
    acceleration = np.zeros((count, 3))
    for axis, harmonics in factors.items():
        for order, factor in harmonics.items():
            phase = generator.uniform(0.0, math.tau)
            acceleration[:, axis] += STANDARD_GRAVITY * factor * np.sin(math.tau * order * steps + phase)
    acceleration[: round(RATE), 0] += 1.4
    turn = np.column_stack([band_noise(generator, count, 0.5, 2.0, 0.05) for _ in range(3)])
    return Motion(acceleration, turn + IN_HAND, 2.0)


def quarter_car(slope: Array) -> Array:
    """Return the acceleration (m/s^2) of a car's body for the vertical velocity (m/s) of the road under its wheel."""
    c, k1, k2, mu = 6.0, 653.0, 63.3, 0.15
    a = np.array([
        [0.0, 1.0, 0.0, 0.0, 0.0],
        [-k2, -c, k2, c, 0.0],
        [0.0, 0.0, 0.0, 1.0, 0.0],
        [k2 / mu, c / mu, -(k1 + k2) / mu, -c / mu, k1 / mu],
        [0.0, 0.0, 0.0, 0.0, 0.0],
    ])  # fmt: skip
    b = np.array([[0.0], [0.0], [0.0], [0.0], [1.0]])
    system = cont2discrete((a, b, a[1:2], np.zeros((1, 1))), 1.0 / RATE, "zoh")
    _, output, _ = dlsim(system, slope)
    return np.asarray(output[:, 0])


def in_a_car(seed: int, seconds: float) -> Motion:
    """On the seat of a car on a road of class C, with starts, brakes and turns up to 3 m/s^2."""
    generator, count = np.random.default_rng(seed), round(seconds * RATE)
    roughness, reference, speed = 256e-6, 0.1, 20.0
    density = (math.tau * reference) ** 2 * roughness * speed
    slope = generator.standard_normal(count) * math.sqrt(density * RATE / 2.0)
    acceleration = np.zeros((count, 3))
    acceleration[:, 0] = np.clip(band_noise(generator, count, 0.01, 0.2, 1.5), -3.0, 3.0)
    acceleration[:, 1] = np.clip(band_noise(generator, count, 0.02, 0.3, 1.0), -3.0, 3.0)
    acceleration[:, 2] = -quarter_car(slope)
    turn = np.column_stack([band_noise(generator, count, 0.5, 3.0, rms) for rms in (0.03, 0.03, 0.0)])
    return Motion(acceleration, turn + IN_HAND, math.nan)


CARRIED: dict[str, Callable[[int, float], Motion]] = {
    "hand": in_the_hand,
    "walking": walking,
    "car": in_a_car,
}


class Carried(NamedTuple):
    """Result of a carried vehicle."""

    events: list[str]
    stage: Stage
    """at the end"""


def carry(vehicle: str, motion: Motion, seed: int, beating: bool) -> Carried:
    """Run the flight computer, armed in AUTO, through a motion; with ``beating`` wings and their vibration."""
    world = load_vehicle(vehicle)
    events: list[str] = []

    def publish(topic: Topic[Any], message: Any) -> None:
        if topic is topics.EVENTS:
            events.append(message.text)

    autopilot = Autopilot(load_flight_vehicle(vehicle), load_mission("circuit"), publish)
    suite = SensorSuite(sensor_spec(world.sections), seed, COLLEGE_PARK)
    vibration = vibration_of(world, 1.0, seed, 1.0 / RATE) if beating else None
    omega, script = math.tau * world.cruise.frequency, list(scripted_start())
    for tick, observation in enumerate(observations(vehicle, motion)):
        time = observation.time_us * 1e-6
        amplitude = 0.5 if beating and time > 0.5 * REST else 0.0
        flap = amplitude * math.sin(omega * time)
        observation = observation._replace(flap_left=flap, flap_right=flap)
        if vibration is not None:
            observation = vibration.shake(observation, amplitude * omega * math.cos(omega * time))
        due = tuple(command for command in script if command.time_us <= observation.time_us)
        script = script[len(due) :]
        autopilot.step(suite.sample(observation, tick), due)
    return Carried(events, Stage(autopilot.memory.modes.stage))


def observations(vehicle: str, motion: Motion) -> list[Observation]:
    """Return what the sensors of a carried vehicle observe, after `REST` s at rest."""
    world, rest = load_vehicle(vehicle), round(REST * RATE)
    count = rest + len(motion.acceleration)
    acceleration, turn = np.zeros((count, 3)), np.tile(IN_HAND, (count, 1))
    fade = np.minimum(np.arange(len(motion.acceleration)) / RATE, 1.0)[:, None]
    acceleration[rest:], turn[rest:] = fade * motion.acceleration, turn[rest:] + fade * (motion.turn - turn[rest:])
    velocity = np.cumsum(acceleration, axis=0) / RATE
    position = np.cumsum(velocity, axis=0) / RATE - np.array((0.0, 0.0, 1.5))
    attitude = Rotation.from_euler("ZYX", turn[:, ::-1])
    force = attitude.inv().apply(acceleration - np.array((0.0, 0.0, STANDARD_GRAVITY)))
    rotation = (attitude[:-1].inv() * attitude[1:]).as_rotvec() * RATE
    omega = np.vstack([rotation[:1], rotation])
    flow = np.zeros((count, 3))
    if not math.isnan(motion.wind):
        flow = attitude.inv().apply(velocity + np.array((motion.wind, 0.0, 0.0)))
    pressure = 101325.0 + 12.0 * position[:, 2]
    rows = zip(
        np.roll(attitude.as_quat(), 1, axis=1).tolist(), omega.tolist(), force.tolist(), position.tolist(),
        velocity.tolist(), flow.tolist(), pressure.tolist(), strict=True,
    )  # fmt: skip
    battery, drive = world.battery, world.drive
    return [
        Observation(
            round((tick + 1) / RATE * 1e6), tuple(quaternion), tuple(rate), tuple(push), tuple(place), tuple(speed),
            tuple(air), static, 288.15, 1.225, 0.0, 0.0, 0.0, 0.0, 2.0 * drive.idle_current,
            battery.full_voltage, battery.resistance, drive.pulse_current, drive.pwm_frequency,
        )
        for tick, (quaternion, rate, push, place, speed, air, static) in enumerate(rows)
    ]  # fmt: skip
