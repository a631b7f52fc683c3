"""Two changes to numba's compiler flags: a hash, and an option for a flag that has none."""

from __future__ import annotations

from typing import Any, cast

from numba.core.compiler import Flags
from numba.core.cpu import CPUTargetOptions
from numba.core.options import TargetOptions


def _hash_of_flags(flags: Any) -> int:
    return hash((flags.forceinline, flags.noalias, flags.no_cpython_wrapper, flags.no_cfunc_wrapper, flags.nrt))


def install() -> None:
    """Change numba in this process; kernels that are compiled or loaded already stay as they are."""
    # numba keeps its own functions in dictionaries by the flags of their caller, and all flags have one hash: those
    # of our kinds of kernels were compared name by name.
    Flags.__hash__ = _hash_of_flags  # type: ignore[method-assign]
    # numba has this flag, and no option that sets it.
    CPUTargetOptions.noalias = cast(Any, TargetOptions).Mapping("noalias")
