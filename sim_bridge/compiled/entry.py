"""Entry points of compiled kernels."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, TypeVar

import numba

from sim_bridge.compiled.mode import PLAIN

Function = TypeVar("Function", bound=Callable[..., object])


def entry_point(function: Function, *arguments: Any) -> Function:
    """Return a kernel compiled for arguments of these types; a call does not look up the types again.

    A call of the kernel itself takes 0.4 us longer. It is compiled here, if the cache lacks it. Nothing checks the
    types of a call: a `Bound` must be of values of the same types.
    """
    if PLAIN:
        return function
    kinds = tuple(numba.typeof(argument) for argument in arguments)
    dispatcher: Any = function
    dispatcher.compile(kinds)
    compiled: Function = dispatcher.overloads[kinds].entry_point
    return compiled
