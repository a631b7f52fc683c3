"""Gerdes, Bruck, Gupta 2017: planforms, current and power of Robo Raven II's drives."""

from __future__ import annotations

import math

import numpy as np

from sim_bridge.actuators.drives import drive_current
from sim_bridge.aerodynamics.surfaces import SEPARATED_NORMAL_FORCE
from sim_bridge.flight_mechanics.wind_tunnel import DENSITY
from sim_bridge.mechanism import wing_strips
from sim_bridge.validation import gerdes_flight, gerdes_wings
from sim_bridge.validation.gerdes_servo import servo_power, steady_power
from sim_bridge.validation.gerdes_tables import WINGS, WingFigures
from sim_bridge.validation.row import Check, Row, Study, compare, compare_share, figure, fitted, unreproducible
from sim_bridge.vehicles import load_vehicle

VEHICLE = "robo_raven_ii_d"
SHAPES = "the table's shapes are not all that of Eq. 1, the smaller the wing the less"
PLATE = "a rigid plate across still air, 1.98 (Hoerner), at Table 6's steady speed: nothing fitted"
MISPRINT = "the printed overshoot gives 0.892 by the printed formula"
CONTRADICTION = (
    "wing D would give more than the 26.1 W it draws by Table 4 at 8.0 V: no electrical model joins Tables 4, 5 and 7"
)


def planform(wing: WingFigures) -> float:
    """Compute the area in m^2 of one wing with the chord of Eq. 1."""
    shape = load_vehicle(VEHICLE).wing._replace(semispan=wing.semispan, root_chord=wing.chord)
    strips, _ = wing_strips(shape)
    return 0.5 * float(strips.chord @ strips.width)


def planform_rows() -> list[Row]:
    """Compare the areas of the four wings by Eq. 1, and their boxes."""
    rows = []
    for name, wing in WINGS.items():
        area = figure("Table 3", f"area of wing {name} by Eq. 1", "m^2", wing.area)
        rows.append(compare_share(area, planform(wing), 0.05, SHAPES if name in "AB" else ""))
    for name, wing in WINGS.items():
        box = figure("Table 5", f"box of wing {name}, span times chord", "m^2", wing.box)
        rows.append(compare_share(box, wing.semispan * wing.chord, 0.002))
    return rows


def drive_rows() -> list[Row]:
    """Compare the power of two servos by Eq. 12 at 8.0 V, the current of Eq. 11, and the power of Table 5."""
    drive = load_vehicle(VEHICLE).drive
    rows = []
    for name, wing in WINGS.items():
        power = figure("Eq. 12, Table 7", f"power, wing {name}, Table 4's current", "W", wing.power)
        computed = 2.0 * servo_power(0.5 * wing.current, drive.nominal_voltage)
        rows.append(fitted(power, computed, "8.0 V, which is not printed, was chosen for these figures"))
    for name, wing in WINGS.items():
        one = drive_current(wing.torque, drive.torque_constant, drive.torque_offset, drive.idle_current)
        current = figure("Eq. 11, Table 4", f"current, wing {name}, Table 7's torque", "A", wing.current)
        rows.append(fitted(current, 2.0 * one, "K_tau is not printed: it is the slope of these very figures"))
    for name, wing in WINGS.items():
        power = figure(
            "Table 5, 7", f"least power, wing {name}, Table 5's torque at Table 4's stroke", "W", wing.power
        )
        rows.append(unreproducible(power, 2.0 * steady_power(wing, gerdes_wings.FLAPPING), CONTRADICTION))
    return rows


def twist_damping(overshoot: float) -> float:
    """Compute the damping ratio of a relative ``overshoot`` by Eq. 17."""
    logarithm = math.log(overshoot)
    return abs(logarithm) / math.hypot(math.pi, logarithm)


def plate_torque_constant(wing: WingFigures) -> float:
    """Compute torque over steady plunge speed in N m s/rad of one flat wing that turns across still air.

    Normal force of a plate across the flow (Hoerner), at the steady speed of Table 6, chord of Eq. 1.
    """
    shape = load_vehicle(VEHICLE).wing._replace(semispan=wing.semispan, root_chord=wing.chord)
    strips, _ = wing_strips(shape)
    arm = 0.5 * float(np.sum(strips.chord * strips.width * strips.span**3))
    return 0.5 * SEPARATED_NORMAL_FORCE * DENSITY * arm * wing.steady_speed


def bench_rows() -> list[Row]:
    """Compare Table 5's torque constants with a plate across still air, and Table 6 with its Eq. 17."""
    torques = [
        compare_share(
            figure("Table 5", f"torque constant of wing {name}", "N m s/rad", wing.torque_constant),
            plate_torque_constant(wing),
            0.15,
            PLATE,
        )
        for name, wing in WINGS.items()
    ]
    return [
        *torques,
        *(
            compare(
                figure("Table 6", f"damping ratio of wing {name} by Eq. 17", "-", wing.damping_ratio),
                twist_damping(wing.overshoot),
                0.01,
                "" if name in "BCD" else MISPRINT,
            )
            for name, wing in WINGS.items()
        ),
    ]


CHECKS = (
    Check("planforms", planform_rows),
    Check("torque constants and damping ratios", bench_rows),
    Check("drives", drive_rows),
    Check("wings in a wind tunnel", gerdes_wings.rows, slow=True),
    Check("balances of the flights", gerdes_flight.balance_rows),
    Check("one set in the stream", gerdes_flight.bench_set_rows, slow=True),
    Check("trims at Table 4", gerdes_flight.flight_rows, slow=True),
)
STUDIES = (Study("each wing left out of the fit that it is flown with", gerdes_wings.left_out_rows),)
