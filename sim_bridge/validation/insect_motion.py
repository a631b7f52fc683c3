"""Published wing motion of a dragonfly and a fruit fly through three models; their mean force is their weight.

Wings, motion and settings: ``data/insects``. The weight is the only force that is known; the attitude of the
dragonfly's stroke planes is taken to the horizontal.
"""

from __future__ import annotations

import math
from pathlib import Path

from sim_bridge.flight_mechanics.recorded_motion import load_motion
from sim_bridge.flight_mechanics.similarity import WORDS
from sim_bridge.flight_mechanics.tunnel import AirStream, TunnelForces, load_wings, tunnel_forces
from sim_bridge.validation.row import Check, Row, compare_share, figure

FOLDER = Path(__file__).parent / "data" / "insects"
MODELS = ("quasi_steady", "blade_element", "strip_theory")
CLIMB = math.radians(60.0)
"""rad; flight path of the dragonfly"""
DRAGONFLY, FRUIT_FLY = AirStream(0.54, 0.54 * math.sin(CLIMB)), AirStream(0.0)
LIFT = 0.25
"""-; limit of the mean lift: chosen, force balance with amplitudes of a few degrees' error"""


def insect_forces(name: str, model: str, stream: AirStream) -> TunnelForces:
    """Compute the forces of an insect of ``data/insects`` by a model."""
    wings = load_wings(FOLDER / f"{name}_wings.toml")
    return tunnel_forces(wings, load_motion(FOLDER / f"{name}_motion.toml", list(wings.wings)), model, stream)


def lift_rows(name: str, where: str, stream: AirStream) -> list[Row]:
    """Compare the mean lift by three models with the weight."""
    weight = float(load_motion(FOLDER / f"{name}_motion.toml", ()).measured["lift"][0])
    rows = []
    for model in MODELS:
        forces = insect_forces(name, model, stream)
        thrust = float(forces.thrust.mean()) / weight
        outside = ", ".join(WORDS[one.quantity] for one in forces.excesses)
        why = f"outside the model's range: {outside}" if outside else "inside the model's range"
        if abs(thrust) > 0.05:
            why += f"; thrust of {thrust:.2f} weights, which steady flight does not have"
        lift = figure(where, f"mean lift over weight, {model}", "-", 1.0)
        rows.append(compare_share(lift, float(forces.lift.mean()) / weight, LIFT, why))
    return rows


DRAGONFLY_CHECKS = (
    Check("slow climb", lambda: lift_rows("dragonfly", "observed motion, weight", DRAGONFLY), slow=True),
)
FRUIT_FLY_CHECKS = (Check("hover", lambda: lift_rows("fruit_fly", "harmonic motion, weight", FRUIT_FLY), slow=True),)
