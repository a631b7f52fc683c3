"""Gerdes, Bruck, Gupta 2017: planforms, torque and power of the drives."""

from __future__ import annotations

import pytest

from sim_bridge.actuators.drives import drive_current
from sim_bridge.validation.gerdes import planform, servo_power
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
