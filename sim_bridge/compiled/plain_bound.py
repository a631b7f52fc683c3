"""`bound` and calls by address with numba's public interface alone, and without compilation."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, NamedTuple

from numba import objmode

from sim_bridge.compiled.decorators import njit

Far = Callable[[Any, Any, float], None]
_bounds: dict[int, Bound] = {}
_functions: dict[int, Far] = {}


class Bound(NamedTuple):
    """A named tuple around the arguments, which numba unpacks at every call."""

    values: Any

    @property
    def address(self) -> int:
        """Key by which `call_far` finds it; it is then kept for the rest of the process."""
        _bounds[id(self.values)] = self
        return id(self.values)


@njit
def bound_values(bound: Bound) -> Any:
    """In a kernel: the arguments of a `Bound`."""
    return bound.values


def far_kernel(function: Far, parameters: Bound, values: Bound) -> int:
    """Return the key of ``function``, compiled on its own, for `call_far`."""
    if id(function) not in _functions:
        _functions[id(function)] = njit(error_model="numpy")(function)
    return id(function)


def run_far(function: int, parameters: Bound, values: Bound, number: float) -> None:
    """Call a `far_kernel` from Python."""
    _functions[function](parameters, values, number)


def _call_python(function: int, parameters: int, values: Any, number: float) -> None:
    _functions[function](_bounds[parameters], Bound(values), number)


@njit
def call_far(function: int, parameters: int, values: Any, number: float) -> None:
    """In a kernel: call a `far_kernel` through Python."""
    with objmode():
        _call_python(function, parameters, values, number)
