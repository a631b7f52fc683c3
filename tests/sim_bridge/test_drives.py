from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from plant_bench import air, hold_position, rates, vehicle

from sim_bridge import plant_kernel as k
from sim_bridge.actuators.drives import drive_current, servo_torque, torque_bound
from sim_bridge.actuators.linkage import drive as motor_drive
from sim_bridge.actuators.linkage import flap_motion
from sim_bridge.plant import Plant
from sim_bridge.vectors import Floats

STALL, FREE_SPEED = 2.25, 20.5
rate = st.floats(-40.0, 40.0)


@given(st.floats(-3.0, 3.0), st.floats(-50.0, 50.0), rate)
def test_a_servo_stays_within_the_torque_speed_line(error: float, rate_error: float, speed: float) -> None:
    torque = servo_torque(error, rate_error, speed, (6.1, 0.38), STALL, FREE_SPEED)
    assert abs(torque) <= STALL
    driving = torque * speed > 0.0
    assert not driving or abs(torque) <= STALL * max(1.0 - abs(speed) / FREE_SPEED, 0.0) + 1e-12


def test_the_line_braking_and_beyond_no_load_speed() -> None:
    assert torque_bound(0.0, 1.0, STALL, FREE_SPEED) == STALL
    assert torque_bound(FREE_SPEED / 2, 1.0, STALL, FREE_SPEED) == pytest.approx(STALL / 2)
    assert torque_bound(25.0, 1.0, STALL, FREE_SPEED) == 0.0
    assert torque_bound(-10.0, 1.0, STALL, FREE_SPEED) == STALL
    assert servo_torque(-1.0, 0.0, 15.0, (6.1, 0.38), STALL, FREE_SPEED) == -STALL


def test_a_small_error_meets_the_gains() -> None:
    assert servo_torque(0.05, -0.2, 1.0, (6.1, 0.38), STALL, FREE_SPEED) == pytest.approx(6.1 * 0.05 - 0.38 * 0.2)


@given(st.floats(0.4, 3.0), st.floats(0.4, 3.0))
def test_both_currents_together_invert_the_torque_line(left: float, right: float) -> None:
    current = drive_current(left, 0.249, 0.346, 0.0) + drive_current(-right, 0.249, 0.346, 0.0)
    assert 0.249 * current + 0.346 == pytest.approx((left + right) / 2)


def test_the_current_never_falls_below_idle() -> None:
    assert drive_current(0.0, 0.249, 0.346, 0.12) == 0.12
    assert drive_current(-0.36, 0.249, 0.346, 0.12) == 0.12


def _stuck(charge: float) -> Plant:
    plant = Plant(vehicle("robo_raven_ii_d"))
    y = np.zeros_like(plant.y)
    y[2], y[3], y[plant.layout.charge] = -100.0, 1.0, charge
    # Every servo stands 0.3 rad away from where it is wanted: a known torque within its bound.
    rates(plant, y, hold_position(0.3), air(launcher=k.HELD))
    return plant


def test_the_battery_sags_with_current_and_with_charge() -> None:
    full, half = _stuck(0.0), _stuck(0.5 * 2664.0)
    for plant, open_circuit in ((full, 8.4), (half, 7.8)):
        left, right, current, voltage = plant.scratch.drive
        assert left == right == pytest.approx(6.1 * 0.3)
        assert current == pytest.approx(2.0 * (left - 0.346) / (2.0 * 0.249))
        assert voltage == pytest.approx(open_circuit - 0.06 * current)


def test_a_lower_voltage_lowers_the_torque_bound() -> None:
    torques = []
    voltages = []
    for drawn in (0.0, 2664.0):
        plant = Plant(vehicle("robo_raven_ii_d"))
        y = np.zeros_like(plant.y)
        y[2], y[3], y[plant.layout.charge] = -100.0, 1.0, drawn
        rates(plant, y, hold_position(1.0), air(launcher=k.HELD))
        torques.append(float(plant.scratch.drive[0]))
        voltages.append(float(plant.scratch.drive[3]))
    # A few rounds of sag: the torque belongs to the voltage to a thousandth.
    assert torques == pytest.approx([2.25 * volts / 8.0 for volts in voltages], rel=2e-3)
    assert torques[1] < 0.9 * torques[0]


def test_slack_drives_give_no_torque_and_no_more_than_the_idle_current() -> None:
    plant = Plant(vehicle("robo_raven_ii_d"))
    rates(plant, plant.y.copy(), hold_position(1.0, powered=0.0), air())
    assert plant.scratch.drive[:3] == pytest.approx([0.0, 0.0, 0.24])


@pytest.mark.parametrize("wind", [(-4.0, 0.0, 1.5), (2.0, 3.0, -1.5)])
def test_a_crank_at_closed_throttle_draws_only_the_idle_current(wind: tuple[float, float, float]) -> None:
    """GIVEN a motor's controller that conducts nothing THEN wind on the wings it holds costs no current."""
    plant = Plant(vehicle("arizona_100cm"))
    loaded = []
    for _ in range(100):
        means = plant.advance(hold_position(duration=0.005), air(launcher=k.HELD, wind=wind))
        loaded.append(abs(means.torque_left))
        assert means.current == pytest.approx(0.4)
    # With the throttle open the same torque would draw more.
    assert drive_current(max(loaded), 0.16, -0.02, 0.2) > 0.2
    plant.advance(hold_position(duration=0.005)._replace(throttle=0.01), air(launcher=k.HELD, wind=wind))
    assert plant.scratch.drive[k.CURRENT] > 0.4


def test_a_servo_draws_its_load_only_while_it_is_armed() -> None:
    """GIVEN wings that wind presses up THEN a disarmed servo holds them too, at its idle current."""
    currents = []
    for conducting in (1.0, 0.0):
        plant, wind = Plant(vehicle("robo_raven_ii_d")), (-8.0, 0.0, -8.0)
        command = hold_position(duration=0.005)._replace(conducting=conducting)
        for _ in range(100):
            means = plant.advance(command, air(launcher=k.HELD, wind=wind))
        currents.append(means.current)
    assert currents[0] > 0.5
    assert currents[1] == pytest.approx(0.24)


def test_a_crank_runs_up_to_the_frequency_of_its_throttle() -> None:
    plant = Plant(vehicle("arizona_100cm"))
    command = hold_position(duration=0.05)._replace(throttle=0.5)
    for _ in range(60):
        plant.advance(command, air(launcher=k.HELD))
    assert plant.y[plant.layout.crank_speed] == pytest.approx(4.75, rel=1e-6)
    angles = []
    for _ in range(200):
        plant.advance(command._replace(duration=0.002), air(launcher=k.HELD))
        angles.append(plant.y[plant.layout.flap[0]])
    assert np.ptp(angles) / 2 == pytest.approx(0.6, rel=0.1)


def test_a_crank_has_its_wings_where_it_wants_them_when_it_is_switched_on() -> None:
    """The wings sag by their weight; beside the crank's place they would be thrown there with 16 A."""
    plant = Plant(vehicle("arizona_100cm"))
    currents = [plant.advance(hold_position(duration=0.005), air(launcher=k.HELD)).current for _ in range(100)]
    assert max(currents) < 2.0
    assert plant.y[plant.layout.flap[0]] == pytest.approx(0.1, abs=0.01)


def flapped(frequency: float, amplitude: float, airspeed: float) -> tuple[Floats, Floats]:
    """Achieved and commanded flap rate over the third stroke of a wing held in the wind."""
    plant = Plant(vehicle("robo_raven_ii_d"))
    pieces, around = 400, air(launcher=k.HELD, wind=(-airspeed, 0.0, 0.0))
    dt, rows, rate = 1.0 / frequency / pieces, [], plant.layout.rate(plant.layout.flap[0])
    for i in range(3 * pieces):
        start, end = (amplitude * math.sin(2.0 * math.pi * j / pieces) for j in (i, i + 1))
        plant.advance(
            hold_position(duration=dt)._replace(left_start=start, left_end=end, right_start=start, right_end=end),
            around,
        )
        phase = 2.0 * math.pi * (i + 1) / pieces
        rows.append((plant.y[rate], 2.0 * math.pi * frequency * amplitude * math.cos(phase)))
    table = np.array(rows[2 * pieces :])
    return table[:, 0], table[:, 1]


def _fundamental(signal: Floats) -> complex:
    return complex(np.fft.rfft(signal)[1] * 2.0 / signal.shape[0])


@pytest.mark.parametrize("airspeed", [0.0, 7.75])
def test_a_slow_stroke_is_followed(airspeed: float) -> None:
    """Gerdes Fig. 10: at 1 Hz the commanded and the achieved rate of wing D cannot be told apart."""
    achieved, commanded = flapped(1.0, 0.796, airspeed)
    assert np.max(achieved) == pytest.approx(np.max(commanded), rel=0.05)
    assert abs(_fundamental(achieved)) == pytest.approx(abs(_fundamental(commanded)), rel=0.05)
    assert np.sqrt(np.mean((achieved - commanded) ** 2) / np.mean(commanded**2)) < 0.2


@pytest.mark.parametrize("airspeed", [0.0, 7.75])
def test_a_fast_stroke_is_limited_by_the_drive(airspeed: float) -> None:
    """Gerdes Fig. 10: at 4 Hz the wing falls far behind the commanded 20 rad/s."""
    achieved, commanded = flapped(4.0, 0.796, airspeed)
    assert np.max(commanded) == pytest.approx(20.0, rel=0.01)
    assert 0.3 * 20.0 < np.max(np.abs(achieved)) < 0.75 * 20.0


def _hawk(phase: float, frequency: float) -> Plant:
    """The Slow Hawk in flight, its crank at a ``phase`` in rad, its wings where the rods bend."""
    plant = Plant(vehicle("slow_hawk"))
    y, layout = np.zeros_like(plant.y), plant.layout
    y[2], y[3], y[7], y[layout.crank_phase], y[layout.crank_speed] = -100.0, 1.0, 9.2, phase, frequency
    flap = flap_motion(plant.parameters.linkage, phase)
    for at, astray in zip(layout.flap, (0.01, -0.02), strict=True):
        y[at], y[layout.rate(at)] = flap.angle + astray, flap.slope * 2.0 * math.pi * frequency + 3.0 * astray
    plant.y[:] = y
    return plant


@pytest.mark.parametrize("phase", [0.3, 2.0, 4.1, 5.5])
def test_what_the_motor_gives_the_crank_is_the_rotors_and_the_rods(phase: float) -> None:
    plant = _hawk(phase, 5.9)
    motor, drive, layout = plant.parameters.motor, plant.scratch.drive, plant.layout
    found = plant.evaluate(hold_position()._replace(throttle=0.8), air())
    omega = 2.0 * math.pi * plant.y[layout.crank_speed]
    inertia = motor.rotor_inertia * motor.gear_ratio**2
    rotor = inertia * omega * 2.0 * math.pi * found[layout.crank_speed]
    slope = flap_motion(plant.parameters.linkage, phase).slope
    rods = float(drive[k.TORQUE_LEFT] + drive[k.TORQUE_RIGHT]) * slope * omega
    current = float(drive[k.CURRENT]) / 0.8
    given = motor_drive(motor, motor.resistance * current + motor.torque_constant * motor.gear_ratio * omega, omega)
    assert given.current == pytest.approx(current) and current > 1.0
    assert abs(rods) > 0.5
    assert given.torque * omega == pytest.approx(rotor + rods, rel=1e-9)


def test_a_loaded_crank_slows_in_each_half_stroke() -> None:
    """Twice a turn: the rods pass the load on, which a prescribed frequency would not."""
    plant = _hawk(0.0, 5.9)
    controls, around = [hold_position(duration=0.001)._replace(throttle=0.8)] * 1500, air(launcher=k.HELD)
    rows, _ = plant.follow(controls, around)
    phase, speed = rows[:, plant.layout.crank_phase], rows[:, plant.layout.crank_speed]
    turns = phase[-1] - 4.0 * math.pi + np.linspace(0.0, 4.0 * math.pi, 256, endpoint=False)
    harmonics = np.abs(np.fft.rfft(np.interp(turns, phase, speed)))
    assert harmonics[4] > 0.01 * harmonics[0]
    assert harmonics[4] > harmonics[[1, 3, 5]].max()
