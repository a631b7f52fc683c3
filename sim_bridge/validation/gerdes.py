"""Gerdes, Bruck, Gupta 2017: planforms, current and power of Robo Raven II's drives."""

from __future__ import annotations

from sim_bridge.actuators.drives import drive_current
from sim_bridge.mechanism import wing_strips
from sim_bridge.validation import gerdes_wings
from sim_bridge.validation.gerdes_tables import WINGS, WingFigures
from sim_bridge.validation.row import Check, Row, Study, compare_share, figure, fitted
from sim_bridge.vehicles import load_vehicle

VEHICLE = "robo_raven_ii_d"
SHAPES = "the table's shapes are not all that of Eq. 1, the smaller the wing the less"


def planform(wing: WingFigures) -> float:
    """m^2; of one wing with the chord of Eq. 1."""
    shape = load_vehicle(VEHICLE).wing._replace(semispan=wing.semispan, root_chord=wing.chord)
    strips, _ = wing_strips(shape)
    return 0.5 * float(strips.chord @ strips.width)


def servo_power(current: float, voltage: float) -> float:
    """Output power in W of one servo at a current in A and a voltage in V: Eq. 12, bracket closed, Table 2."""
    i, v = current - 0.936, voltage - 6.877
    return -4.688 + 4.646 * current + 0.677 * voltage + 0.919 * i * v - 1.270 * i * i - 0.070 * v * v


def planform_rows() -> list[Row]:
    """Areas of the four wings by Eq. 1, and their boxes."""
    rows = []
    for name, wing in WINGS.items():
        area = figure("Table 3", f"area of wing {name} by Eq. 1", "m^2", wing.area)
        rows.append(compare_share(area, planform(wing), 0.05, SHAPES if name in "AB" else ""))
    for name, wing in WINGS.items():
        box = figure("Table 5", f"box of wing {name}, span times chord", "m^2", wing.box)
        rows.append(compare_share(box, wing.semispan * wing.chord, 0.002))
    return rows


def drive_rows() -> list[Row]:
    """Power of two servos by Eq. 12 at 8.0 V, and the current that Eq. 11 asks for."""
    drive = load_vehicle(VEHICLE).drive
    rows = []
    for name, wing in WINGS.items():
        power = figure("Eq. 12, Table 7", f"power, wing {name}, Table 4's current", "W", wing.power)
        ours = 2.0 * servo_power(0.5 * wing.current, drive.nominal_voltage)
        rows.append(fitted(power, ours, "8.0 V, which is not printed, was chosen for these figures"))
    for name, wing in WINGS.items():
        one = drive_current(wing.torque, drive.torque_constant, drive.torque_offset, drive.idle_current)
        current = figure("Eq. 11, Table 4", f"current, wing {name}, Table 7's torque", "A", wing.current)
        rows.append(fitted(current, 2.0 * one, "K_tau is not printed: it is the slope of these very figures"))
    return rows


CHECKS = (
    Check("planforms", planform_rows),
    Check("drives", drive_rows),
    Check("wings in a wind tunnel", gerdes_wings.rows, slow=True),
)
STUDIES = (Study("each wing left out of the fit that it is flown with", gerdes_wings.left_out_rows),)
