"""The vortex lattice beside theory, XFLR5 and the measured lift of a flapping wing: rows of `wingbeat validate`."""

from __future__ import annotations

import numpy as np

from sim_bridge.validation.hawkmoth_lattice import hawkmoth_rows
from sim_bridge.validation.hawkmoth_refined import refined_rows
from sim_bridge.validation.row import Check, Row, Study, compare, compare_share, figure
from sim_bridge.validation.straight_wing import GRIDS, orders, straight_wing
from sim_bridge.validation.thin_aerofoil import heaving, pitching, started, wagner
from sim_bridge.validation.yeo_lattice import lattice_rows

WITHIN = 0.02
HALF_CHORDS = (1, 2, 5, 10, 20)
FREQUENCIES = (0.1, 0.3, 0.6, 1.0)
"""-; reduced"""
FIRST_ORDER, ORDER_WITHIN = 1.0, 0.3
SETTLED = 0.005
"""-; relative change of a coefficient that the last refinement may cause"""
NEAR = "of the forces on the panels; XFLR5's is that of the wake far behind"
ALONG_WIND = "likewise, with the wake along the wind, where XFLR5 has it along the body's axis"


def steady_rows() -> list[Row]:
    """Compare the wing of NACA 2412 in steady flow."""
    computed, where = straight_wing(), "XFLR5, VLM2"
    drag = 0.0193291
    return [
        compare_share(figure(where, "lift coefficient", "-", 0.783705), computed.lift, WITHIN),
        compare_share(figure(where, "induced drag coefficient, far wake", "-", drag), computed.far_drag, WITHIN),
        compare_share(
            figure(where, "induced drag coefficient, near field", "-", drag), computed.near_drag, WITHIN, NEAR
        ),
        compare_share(
            figure(where, "induced drag coefficient, near field, wake along the wind", "-", drag),
            straight_wing(along_wind=True).near_drag,
            WITHIN,
            ALONG_WIND,
        ),
        compare_share(figure(where, "pitching moment coefficient", "-", -0.677641), computed.pitch_moment, WITHIN),
    ]


def convergence_rows() -> list[Row]:
    """Compare three grids: convergence order of the drags, change of lift and moment by the last refinement."""
    where = ", ".join(f"{columns} x {rows}" for columns, rows in GRIDS) + " panels"
    order, (_, middle, fine) = orders(), [straight_wing(*grid) for grid in GRIDS]
    rows = [
        compare(
            figure(where, f"order of convergence, induced drag, {name}", "-", FIRST_ORDER), computed, ORDER_WITHIN
        )
        for name, computed in (("far wake", order.far_drag), ("near field", order.near_drag))
    ]
    for name, one, other in (
        ("lift", middle.lift, fine.lift),
        ("pitching moment", middle.pitch_moment, fine.pitch_moment),
    ):
        told = figure(where, f"{name} coefficient, change at the last refinement", "-", 0.0)
        rows.append(compare(told, other - one, SETTLED * abs(other)))
    return rows


def start_rows() -> list[Row]:
    """Compare an airfoil that starts impulsively."""
    s, lift = started(half_chords=float(HALF_CHORDS[-1]))
    return [
        compare_share(
            figure(
                "Wagner",
                f"lift over its final value after {half} half chords",
                "-",
                float(wagner(np.array([half]))[0]),
            ),
            float(np.interp(half, s, lift)),
            WITHIN,
        )
        for half in HALF_CHORDS
    ]


def oscillation_rows() -> list[Row]:
    """Compare an airfoil in heave and pitch: complex difference over the magnitude of the theory."""
    rows = []
    for name, motion in (("heave", heaving), ("pitch", pitching)):
        for k in FREQUENCIES:
            error = figure("Theodorsen", f"lift in {name} at k = {k:g}, error of the complex amplitude", "-", 0.0)
            rows.append(compare(error, motion(k).error, WITHIN))
    return rows


CHECKS = (
    Check("a straight wing in steady flow", steady_rows),
    Check("the straight wing on finer grids", convergence_rows),
    Check("an impulsive start", start_rows),
    Check("heave and pitch", oscillation_rows, slow=True),
    Check("lift over a stroke (Yeo, Atkins, Shyy 2011)", lattice_rows, slow=True),
    Check("a hawkmoth's stroke beside the quasi-steady model", hawkmoth_rows, slow=True),
)
STUDIES = (Study("the hawkmoth's stroke on finer lattices and with other wakes", refined_rows),)
