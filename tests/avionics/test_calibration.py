"""Calibration: modelled sensors with errors of their own, posed, turned and flown, come out right."""

import json
import math
from collections.abc import Iterable
from functools import cache

import numpy as np
import pytest
from scipy.spatial.transform import Rotation
from surrogate_gains import VEHICLE

from avionics import parameters, topics
from avionics.autopilot import Autopilot
from avionics.calibration import accelerometer, airspeed, battery, magnetometer, wings
from avionics.messages import AdcBurst, Command, CommandKind, EncoderSample, ImuSample, PressureSample, SensorFrame
from avionics.sensing import air_data, inertial, power, wing_angle
from avionics.vehicles import FlightVehicle
from sim_bridge.environment.home import COLLEGE_PARK
from sim_bridge.observation import Observation
from sim_bridge.sensors.accelerometer import Accelerometer
from sim_bridge.sensors.magnetometer import Magnetometer
from sim_bridge.sensors.noise import sensor_seed
from sim_bridge.sensors.suite import SensorSuite, sensor_spec
from sim_bridge.vehicles import load_vehicle
from wingbeat.topic import Topic

G = 9.80665
WORLD = load_vehicle("robo_raven_ii_d")
SIDES = {
    "level": (0.0, 0.0, -G),
    "on its back": (0.0, 0.0, G),
    "nose up": (G, 0.0, 0.0),
    "nose down": (-G, 0.0, 0.0),
    "right side up": (0.0, G, 0.0),
    "left side up": (0.0, -G, 0.0),
}


def biased() -> SensorSuite:
    """The Robo Raven's sensors, far from calibrated."""
    spec = sensor_spec(WORLD.sections)
    return SensorSuite(
        spec._replace(
            accelerometer=spec.accelerometer._replace(offset_sigma_mg=80.0, scale_sigma=0.02),
            magnetometer=spec.magnetometer._replace(hard_iron_sigma_mg=80.0, scale_sigma=0.08),
            pitot=spec.pitot._replace(zero_sigma=8.0, scale_sigma=0.08),
            encoder=spec.encoder._replace(zero_left=37.3, zero_right=-61.8),
            power_sensor=spec.power_sensor._replace(divider_sigma=0.05, current_zero_sigma=0.2),
        ),
        3,
        COLLEGE_PARK,
    )


def at_rest(attitude: Rotation, tick: int) -> Observation:
    """What a vehicle at rest on the ground is, turned as told (r_ned_from_frd), wings level, drives powered."""
    x, y, z, w = attitude.as_quat()
    force = attitude.inv().apply((0.0, 0.0, -G))
    still = (0.0, 0.0, 0.0)
    return Observation(
        5000 * tick + 5000, (w, x, y, z), still, tuple(force), still, still, still, 101325.0, 288.15, 1.225,
        0.0, 0.0, 0.0, 0.0, VEHICLE.gains.power.rest_current, 7.8, 0.0, 0.0, 300.0,
    )  # fmt: skip


class Bench:
    """A flight computer on the bench with sensors that are wrong."""

    def __init__(self, vehicle: FlightVehicle = VEHICLE) -> None:
        self.suite = biased()
        self.published: list[tuple[Topic, object]] = []
        self.autopilot = Autopilot(vehicle, (), lambda topic, message: self.published.append((topic, message)))
        self.tick = 0

    def rest(
        self,
        seconds: float,
        attitude: Rotation,
        commands: tuple[Command, ...] = (),
        turn: float = 0.0,
        every: int = 1,
    ) -> None:
        """Let time pass in one attitude; ``turn`` (rad/s) shakes it about pitch; only ``every`` n-th tick is felt."""
        for _ in range(round(seconds * 200 / every)):
            seen = at_rest(attitude, self.tick)._replace(omega_frd=(0.0, turn, 0.0))
            raw = self.suite.sample(seen, self.tick)
            imu = ImuSample(*raw.imu)
            parts = {
                "encoder": raw.encoder and EncoderSample(*raw.encoder),
                "pressures": raw.pressures and PressureSample(*raw.pressures),
                "adc": raw.adc and AdcBurst(*raw.adc),
            }
            self.autopilot.step(SensorFrame(raw.time_us, imu, **parts), commands)
            commands, self.tick = (), self.tick + every

    def events(self) -> list[str]:
        return [message.text for topic, message in self.published if topic is topics.EVENTS]  # type: ignore[attr-defined]

    def statuses(self) -> list[object]:
        return [message for topic, message in self.published if topic is topics.CALIBRATION]


def request(name: str, value: float = 0.0) -> tuple[Command, ...]:
    return (Command(0, CommandKind.CALIBRATE, name, value, source="test"),)


def towards(force: tuple[float, float, float], yaw: float = 0.0) -> Rotation:
    """The attitude at rest in which the specific force is ``force``."""
    tilt = Rotation.align_vectors([(0.0, 0.0, -G)], [force])[0]
    return Rotation.from_euler("z", yaw) * tilt


LEVEL = towards(SIDES["level"])


@cache
def calibrated() -> Bench:
    """Accelerometer on six sides, none exact; magnetometer turned; pitot, wings and battery at rest."""
    bench = Bench()
    bench.rest(1.0, LEVEL)
    bench.rest(0.1, LEVEL, request("ACCELEROMETER"))
    for number, force in enumerate(SIDES.values()):
        tilted = towards(force, 0.7 * number) * Rotation.from_euler("xyz", (0.08, -0.1, 0.05))
        bench.rest(0.3, tilted * Rotation.from_euler("x", 0.3), turn=1.0)
        bench.rest(3.2, tilted)
    bench.rest(0.1, LEVEL, request("MAGNETOMETER"))
    for attitude in Rotation.random(600, rng=5):
        bench.rest(0.02, attitude)
    bench.rest(0.1, LEVEL, request("AIRSPEED_ZERO"))
    bench.rest(3.0, LEVEL)
    bench.rest(0.1, LEVEL, request("WINGS"))
    bench.rest(2.0, LEVEL)
    bench.rest(0.1, LEVEL, request("BATTERY", 7.8))
    bench.rest(2.0, LEVEL)
    return bench


def test_every_calibration_on_the_bench_ends_well_and_says_what_it_left() -> None:
    bench = calibrated()
    reports = [text for text in bench.events() if "calibrated" in text]
    kinds = ("ACCELEROMETER", "MAGNETOMETER", "AIRSPEED_ZERO", "WINGS", "BATTERY")
    assert [text.split(" ")[0] for text in reports] == list(kinds)
    assert all("calibrated: residual" in text for text in reports)
    ended = [status for status in bench.statuses() if not status.running]  # type: ignore[attr-defined]
    assert [(status.calibration_count, status.succeeded) for status in ended] == [(n, 1) for n in range(1, 6)]  # type: ignore[attr-defined]
    assert "pose 6 of 6: left side up" in bench.events()


def test_calibration_publishes_changed_parameters() -> None:
    """GIVEN calibrated sensors THEN `/system/changes` has each parameter with the value that took effect."""
    bench = calibrated()
    gains = bench.autopilot.memory.gains
    texts = [message.text for topic, message in bench.published if topic is topics.CHANGES]  # type: ignore[attr-defined]
    values = {each["parameter"]: each["value"] for each in map(json.loads, texts)}
    table = parameters.parameter_table(gains)
    assert values == {name: parameters.get(gains, table[name]) for name in values}
    assert {"IMU_ACCEL_OFS_1", "IMU_MAG_OFS_1", "WING_ZERO_LEFT"} < set(values)
    assert {json.loads(text)["source"] for text in texts} == {"calibration"}


def test_the_accelerometer_comes_out_with_its_offset_and_scale() -> None:
    errors = calibrated().suite.unit_errors()
    gains = calibrated().autopilot.state.gains.imu
    # counts = (1 + scale) f + offset; the mean of 400 samples is known to a twentieth of the noise and half a step.
    noise = 3.0 * G / 256.0 / math.sqrt(400.0) * 1.56 + 0.01
    for axis in range(3):
        assert gains.accel_offset[axis] == pytest.approx(errors["accelerometer.offset"][axis], abs=noise)
        assert gains.accel_scale[axis] == pytest.approx(1.0 / (1.0 + errors["accelerometer.scale"][axis]), abs=2e-3)
    assert max(map(abs, errors["accelerometer.offset"])) > 20.0 * noise


def test_the_magnetometer_comes_out_with_its_hard_iron_and_one_strength_all_around() -> None:
    bench = calibrated()
    errors, gains = bench.suite.unit_errors(), bench.autopilot.state.gains.imu
    assert gains.mag_offset == pytest.approx(errors["magnetometer.offset"], abs=0.002)
    sensor = bench.suite._magnetometer
    sizes = []
    for attitude in Rotation.random(300, rng=6):
        x, y, z, w = attitude.as_quat()
        sample = ImuSample(0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, *sensor.read((w, x, y, z)))
        sizes.append(math.dist(inertial.correct(gains, sample)[7:], (0.0, 0.0, 0.0)))
    # The noise of 2 mG and the step of 4.35 mG leave 2.4 mG along any direction.
    assert np.std(sizes) < 0.0032
    assert max(map(abs, errors["magnetometer.offset"])) > 0.05


def test_pitot_wings_and_battery_come_out_with_their_zeros_and_scale() -> None:
    bench = calibrated()
    errors, gains = bench.suite.unit_errors(), bench.autopilot.state.gains
    assert gains.air_data.differential_zero == pytest.approx(errors["pitot.zero"], abs=3 * 1.9 / 10.0)
    # A count is the place that was passed last.
    assert (gains.wing_angle.zero_left, gains.wing_angle.zero_right) == pytest.approx((37.3, -61.8), abs=1.0)
    assert gains.power.divider == pytest.approx(0.5 * (1.0 + errors["power_sensor.divider"]), rel=1e-3)
    zero = 2.5 + 0.2 * errors["power_sensor.current_zero"]
    assert gains.power.current_zero == pytest.approx(zero, abs=5e-4)


def test_the_calibrated_computer_finds_attitude_voltage_and_still_air() -> None:
    gains = calibrated().autopilot.state.gains
    bench = Bench(VEHICLE._replace(gains=gains))
    attitude = Rotation.from_euler("ZYX", (0.9, 0.2, -0.3))
    bench.rest(6.0, attitude)
    state = bench.autopilot.state
    roll, pitch = state.attitude.roll, state.attitude.pitch
    # The mounting is off by 0.3 degree a one-sigma axis, which no pose can tell.
    assert (roll, pitch) == pytest.approx((-0.3, 0.2), abs=math.radians(1.2))
    assert state.power_state.voltage == pytest.approx(7.8, abs=0.01)
    assert state.power_state.current == pytest.approx(gains.power.rest_current, abs=0.01)
    assert state.air.airspeed < 1.0
    assert (state.wing.angle_left, state.wing.angle_right) == pytest.approx((0.0, 0.0), abs=0.004)


# --- what must not be taken -----------------------------------------------------------------------------


@pytest.mark.parametrize("name", ["LEVEL", "AIRSPEED_ZERO", "WINGS", "BATTERY"])
def test_a_movement_cancels_what_needs_rest(name: str) -> None:
    bench = Bench()
    before = bench.autopilot.state.gains
    bench.rest(0.5, LEVEL, request(name))
    bench.rest(0.1, LEVEL, turn=1.0)
    assert f"{name} calibration failed: canceled: vehicle moved" in bench.events()
    bench.rest(5.0, LEVEL)
    assert bench.autopilot.state.gains == before
    assert bench.autopilot.state.calibration.kind == 0


def test_armed_nothing_is_calibrated_and_while_calibrating_nothing_is_armed() -> None:
    bench = Bench()
    bench.suite = SensorSuite(sensor_spec(WORLD.sections), 3, COLLEGE_PARK)
    bench.rest(4.0, LEVEL)
    bench.rest(0.1, LEVEL, request("WINGS"))
    bench.rest(0.1, LEVEL, (Command(0, CommandKind.ARM),))
    assert "arming denied: calibration WINGS active" in bench.events()
    bench.rest(0.1, LEVEL, request("BATTERY", 7.8))
    assert "calibration denied: calibration WINGS active" in bench.events()
    bench.rest(0.1, LEVEL, request(""))
    assert "calibration WINGS canceled" in bench.events()
    bench.rest(0.1, LEVEL, (Command(0, CommandKind.ARM),))
    assert bench.autopilot.state.modes.armed
    bench.rest(0.1, LEVEL, request("MAGNETOMETER"))
    assert bench.events()[-1] == "calibration denied: armed"


@pytest.mark.parametrize(
    ("name", "value", "reports"),
    [
        ("ROTOR", 0.0, "unknown calibration ROTOR"),
        ("AIRSPEED", 0.0, "not in flight"),
        ("WINGS", 3.0, "171.887 is out of range -90 to 90 degrees"),
        ("BATTERY", -1.0, "-1 is out of range 0 to 100 V"),
        ("BATTERY", math.nan, "nan is out of range"),
    ],
)
def test_what_cannot_be_calibrated_is_refused_with_the_reason(name: str, value: float, reports: str) -> None:
    bench = Bench()
    bench.rest(0.1, LEVEL, request(name, value))
    assert bench.events()[-1].startswith(f"calibration denied: {reports}")


def test_a_magnetometer_turned_too_little_is_refused() -> None:
    bench = Bench()
    bench.rest(0.1, LEVEL, request("MAGNETOMETER"))
    for yaw in np.linspace(0.0, 2 * math.pi, 300):
        bench.rest(0.2, Rotation.from_euler("z", yaw), every=20)
    bench.rest(0.4, LEVEL, every=20)
    assert "% of all directions covered, 50 % required" in bench.events()[-1]
    assert bench.autopilot.state.gains.imu == VEHICLE.gains.imu


def test_a_pose_that_is_missing_ends_in_a_refusal() -> None:
    bench = Bench()
    bench.rest(130.0, LEVEL, request("ACCELEROMETER"), every=20)
    assert bench.events()[-1] == "ACCELEROMETER calibration failed: timed out after 60 s"


# --- the arithmetic -------------------------------------------------------------------------------------


def gathered(points: Iterable[tuple[float, float, float]]) -> magnetometer.State:
    state = magnetometer.State()
    for point in points:
        state, took = magnetometer.step(state, point)
        if took.complete:
            break
    return state


def test_soft_iron_across_the_axes_is_found_too() -> None:
    rng = np.random.default_rng(2)
    iron = np.array([[1.1, 0.08, -0.05], [0.08, 0.92, 0.06], [-0.05, 0.06, 1.02]])
    hard = np.array([0.12, -0.2, 0.07])
    directions = rng.normal(size=(4000, 3))
    field = 0.5 * directions / np.linalg.norm(directions, axis=1, keepdims=True)
    readings = field @ iron + hard + rng.normal(0.0, 0.002, field.shape)
    result, refusal = magnetometer.finish(gathered(map(tuple, readings)))
    assert refusal == ""
    values = [setting.value for setting in result.settings]
    assert values[:3] == pytest.approx(hard, abs=0.0015)
    inverse = np.linalg.inv(iron)
    inverse /= np.linalg.det(inverse) ** (1 / 3)
    assert values[3:6] == pytest.approx(np.diag(inverse), abs=5e-3)
    assert values[6:] == pytest.approx([inverse[0, 1], inverse[0, 2], inverse[1, 2]], abs=5e-3)
    assert result.residual < 0.003


def test_a_little_more_than_half_of_all_directions_gives_the_hard_iron_alone() -> None:
    rng = np.random.default_rng(3)
    directions = rng.normal(size=(4000, 3))
    directions = directions[directions[:, 2] < -0.05 * np.linalg.norm(directions, axis=1)]
    field = 0.5 * directions / np.linalg.norm(directions, axis=1, keepdims=True)
    state = gathered(map(tuple, field + np.array([0.1, 0.0, -0.1])))
    assert magnetometer.SPHERE <= state.coverage < magnetometer.ELLIPSOID
    result, refusal = magnetometer.finish(state)
    values = [setting.value for setting in result.settings]
    assert refusal == ""
    assert values == pytest.approx([0.1, 0.0, -0.1, 1.0, 1.0, 1.0, 0.0, 0.0, 0.0], abs=1e-6)


def flights(headings: np.ndarray, scale: float, turn: float, noise: float = 0.1) -> airspeed.State:
    """Fixes on these headings in a wind of (2, -1.5) m/s; the tube tells too little by ``scale``."""
    rng = np.random.default_rng(4)
    state = airspeed.State()
    for heading in headings:
        true = 7.0 + rng.normal(0.0, 0.2)
        north, east = true * math.cos(heading) + 2.0, true * math.sin(heading) - 1.5
        gusts = rng.normal(0.0, noise, 2)
        state, took = airspeed.step_scale(state, (heading + turn, true / scale, north + gusts[0], east + gusts[1]))
        if took.complete:
            break
    return state


@pytest.mark.parametrize(
    "headings",
    [np.linspace(0.0, 2 * math.pi, 80), np.repeat((0.4, 0.4 + math.pi), 40)],
    ids=["circle", "both ways"],
)
@pytest.mark.parametrize("scale", [0.9, 1.0, 1.12])
def test_the_scale_of_the_airspeed_is_found_in_wind_with_a_heading_that_is_wrong(
    headings: np.ndarray, scale: float
) -> None:
    gains = air_data.Gains()
    result, refusal = airspeed.finish_scale(flights(headings, scale, turn=0.1), gains)
    assert refusal == ""
    assert math.sqrt(result.settings[0].value) == pytest.approx(scale, abs=0.01)


def test_one_heading_or_a_storm_gives_no_scale() -> None:
    _, refusal = airspeed.finish_scale(flights(np.full(400, 0.4), 1.0, 0.0), air_data.Gains())
    assert "fly a circle" in refusal
    _, refusal = airspeed.finish_scale(flights(np.linspace(0, 6.3, 80), 1.0, 0.0, noise=5.0), air_data.Gains())
    assert "scale uncertain" in refusal


def test_a_scale_stacks_on_the_one_that_was_there() -> None:
    gains = air_data.Gains(differential_scale=1.21)
    result, _ = airspeed.finish_scale(flights(np.linspace(0, 6.3, 80), 0.95, 0.0), gains)
    assert result.settings[0].value == pytest.approx(1.21 * 0.95**2, rel=0.02)


def test_wings_at_a_known_angle_and_a_reversed_encoder() -> None:
    gains = wing_angle.Gains(sign_right=-1.0)
    state = wings.State()
    for number in range(wings.AT_REST):
        state, took = wings.step(state, EncoderSample(5000 * number, 130, -90))
    assert took.complete
    result, _ = wings.finish(state, gains, math.radians(18.0))
    assert [setting.value for setting in result.settings] == pytest.approx([30.0, 10.0])
    _, moved = wings.step(state, EncoderSample(0, 134, -90))
    assert moved.cancelled == "wing moved"


@pytest.mark.parametrize(
    ("counts", "reports"), [((820, 700), "current not zero"), ((400, 512), "differs from measured")]
)
def test_a_running_drive_or_a_wrong_voltage_is_refused(counts: tuple[int, int], reports: str) -> None:
    gains, state = power.Gains(), battery.State()
    for number in range(battery.AT_REST):
        burst = AdcBurst(10_000 * number, (counts[0],) * 60, (counts[1],) * 60)
        state, _ = battery.step(gains, state, burst)
    _, refusal = battery.finish(state, gains, 8.0)
    assert reports in refusal


def test_six_exact_poses_give_exact_values() -> None:
    offset, scale = np.array([0.4, -0.2, 0.7]), np.array([1.02, 0.97, 1.01])
    state = accelerometer.State()
    for force in SIDES.values():
        for _ in range(accelerometer.BLOCK * accelerometer.BLOCKS):
            state, took = accelerometer.step(state, tuple(np.array(force) / scale + offset))
    assert took.complete
    result, refusal = accelerometer.finish(state)
    assert refusal == ""
    assert [setting.value for setting in result.settings] == pytest.approx([*offset, *scale], abs=1e-9)
    assert result.residual < 1e-9


def test_a_level_pose_sets_the_offsets_and_a_tilted_one_is_refused() -> None:
    def posed(force: tuple[float, float, float]) -> tuple[object, str]:
        state, took = accelerometer.State(), None
        for _ in range(accelerometer.BLOCK * accelerometer.BLOCKS):
            state, took = accelerometer.step_level(state, force)
        assert took is not None and took.complete
        return accelerometer.finish_level(state, inertial.Gains(accel_scale=(1.0, 1.0, 1.02)))

    result, refusal = posed((0.3, -0.1, -G / 1.02 + 0.2))
    assert refusal == ""
    values = [setting.value for setting in result.settings]  # type: ignore[attr-defined]
    assert values[:3] == pytest.approx([0.3, -0.1, 0.2])
    assert posed((5.0, 0.0, -8.4))[1] == "vehicle is not level"


def test_a_neutral_calibration_costs_nothing_and_passes_the_sample_as_it_is() -> None:
    sample = ImuSample(1, 0.1, 0.2, -9.8, 0.0, 0.1, 0.2, 0.3, 0.1, 0.4)
    assert inertial.correct(VEHICLE.gains.imu, sample) is sample


def test_sensors_of_the_world_are_read_as_they_are_here() -> None:
    """The models alone, without the flight computer: what the fits are fed is what a unit says."""
    spec = sensor_spec(WORLD.sections)
    exact = spec.accelerometer._replace(offset_sigma_mg=0.0, scale_sigma=0.0, misalignment_sigma_deg=0.0)
    unit = Accelerometer(exact, sensor_seed(1, 0), 0.005)
    readings = np.array([unit.read((0.0, 0.0, -G)) for _ in range(2000)])
    assert readings.mean(axis=0) == pytest.approx((0.0, 0.0, -G), abs=0.01)
    iron = spec.magnetometer._replace(hard_iron_sigma_mg=0.0, scale_sigma=0.0, misalignment_sigma_deg=0.0)
    compass = Magnetometer(iron, sensor_seed(1, 0), COLLEGE_PARK.magnetic)
    size = [math.dist(compass.read((1.0, 0.0, 0.0, 0.0)), (0.0, 0.0, 0.0)) for _ in range(200)]
    assert np.mean(size) == pytest.approx(0.5, abs=0.1)
