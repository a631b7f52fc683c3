"""Compilation of the physics: all that depends on the inside of numba; README.md explains it."""

from sim_bridge.compiled.arrays import clear
from sim_bridge.compiled.bound import Bound, bound_values, call_far, far_kernel, run_far
from sim_bridge.compiled.cache import is_compiled
from sim_bridge.compiled.decorators import (
    compile_for_callers,
    inlined,
    inlined_internal,
    internal,
    kernel,
    njit,
    noalias,
    nogil_kernel,
)
from sim_bridge.compiled.events import on_compilation
from sim_bridge.compiled.mode import PLAIN

__all__ = [
    "PLAIN",
    "Bound",
    "bound_values",
    "call_far",
    "clear",
    "compile_for_callers",
    "far_kernel",
    "inlined",
    "inlined_internal",
    "internal",
    "is_compiled",
    "kernel",
    "njit",
    "noalias",
    "nogil_kernel",
    "on_compilation",
    "run_far",
]
