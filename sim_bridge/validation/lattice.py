"""The vortex lattice beside theory, XFLR5 and the measured lift of a flapping wing: rows of `wingbeat validate`."""

from __future__ import annotations

import numpy as np

from sim_bridge.validation.hawkmoth_lattice import hawkmoth_rows
from sim_bridge.validation.row import Check, Row, compare, compare_share, figure
from sim_bridge.validation.straight_wing import straight_wing
from sim_bridge.validation.thin_aerofoil import heaving, pitching, started, wagner
from sim_bridge.validation.yeo_lattice import lattice_rows

WITHIN = 0.02
HALF_CHORDS = (1, 2, 5, 10, 20)
FREQUENCIES = (0.1, 0.3, 0.6, 1.0)
"""-; reduced"""
ROUNDED = "printed to three decimals: 0.0185 to 0.0195; our lattice goes to 0.0200 with finer panels"


def steady_rows() -> list[Row]:
    """The wing of NACA 2412 in steady flow."""
    ours, where = straight_wing(), "XFLR5, VLM2"
    return [
        compare_share(figure(where, "lift coefficient", "-", 0.784), ours.lift, WITHIN),
        compare_share(
            figure(where, "induced drag coefficient", "-", 0.0185, 0.0195), ours.induced_drag, WITHIN, ROUNDED
        ),
        compare_share(figure(where, "pitching moment coefficient", "-", -0.678), ours.pitch_moment, WITHIN),
    ]


def start_rows() -> list[Row]:
    """An aerofoil set off at once."""
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
    """An aerofoil that heaves and pitches: size and phase in one, difference over the theory's magnitude."""
    rows = []
    for name, motion in (("heave", heaving), ("pitch", pitching)):
        for k in FREQUENCIES:
            error = figure("Theodorsen", f"lift in {name} at k = {k:g}, error of the complex amplitude", "-", 0.0)
            rows.append(compare(error, motion(k).error, WITHIN))
    return rows


CHECKS = (
    Check("a straight wing in steady flow", steady_rows),
    Check("an impulsive start", start_rows),
    Check("heave and pitch", oscillation_rows, slow=True),
    Check("lift over a stroke (Yeo, Atkins, Shyy 2011)", lattice_rows, slow=True),
    Check("a hawkmoth's stroke beside the quasi-steady model", hawkmoth_rows, slow=True),
)
