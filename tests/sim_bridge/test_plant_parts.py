"""The parts in which the plant is compiled are those that its integrator calls."""

from __future__ import annotations

from typing import Any

import pytest

from sim_bridge import plant_kernel
from sim_bridge.compiled import PLAIN
from sim_bridge.plant import Plant
from sim_bridge.plant_parts import PARTS, compile_part
from sim_bridge.vehicles import load_vehicle


@pytest.mark.skipif(PLAIN, reason="public numba has no parts")
def test_parts_are_compiled_for_the_types_of_the_integrator() -> None:
    """A part of other types would stand in the cache beside the one that the integrator compiled for itself."""
    plant = Plant(load_vehicle("robo_raven_ii_d"))
    plant.compile()
    for name in PARTS:
        compile_part(plant, name)
    for kernels in PARTS.values():
        for kernel in kernels:
            dispatcher: Any = getattr(plant_kernel, kernel)
            assert len(dispatcher._callee_cache._cache_file._load_index()) == 1, kernel
