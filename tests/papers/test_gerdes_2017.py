"""Gerdes, Bruck, Gupta 2017: planforms, torque and power of the drives."""

from __future__ import annotations

import numpy as np
import pytest

from sim_bridge.actuators.drives import drive_current
from sim_bridge.validation.gerdes import planform
from sim_bridge.validation.gerdes_servo import EFFICIENCY, motor_current, servo_current, servo_power, steady_power
from sim_bridge.validation.gerdes_tables import WINGS
from sim_bridge.vehicles import load_vehicle

GAP_OF_EQ_1 = {"A": 0.209, "B": 0.079, "C": 0.043, "D": -0.020}
"""Eq. 1 over Table 3, less one: the table's shapes are not all that of Eq. 1, the smaller the wing the less"""


@pytest.mark.parametrize("name", WINGS)
def test_the_chord_of_eq_1_fills_five_sixths_of_its_box(name: str) -> None:
    wing = WINGS[name]
    assert planform(wing) == pytest.approx(5.0 / 6.0 * wing.semispan * wing.chord, rel=1e-3)
    assert wing.semispan * wing.chord == pytest.approx(wing.box, rel=2e-3)


@pytest.mark.parametrize("name", WINGS)
def test_eq_1_against_the_areas_of_table_3(name: str) -> None:
    assert planform(WINGS[name]) / WINGS[name].area - 1.0 == pytest.approx(GAP_OF_EQ_1[name], abs=0.005)


@pytest.mark.parametrize("name", WINGS)
def test_eq_11_gives_the_mean_current_of_table_4_for_the_mean_torque_of_table_7(name: str) -> None:
    drive = load_vehicle("robo_raven_ii_d").drive
    one = drive_current(WINGS[name].torque, drive.torque_constant, drive.torque_offset, drive.idle_current)
    assert 2.0 * one == pytest.approx(WINGS[name].current, rel=0.03)


@pytest.mark.parametrize(("name", "watts"), [("A", 13.5), ("B", 14.9), ("C", 15.3), ("D", 16.6)])
def test_eq_12_with_table_2_for_two_servos_at_8_volts(name: str, watts: float) -> None:
    volts = load_vehicle("robo_raven_ii_d").drive.nominal_voltage
    assert 2.0 * servo_power(WINGS[name].current / 2.0, volts) == pytest.approx(watts, abs=0.05)


def test_eq_12_inverted_gives_its_current_back_up_to_its_greatest_power() -> None:
    currents = np.linspace(0.2, 3.1, 30)
    powers = np.array([servo_power(current, 8.0) for current in currents])
    assert np.all(np.diff(powers) > 0.0)
    assert servo_current(powers, 8.0) == pytest.approx(currents)
    top, beyond, braking, none = servo_current(np.array([11.33, 20.0, -3.0, 0.0]), 8.0)
    assert beyond == pytest.approx(top, abs=0.1) and braking == none > 0.0


def test_eq_12_has_about_the_efficiency_of_tables_4_and_7_at_their_currents() -> None:
    for wing in WINGS.values():
        assert servo_power(0.5 * wing.current, 8.0) / (4.0 * wing.current) == pytest.approx(EFFICIENCY, rel=0.06)


def test_a_motor_draws_what_it_gives_and_its_loss_and_at_its_line_all_its_voltage() -> None:
    drive = load_vehicle("robo_raven_ii_d").drive
    rate = np.array([0.0, 0.5 * drive.no_load_speed, drive.no_load_speed])
    line = drive.stall_torque * (1.0 - rate / drive.no_load_speed)
    full = motor_current(line, rate, drive, 8.0)
    # At full duty the supply's current is the motor's: in proportion to the torque.
    assert full == pytest.approx(line * drive.no_load_speed / 8.0)
    assert motor_current(np.array([-1.0]), np.array([18.0]), drive, 8.0)[0] == 0.0


def test_table_5_asks_more_of_wing_d_than_table_4_lets_it_draw() -> None:
    drawn = {name: 8.0 * wing.current for name, wing in WINGS.items()}
    needed = {name: 2.0 * steady_power(wing, 4.0) for name, wing in WINGS.items()}
    assert needed["D"] > drawn["D"]
    assert all(needed[name] < drawn[name] for name in "ABC")
