"""Vibration of the airframe: level of a mode, decay with the wings, energy of an impact, clipping."""

from __future__ import annotations

import math

import numpy as np
import pytest
from numpy.typing import NDArray

from avionics.messages import ActuatorCommand
from sim_bridge.flight.world import Scenario, SimulatedWorld
from sim_bridge.observation import Observation
from sim_bridge.plant import Plant
from sim_bridge.sensors.noise import sensor_seed
from sim_bridge.vehicles import load_vehicle
from sim_bridge.vehicles.vibration import ModeSpec, VibrationSpec
from sim_bridge.vibration.airframe import AirframeVibration
from sim_bridge.vibration.flight import make_unequal
from wingbeat.constants import STANDARD_GRAVITY
from wingbeat.errors import InputError

PERIOD, STROKE = 0.005, 4.0
REST = Observation(
    0, (1.0, 0.0, 0.0, 0.0), (0.0, 0.0, 0.0), (0.0, 0.0, -STANDARD_GRAVITY), (0.0, 0.0, 0.0), (0.0, 0.0, 0.0),
    (0.0, 0.0, 0.0), 101325.0, 288.0, 1.2, 0.0, 0.0, 0.0, 0.0, 0.0, 8.0, 0.1, 1.0, 0.0,
)  # fmt: skip
MODE = ModeSpec(30.0, 0.05, (0.5, 0.0, 1.0), (2.0, 0.0, 0.0), buffet=2.0)


def shaken(vibration: AirframeVibration, rates: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return angular velocity and specific force (n, 6) at the flap rates of the ticks."""
    seen = [vibration.shake(REST, float(rate)) for rate in rates]
    return np.array([(*one.omega_frd, *one.specific_force_frd) for one in seen])


def beating(seconds: float, rms: float = 5.0) -> NDArray[np.float64]:
    """Return the flap rate in rad/s of a sine with upper reversals at whole strokes."""
    time = PERIOD * np.arange(1, round(seconds / PERIOD) + 1)
    return -math.sqrt(2.0) * rms * np.sin(2.0 * math.pi * STROKE * time)


def build(
    spec: VibrationSpec, mode: ModeSpec = MODE, clipping: float = 1e3, factor: float = 1.0
) -> AirframeVibration:
    """Return the vibration of one mode."""
    return AirframeVibration(spec, {"one": mode}, sensor_seed(1, 10), PERIOD, clipping, factor)


def test_mode_has_its_level_and_grows_with_the_square_of_the_stroke_rate() -> None:
    """GIVEN buffeting of 2 m/s^2 WHEN the wings beat at the reference rate, and at twice it THEN 2 and 8 m/s^2."""
    spec = VibrationSpec(reference_rate=5.0)
    average = float(np.sinc(MODE.frequency * PERIOD))  # mean over a tick of a line at the mode's frequency
    for factor, rms in ((1.0, 5.0), (1.0, 10.0), (0.5, 5.0)):
        seen = shaken(build(spec, factor=factor), beating(60.0, rms))[400:]
        expected = factor * MODE.buffet * (rms / 5.0) ** 2 * average
        assert seen[:, 5].std() == pytest.approx(expected, rel=0.15)
        assert seen[:, 3].std() == pytest.approx(0.5 * expected, rel=0.15)
        assert seen[:, 0].std() == pytest.approx(2.0 * expected / (2.0 * math.pi * MODE.frequency), rel=0.15)
        assert seen[:, 4].std() == 0.0
        assert seen[:, 5].mean() == pytest.approx(-STANDARD_GRAVITY, abs=0.02 * expected)


def test_vibration_dies_with_the_wings() -> None:
    """GIVEN a vibrating airframe WHEN the wings stop THEN one second later it is 50 times calmer."""
    vibration = build(VibrationSpec(reference_rate=5.0, kick_phases=(0.5,)), MODE._replace(kick=0.05))
    flight = shaken(vibration, beating(10.0))[400:, 5].std()
    glide = shaken(vibration, np.zeros(600))[200:, 5].std()
    assert glide < flight / 50.0


def test_buffeting_in_a_glide_grows_with_the_square_of_the_airspeed() -> None:
    """GIVEN 1 % of buffeting per m^2/s^2 WHEN the wings stand at 3 and 6 m/s THEN 9 and 36 % of it, no impacts."""
    spec = VibrationSpec(reference_rate=5.0, airspeed_buffet=0.01, kick_phases=(0.5,))
    average = float(np.sinc(MODE.frequency * PERIOD))
    for air in ((3.0, 0.0, 0.0), (4.0, 2.0, 4.0)):
        vibration, gliding = build(spec, MODE._replace(kick=1.0)), REST._replace(v_air_frd=air)
        seen = np.array([vibration.shake(gliding, 0.0).specific_force_frd[2] for _ in range(12000)])[400:]
        expected = 0.01 * sum(one * one for one in air) * MODE.buffet * average
        assert seen.std() == pytest.approx(expected, rel=0.15)


def test_impact_rings_once_a_stroke_at_its_phase_with_the_energy_of_its_velocity() -> None:
    """GIVEN impacts of 0.1 m/s at half a stroke WHEN the wings beat THEN a decaying oscillation starts there."""
    mode = ModeSpec(40.0, 0.1, (0.0, 0.0, 1.0), (0.0, 0.0, 0.0), kick=0.1)
    seen = shaken(build(VibrationSpec(reference_rate=5.0, kick_phases=(0.5,)), mode), beating(20.0))[2000:, 5]
    strokes = (seen + STANDARD_GRAVITY)[: len(seen) // 50 * 50].reshape(-1, 50)
    energy = (strokes**2).mean(axis=0)
    assert int(np.diff(energy).argmax()) + 1 in (25, 26)  # the steepest rise
    assert energy[:24].max() < 0.01 * energy.max()
    omega = 2.0 * math.pi * mode.frequency
    expected = omega * mode.kick**2 / (4.0 * mode.damping)  # integral of the squared acceleration
    average = float(np.sinc(mode.frequency * PERIOD)) ** 2
    assert energy.sum() * PERIOD == pytest.approx(expected * average, rel=0.25)


def test_no_impact_is_lost_at_the_end_of_a_stroke() -> None:
    """GIVEN impacts at 0.99 of a stroke with jitter WHEN the wings beat THEN one happens in every stroke."""
    mode = ModeSpec(100.0, 0.5, (0.0, 0.0, 1.0), (0.0, 0.0, 0.0), kick=0.1)
    spec = VibrationSpec(reference_rate=5.0, kick_phases=(0.99,), kick_jitter=0.01)
    seen = shaken(build(spec, mode), beating(20.0))[400:, 5] + STANDARD_GRAVITY
    strokes = seen[25 : len(seen) // 50 * 50 - 25].reshape(-1, 50)  # an impact is in the middle of a row
    assert (np.abs(strokes).max(axis=1) > 1.0).all()


def test_periodic_force_has_its_order() -> None:
    """GIVEN a force of order 9 WHEN the wings beat at 4 Hz THEN its line stands at 36 Hz."""
    mode = ModeSpec(36.0, 0.05, (0.0, 0.0, 1.0), (0.0, 0.0, 0.0), mesh=1.0)
    seen = shaken(build(VibrationSpec(reference_rate=5.0, mesh_orders=(9.0,)), mode), beating(20.0))[2000:, 5]
    power = np.abs(np.fft.rfft(seen - seen.mean())) ** 2
    assert np.fft.rfftfreq(len(seen), PERIOD)[power.argmax()] == pytest.approx(36.0, abs=0.6)


def test_isolator_has_its_transmissibility() -> None:
    """GIVEN a line at 80 Hz WHEN the IMU is on a mount of 20 Hz THEN the transmissibility of spring and damper."""
    mode = ModeSpec(80.0, 0.05, (0.0, 0.0, 1.0), (0.0, 0.0, 0.0), mesh=2.0)
    hard, soft = (
        VibrationSpec(5.0, mesh_orders=(20.0,)),
        VibrationSpec(5.0, mesh_orders=(20.0,), isolator_frequency=20.0, isolator_damping=0.1),
    )
    levels = [shaken(build(spec, mode), beating(20.0))[2000:, 5].std() for spec in (hard, soft)]
    ratio = 80.0 / 20.0
    expected = math.hypot(1.0, 0.2 * ratio) / (ratio**2 - 1.0)
    assert levels[1] / levels[0] == pytest.approx(expected, rel=0.15)


def test_imu_clips_inside_and_averages() -> None:
    """GIVEN vibration beyond the range WHEN the IMU clips at 20 m/s^2 THEN no average is beyond it, and biased."""
    mode = MODE._replace(buffet=40.0, translation=(0.0, 0.0, 1.0))
    seen = shaken(build(VibrationSpec(5.0), mode, clipping=20.0), beating(30.0))[400:, 5]
    free = shaken(build(VibrationSpec(5.0), mode), beating(30.0))[400:, 5]
    assert np.abs(seen).max() <= 20.0 < np.abs(free).max()
    assert seen.mean() > free.mean() + 0.5


def test_sensor_errors_by_vibration() -> None:
    """GIVEN rectification and g-sensitivity WHEN the airframe vibrates THEN offset and rate as in the data sheet."""
    spec = VibrationSpec(5.0, rectification=10000.0)
    mode = MODE._replace(buffet=20.0, translation=(0.0, 0.0, 1.0))
    with_error, without = (shaken(build(one, mode), beating(60.0))[400:, 5] for one in (spec, VibrationSpec(5.0)))
    expected = 10000e-6 * 20.0**2 / STANDARD_GRAVITY
    assert float(np.mean(with_error - without)) == pytest.approx(expected, rel=0.2)
    still = shaken(build(VibrationSpec(5.0, g_sensitivity=0.1)), np.zeros(10))
    assert 0.0 < np.abs(still[-1, :3]).max() < 4.0 * math.radians(0.1)


def test_flight_without_vibration_is_the_flight_of_before() -> None:
    """GIVEN a vehicle with vibration WHEN it flies with a factor of 0 THEN its frames have no vibration."""
    vehicle = load_vehicle("robo_raven_ii_d")
    bare = vehicle._replace(
        modes={}, sections={name: one for name, one in vehicle.sections.items() if name != "vibration"}
    )
    from sim_bridge.bridge.world import NEUTRAL

    worlds = [SimulatedWorld(one, Scenario(seed=3)) for one in (vehicle, bare)]
    for _ in range(50):
        frames = [world.step(NEUTRAL) for world in worlds]
        assert frames[0] == frames[1]
    with pytest.raises(InputError, match="vibration"):
        SimulatedWorld(bare, Scenario(vibration=1.0))


def test_unequal_wings_differ_by_the_vehicle_file() -> None:
    """GIVEN a washout difference of 0.1 rad WHEN it is applied THEN right less left is 0.1 rad, the mean the same."""
    vehicle = load_vehicle("robo_raven_ii_d")
    sections = vehicle.sections | {"vibration": VibrationSpec(5.0, washout_difference=0.1, membrane_difference=0.2)}
    plant, equal = Plant(vehicle), Plant(vehicle)
    make_unequal(plant, vehicle._replace(sections=sections), 1.0)
    wings, before = plant.parameters.wings, equal.parameters.wings
    right, left = (int(np.flatnonzero(wings.side == side)[0]) for side in (1.0, -1.0))
    assert wings.washout[right] - wings.washout[left] == pytest.approx(0.1)
    assert wings.washout.mean() == pytest.approx(before.washout.mean())
    mass = [wings.membrane[wings.first[i] : wings.first[i + 1]].sum() for i in (right, left)]
    assert mass[0] / mass[1] == pytest.approx(1.1 / 0.9)


def roll_oscillation(name: str, difference: float) -> float:
    """Return the amplitude (rad/s) of the roll rate at the stroke frequency, of a flight without feedback."""
    vehicle = load_vehicle(name)
    world = SimulatedWorld(vehicle, Scenario(seed=3, launch_time=0.1))
    sections = vehicle.sections | {"vibration": VibrationSpec(5.0, stroke_difference=difference)}
    make_unequal(world.plant, vehicle._replace(sections=sections), 1.0)
    rows = []
    while len(rows) < 200:
        time = world.time_us * 1e-6
        angle = vehicle.cruise.stroke_mean + vehicle.cruise.stroke_amplitude * math.sin(8.0 * math.pi * time)
        world.step(ActuatorCommand(world.time_us, angle, angle, 0.6, 0.0, 0.0, 1))
        y, at = world.plant.y, world.plant.layout
        if world.launched and time > 0.6:
            flap = 0.5 * (y[at.flap[0]] + y[at.flap[1]])
            flap_rate = 0.5 * (y[at.rate(at.flap[0])] + y[at.rate(at.flap[1])])
            rows.append((flap, flap_rate, 1.0, time, time**2, time**3, y[10]))
    data = np.array(rows)
    by_flap, by_rate = np.linalg.lstsq(data[:, :-1], data[:, -1], rcond=None)[0][:2]
    return float(np.hypot(by_flap * np.std(data[:, 0]), by_rate * np.std(data[:, 1]))) * math.sqrt(2.0)


@pytest.mark.parametrize("name", ["robo_raven_ii_d", "arizona_100cm"])
def test_roll_rate_grows_with_the_stroke_difference(name: str) -> None:
    """GIVEN strokes that differ by 0, 0.02 and 0.04 WHEN the vehicle flies THEN the roll rate oscillates in
    proportion."""
    equal, small, large = (roll_oscillation(name, difference) for difference in (0.0, 0.02, 0.04))
    assert equal < 1e-9
    assert small > 0.01
    assert large == pytest.approx(2.0 * small, rel=0.1)


def test_strokes_differ_by_the_vehicle_file() -> None:
    """GIVEN a stroke difference of 0.1 WHEN it is applied twice THEN right less left is 0.2 of the mean."""
    vehicle = load_vehicle("arizona_100cm")
    sections = vehicle.sections | {"vibration": VibrationSpec(5.0, stroke_difference=0.1)}
    plant, equal = Plant(vehicle), Plant(vehicle).parameters
    make_unequal(plant, vehicle._replace(sections=sections), 2.0)
    left, right = plant.parameters.crank_amplitude[plant.parameters.wings.flap]
    assert (left, right) == pytest.approx((0.9 * vehicle.drive.crank_amplitude, 1.1 * vehicle.drive.crank_amplitude))
    assert plant.parameters.servo_gain == pytest.approx((0.9, 1.1))
    assert np.array_equal(equal.servo_gain, (1.0, 1.0))
    assert (equal.crank_amplitude == vehicle.drive.crank_amplitude).all()


def test_unequal_strokes_of_a_linkage_are_rejected() -> None:
    """GIVEN a four-bar linkage with a stroke difference WHEN it is applied THEN one line says so."""
    vehicle = load_vehicle("slow_hawk")
    sections = vehicle.sections | {"vibration": VibrationSpec(5.0, stroke_difference=0.1)}
    with pytest.raises(InputError, match="stroke_difference"):
        make_unequal(Plant(vehicle), vehicle._replace(sections=sections), 1.0)


def test_current_ripples_by_the_vehicle_file() -> None:
    """GIVEN a vehicle with commutation ripple WHEN it flies at factors of 0 and 2 THEN none, and twice that of the
    file."""
    vehicle = load_vehicle("arizona_100cm")
    ripple = vehicle.sections["vibration"].current_ripple
    assert ripple > 0.0
    for factor in (0.0, 2.0):
        suite = SimulatedWorld(vehicle, Scenario(vibration=factor)).suite
        assert suite.current_ripple.tolist() == [factor * ripple]
