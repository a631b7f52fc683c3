"""The kernels of the plant in parts that several processes compile at the same time into the shared cache."""

from __future__ import annotations

from collections.abc import Sequence

from sim_bridge import plant_kernel as k
from sim_bridge.compiled import Bound, compile_for_callers
from sim_bridge.plant import STEP, Plant

PARTS: dict[str, Sequence[str]] = {
    "motion of bodies and wings": ("_set_motion", "advance_memory"),
    "air loads": ("_set_loads",),
    "equations of motion": ("_accelerate",),
    "sums of loads": ("_act",),
}
"""kernels of `plant_kernel` by the name of their part, the longest first; `Plant.compile` compiles the rest"""


def compile_part(plant: Plant, name: str) -> None:
    """Compile the kernels of one of `PARTS`, or load them from the cache."""
    bound, y = Bound((plant.parameters, plant.scratch)), plant.y
    controls = k.Controls(0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, STEP, 0.0)
    around = k.Surroundings(0.0, 0.0, 0.0, 1.225, k.HELD, 0.0, 0.0, 0.0)
    arguments: dict[str, tuple[object, ...]] = {
        "_set_motion": (y, around, bound),
        "advance_memory": (y, STEP, around, bound),
        "_set_loads": (y, around.density, bound),
        "_accelerate": (y, STEP, controls, around, bound),
        "_act": (around.density, bound),
    }
    for kernel in PARTS[name]:
        compile_for_callers(getattr(k, kernel), *arguments[kernel])
