"""Decorators that compile functions with numba, cached on disk.

`exact`, `exact_inlined` and `njit` round each operation as Python does. The others allow the compiler to reorder sums
and to contract a product and a sum; not-a-number propagates. In all but `njit` a division by zero gives an infinity,
as in NumPy.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, TypeVar, cast, overload

import numba

from sim_bridge.compiled.mode import PLAIN

if PLAIN:
    from sim_bridge.compiled.cache import use_public_cache

    use_public_cache()

    def compile_for_callers(kernel: Any, *examples: object) -> None:
        """Do nothing: kernels are compiled at their first call."""

else:
    from sim_bridge.compiled import compiler_flags
    from sim_bridge.compiled.dispatcher import KernelDispatcher, compile_for_callers
    from sim_bridge.compiled.internal_linkage import use_internal_linkage

    compiler_flags.install()
    use_internal_linkage()

Function = TypeVar("Function", bound=Callable[..., object])
FASTMATH = frozenset({"contract", "arcp", "nsz", "reassoc", "afn"})
"""LLVM's flags: all of fastmath but those that assume that no number is infinite or not a number"""
_PUBLIC = ("nogil",)
"""options that numba documents"""


@overload
def njit(function: Function, /) -> Function: ...


@overload
def njit(*signature: Any, cache: bool = True, **options: Any) -> Callable[[Function], Function]: ...


def njit(*signature: Any, cache: bool = True, **options: Any) -> Any:
    """Compile as `numba.njit` does, with its arguments; the cache's key covers imported files, see `cache`."""
    if signature and callable(signature[0]) and not isinstance(signature[0], numba.types.Type):
        return _cached(signature[0], (), cache, options)
    return lambda function: _cached(function, signature, cache, options)


def _cached(function: Function, signature: tuple[Any, ...], cache: bool, options: dict[str, Any]) -> Any:
    if PLAIN or not cache:
        return cast(Any, numba.njit)(*signature, cache=cache, **options)(function)
    dispatcher = KernelDispatcher.of(cast(Any, numba.njit)(**options)(function))
    if signature:
        dispatcher.compile(signature[0])
        dispatcher.disable_compile()
    return dispatcher


def _compile(function: Function, fastmath: frozenset[str] = FASTMATH, **options: Any) -> Function:
    if PLAIN:
        options = {name: value for name, value in options.items() if name in _PUBLIC}
    else:
        # A kernel allocates nothing, so it needs no reference counts.
        options |= {"_nrt": False, "no_cfunc_wrapper": True}
    compiled: Function = njit(error_model="numpy", fastmath=set(fastmath), **options)(function)
    return compiled


def _is_private(function: Callable[..., object]) -> bool:
    return function.__name__.startswith("_")


def kernel(function: Function) -> Function:
    """Compile a function that Python and other kernels call."""
    return _compile(function)


def exact(function: Function) -> Function:
    """Compile a `kernel` that rounds each operation as Python does; a private one is also `internal`."""
    return _compile(function, fastmath=frozenset(), no_cpython_wrapper=_is_private(function))


def exact_inlined(function: Function) -> Function:
    """Compile an `inlined` kernel that rounds each operation as Python does."""
    return _compile(function, fastmath=frozenset(), forceinline=True, no_cpython_wrapper=_is_private(function))


def nogil_kernel(function: Function) -> Function:
    """Compile a `kernel` that releases the global interpreter lock: for long ones."""
    return _compile(function, nogil=True)


def internal(function: Function) -> Function:
    """Compile a `kernel` that only kernels call: without the wrapper that unpacks Python arguments."""
    return _compile(function, no_cpython_wrapper=True)


def inlined(function: Function) -> Function:
    """Compile a `kernel` that is inlined into its compiled callers; a private one is also `internal`.

    Pass parts and not a whole structure: an argument costs registers for all that is in it.
    """
    return _compile(function, forceinline=True, no_cpython_wrapper=_is_private(function))


def inlined_internal(function: Function) -> Function:
    """Compile an `inlined` kernel that kernels of other files call and Python does not."""
    return _compile(function, forceinline=True, no_cpython_wrapper=True)


def noalias(function: Function) -> Function:
    """Compile an `inlined` kernel whose array arguments do not overlap in memory; nothing checks that.

    The compiler then keeps in registers what it has read, and vectorizes loops over the arrays.
    """
    return _compile(function, forceinline=True, noalias=True, no_cpython_wrapper=_is_private(function))


__all__ = [
    "FASTMATH",
    "compile_for_callers",
    "exact",
    "exact_inlined",
    "inlined",
    "inlined_internal",
    "internal",
    "kernel",
    "njit",
    "noalias",
    "nogil_kernel",
]
