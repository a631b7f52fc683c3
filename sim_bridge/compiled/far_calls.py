"""Kernels that are compiled on their own and called by address.

The plant's kernel calls the vortex lattice so: the caller neither contains nor compiles it, and a vehicle without it
does not wait for its compilation.
"""

from __future__ import annotations

import ctypes
from collections.abc import Callable
from typing import Any, cast

from llvmlite import ir
from numba import types
from numba.core import cgutils
from numba.core.ccallback import CFunc
from numba.extending import intrinsic

from sim_bridge.compiled.decorators import FASTMATH
from sim_bridge.compiled.kernel_cache import KernelCache
from sim_bridge.compiled.packed_bound import Bound

Far = Callable[[Any, Any, float], None]
_FUNCTION = ctypes.CFUNCTYPE(None, ctypes.c_void_p, ctypes.c_void_p, ctypes.c_double)
_compiled: dict[Any, Any] = {}


def far_kernel(function: Far, parameters: Bound, values: Bound) -> int:
    """Return the address of ``function``, compiled on its own, for `call_far`.

    Its arguments are two `Bound`, of tuples of the same types as ``parameters`` and ``values``, and a number.
    """
    kinds = parameters._numba_type_, values._numba_type_
    if (function, kinds) not in _compiled:
        options: dict[str, Any] = {"_nrt": False, "error_model": "numpy", "fastmath": set(FASTMATH)}
        compiled: Any = CFunc(function, ((*kinds, types.float64), types.void), locals={}, options=options)
        compiled._cache = KernelCache(function, options)
        compiled.compile()
        _compiled[function, kinds] = compiled
    return int(_compiled[function, kinds].address)


def run_far(function: int, parameters: Bound, values: Bound, number: float) -> None:
    """Call a `far_kernel` from Python."""
    _FUNCTION(function)(parameters.address, values.address, number)


@intrinsic
def _call(typing: Any, function: types.Type, parameters: types.Type, values: types.Type, number: types.Type) -> Any:
    def write(context: Any, builder: ir.IRBuilder, signature: Any, arguments: Any) -> Any:
        pointer = ir.IntType(8).as_pointer()
        stored = cgutils.alloca_once(builder, context.get_value_type(values))
        builder.store(arguments[2], stored)
        kind = ir.FunctionType(ir.VoidType(), [pointer, pointer, ir.DoubleType()])
        called = builder.inttoptr(arguments[0], kind.as_pointer())
        builder.call(
            called, [builder.inttoptr(arguments[1], pointer), builder.bitcast(stored, pointer), arguments[3]]
        )
        return context.get_dummy_value()

    return types.void(function, parameters, values, types.float64), write


call_far: Callable[[int, int, Any, float], None] = cast(Any, _call)
"""In a kernel: call the `far_kernel` at an address, with the address of a `Bound`, a tuple and a number."""
