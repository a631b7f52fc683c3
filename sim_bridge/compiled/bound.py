"""Arguments of kernels that are unpacked once, and kernels called by address; see `mode` for the two versions."""

from __future__ import annotations

from typing import TYPE_CHECKING

from sim_bridge.compiled.mode import PLAIN

if TYPE_CHECKING or not PLAIN:
    from sim_bridge.compiled.far_calls import call_far, far_kernel, run_far
    from sim_bridge.compiled.packed_bound import Bound, bound_values
else:
    from sim_bridge.compiled.plain_bound import Bound, bound_values, call_far, far_kernel, run_far

__all__ = ["Bound", "bound_values", "call_far", "far_kernel", "run_far"]
