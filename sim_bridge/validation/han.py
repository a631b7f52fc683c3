"""Han et al. 2017: coefficients, planform, and who bears a hawkmoth."""

from __future__ import annotations

import math

import numpy as np

from sim_bridge.aerodynamics.quasi_steady import correction_factors, elliptic_strips, force_radius, lift_coefficient
from sim_bridge.flight_mechanics.hawkmoth import CASES, HawkmothCase, hawkmoth_loads, shares
from sim_bridge.validation.insects import moth_rows
from sim_bridge.validation.row import Check, Row, compare, compare_share, figure, unreproducible

WHERE = "Eq. 12, Table 1"
PEAKS = ((0.0, 1.70, 51.0), (1.0, 1.48, 43.0), (-0.25, 2.04, 55.0))
"""advance ratio, largest C_L, its angle of attack in deg"""
SHARES = ((87.2, 12.5, 0.65), (83.0, 7.8, 1.73))
"""% of the lift at 2.9 and 5.0 m/s: translational, rotational, added mass"""
BORNE = 1.974 / 1.995
"""fraction of the moth's weight at 2.9 m/s"""
CHOSEN = "the wing motion is not printed: ours is chosen, and so is what comes of it"
ANGLES = np.radians(np.linspace(0.0, 90.0, 9001))


def coefficient_rows() -> list[Row]:
    """Compare the largest lift coefficients and their angles, the factors of hover, and the planform."""
    rows = []
    for ratio, peak, angle_deg in PEAKS:
        lift = lift_coefficient(ANGLES, ratio)
        at = math.degrees(ANGLES[int(np.argmax(lift))])
        rows.append(compare(figure(WHERE, f"greatest C_L at J = {ratio:g}", "-", peak), float(np.max(lift)), 0.005))
        rows.append(compare(figure(WHERE, f"its angle of attack at J = {ratio:g}", "deg", angle_deg), at, 0.6))
    factors = correction_factors(0.0)
    moments = [
        compare(figure("Table 1", f"{name} at J = 0", "-", a * radius**b + d), value, 0.005)
        for name, (a, b, d), radius, value in (
            ("K_P,D", (-0.182, -2.414, 1.370), 0.567, factors.drag_potential),
            ("K_V,D", (0.765, -1.497, 2.078), 0.567, factors.drag_vortex),
            ("K_P,M", (0.803, -0.972, -0.363), 0.541, factors.moment_potential),
            ("K_V,M", (-0.242, -1.354, -0.554), 0.541, factors.moment_vortex),
        )
    ]
    radius = force_radius(elliptic_strips(0.3, 0.25 / 3.0, 0.2, 200))
    return [
        *rows,
        compare(figure("Table 1", "K_P,L at J = 0", "-", 1.16), factors.lift_potential, 0.005),
        compare(figure("Table 1", "K_V,L at J = 0", "-", 3.54), factors.lift_vortex, 0.005),
        *moments,
        compare_share(figure("2. Methods", "r_2 of the model wing", "-", 0.567), radius, 0.01),
    ]


def hawkmoth_rows() -> list[Row]:
    """Compare the lift contributions of a stroke at both speeds, and the weight fraction."""
    found = [row for case, printed in zip(CASES, SHARES, strict=True) for row in _share_rows(case, printed)]
    slow = shares(hawkmoth_loads(CASES[0]))
    borne = figure("text at Fig. 10", "mean lift over weight at 2.9 m/s", "-", BORNE)
    return [*found, unreproducible(borne, slow.lift, CHOSEN)]


def _share_rows(case: HawkmothCase, printed: tuple[float, float, float]) -> list[Row]:
    found = shares(hawkmoth_loads(case))
    computed = (found.translational, found.rotational, found.added_mass)
    names = ("translational", "rotational", "added-mass")
    return [
        unreproducible(
            figure("Fig. 10", f"{name} share of lift, {case.airspeed:g} m/s", "%", share), 100.0 * own, CHOSEN
        )
        for name, share, own in zip(names, printed, computed, strict=True)
    ]


CHECKS = (
    Check("coefficients and planform", coefficient_rows),
    Check("hawkmoth", hawkmoth_rows, slow=True),
    Check("hawkmoth in free flight", moth_rows, slow=True),
)
