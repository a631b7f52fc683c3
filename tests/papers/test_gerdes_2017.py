"""Gerdes, Bruck, Gupta 2017: planforms, torque and power of the drives."""

from __future__ import annotations

import pytest

from sim_bridge.actuators.drives import drive_current
from sim_bridge.mechanism import wing_strips
from sim_bridge.vehicles import load_vehicle

TABLE_3 = {
    "A": (0.527, 0.311, 0.113),
    "B": (0.622, 0.356, 0.171),
    "C": (0.667, 0.394, 0.210),
    "D": (0.762, 0.432, 0.280),
}
"""semispan m, greatest chord m, printed area m^2"""
TABLE_4_CURRENT = {"A": 2.54, "B": 2.85, "C": 2.93, "D": 3.26}
"""A; mean"""
TABLE_5_AREA = {"A": 0.1640, "B": 0.2213, "C": 0.2625, "D": 0.3290}
"""m^2"""
TABLE_7_TORQUE = {"A": 0.99, "B": 1.05, "C": 1.06, "D": 1.17}
"""N m; mean, flight testing"""
GAP_OF_EQ_1 = {"A": 0.209, "B": 0.079, "C": 0.043, "D": -0.020}
"""Eq. 1 over Table 3, less one: the table's shapes are not all that of Eq. 1, the smaller the wing the less"""


def planform(wing: str) -> float:
    semispan, chord, _ = TABLE_3[wing]
    shape = load_vehicle("robo_raven_ii_d").wing._replace(semispan=semispan, root_chord=chord)
    strips, _ = wing_strips(shape)
    return 0.5 * float(strips.chord @ strips.width)


@pytest.mark.parametrize("wing", TABLE_3)
def test_the_chord_of_eq_1_fills_five_sixths_of_its_box(wing: str) -> None:
    semispan, chord, _ = TABLE_3[wing]
    assert planform(wing) == pytest.approx(5.0 / 6.0 * semispan * chord, rel=1e-3)
    assert semispan * chord == pytest.approx(TABLE_5_AREA[wing], rel=2e-3)


@pytest.mark.parametrize("wing", TABLE_3)
def test_eq_1_against_the_areas_of_table_3(wing: str) -> None:
    assert planform(wing) / TABLE_3[wing][2] - 1.0 == pytest.approx(GAP_OF_EQ_1[wing], abs=0.005)


@pytest.mark.parametrize("wing", TABLE_3)
def test_eq_11_gives_the_mean_current_of_table_4_for_the_mean_torque_of_table_7(wing: str) -> None:
    drive = load_vehicle("robo_raven_ii_d").drive
    one = drive_current(TABLE_7_TORQUE[wing], drive.torque_constant, drive.torque_offset, drive.idle_current)
    assert 2.0 * one == pytest.approx(TABLE_4_CURRENT[wing], rel=0.03)


def power(current: float, voltage: float) -> float:
    """Output power in W of one servo, Gerdes Eq. 12 (its bracket closed) with Table 2."""
    i, v = current - 0.936, voltage - 6.877
    return -4.688 + 4.646 * current + 0.677 * voltage + 0.919 * i * v - 1.270 * i * i - 0.070 * v * v


@pytest.mark.parametrize(("wing", "watts"), [("A", 13.5), ("B", 14.9), ("C", 15.3), ("D", 16.6)])
def test_eq_12_with_table_2_for_two_servos_at_8_volts(wing: str, watts: float) -> None:
    volts = load_vehicle("robo_raven_ii_d").drive.nominal_voltage
    assert 2.0 * power(TABLE_4_CURRENT[wing] / 2.0, volts) == pytest.approx(watts, abs=0.05)
