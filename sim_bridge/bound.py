"""Arguments of kernels that are unpacked once, and not at every call.

A vehicle's parameters and work space are a hundred and forty arrays. To find their types and to unpack them takes
numba half as long as a tick's physics; unpacked they are a structure of pointers and numbers, which is kept here and
given to kernels by its address.
"""

from __future__ import annotations

import ctypes
from collections.abc import Callable
from typing import Any, cast

import numba
import numpy as np
from llvmlite import ir
from numba import types
from numba.core import cgutils
from numba.core.registry import cpu_target
from numba.extending import NativeValue, intrinsic, models, register_model, unbox

from sim_bridge.vectors import kernel


class BoundType(types.Type):
    """numba's type of a `Bound`."""

    def __init__(self, values: types.Type) -> None:
        self.values = values
        super().__init__(name=f"Bound({values})")


class Bound:
    """Arrays and numbers, in tuples of tuples, as kernels take them; `bound_values` gives them back inside one.

    The arrays are shared with whoever made them; the numbers are those of now. What is compiled for named tuples is
    found on disk by whoever can import these: theirs is a module of the project.
    """

    def __init__(self, values: tuple[Any, ...]) -> None:
        """Unpack ``values``, which are kept as long as this is."""
        kind = numba.typeof(values)
        self.values, self._numba_type_ = values, BoundType(kind)
        context = cpu_target.target_context
        self._memory = np.zeros(context.get_abi_sizeof(context.get_value_type(kind)), np.uint8)
        self.address = int(self._memory.ctypes.data)
        """of the structure"""
        _unpack(self.address, values)

    def __reduce__(self) -> tuple[type[Bound], tuple[Any, ...]]:
        """Copies are made anew, of copied arrays: the structure points at those of this one."""
        return Bound, (self.values,)


@register_model(BoundType)
class _Address(models.OpaqueModel):
    """In a kernel nothing but an address."""


@unbox(BoundType)
def _unbox(kind: BoundType, bound: Any, c: Any) -> NativeValue:
    number = c.pyapi.object_getattr_string(bound, "address")
    address = c.pyapi.long_as_ulonglong(number)
    c.pyapi.decref(number)
    pointer = c.builder.inttoptr(address, c.context.get_value_type(kind))
    return NativeValue(pointer, is_error=cgutils.is_not_null(c.builder, c.pyapi.err_occurred()))


@intrinsic
def _values(typing: Any, bound: BoundType) -> Any:

    def read(context: Any, builder: ir.IRBuilder, signature: Any, arguments: Any) -> Any:
        kind = context.get_value_type(signature.return_type)
        return _loaded(builder, builder.bitcast(arguments[0], kind.as_pointer()), kind)

    return bound.values(bound), read


bound_values: Callable[[Bound], Any] = cast(Any, _values)
"""In a kernel: what a `Bound` was made of."""


def _loaded(builder: ir.IRBuilder, place: Any, kind: ir.Type) -> Any:
    """The value at ``place``, member by member: those that a kernel does not ask for are never read.

    What a kernel writes changes none of them, so that each may be read where it is needed; who calls it writes them
    before.
    """
    if not isinstance(kind, ir.LiteralStructType | ir.ArrayType):
        value = builder.load(place)
        value.set_metadata("invariant.load", builder.module.add_metadata([]))
        return value
    whole = ir.Constant(kind, ir.Undefined)
    members = kind.elements if isinstance(kind, ir.LiteralStructType) else [kind.element] * kind.count
    for i, member in enumerate(members):
        whole = builder.insert_value(whole, _loaded(builder, cgutils.gep_inbounds(builder, place, 0, i), member), i)
    return whole


@intrinsic
def _call(typing: Any, function: types.Type, parameters: types.Type, values: types.Type, number: types.Type) -> Any:
    def write(context: Any, builder: ir.IRBuilder, signature: Any, arguments: Any) -> Any:
        pointer = ir.IntType(8).as_pointer()
        place = cgutils.alloca_once(builder, context.get_value_type(values))
        builder.store(arguments[2], place)
        kind = ir.FunctionType(ir.VoidType(), [pointer, pointer, ir.DoubleType()])
        called = builder.inttoptr(arguments[0], kind.as_pointer())
        builder.call(called, [builder.inttoptr(arguments[1], pointer), builder.bitcast(place, pointer), arguments[3]])
        return context.get_dummy_value()

    return types.void(function, parameters, values, types.float64), write


call_far: Callable[[int, int, Any, float], None] = cast(Any, _call)
"""In a kernel: call the `far_kernel` at an address, with a `Bound`'s address, a tuple and a number."""

FAR = ctypes.CFUNCTYPE(None, ctypes.c_void_p, ctypes.c_void_p, ctypes.c_double)
"""what a `far_kernel` is to Python"""


def far_kernel(function: Callable[[Any, Any, float], None], parameters: Bound, values: Bound) -> int:
    """Address of ``function`` compiled on its own, for `call_far`: who calls it neither compiles nor contains it.

    Its arguments are two `Bound`, of tuples of the same types as ``parameters`` and ``values``, and a number.
    """
    kinds = parameters._numba_type_, values._numba_type_
    if (function, kinds) not in _far:
        options: dict[str, Any] = {
            "_nrt": False,
            "error_model": "numpy",
            "fastmath": {"contract", "arcp", "nsz", "reassoc", "afn"},
        }
        _far[function, kinds] = numba.cfunc(types.void(*kinds, types.float64), cache=True, **options)(function)
    return int(_far[function, kinds].address)


_far: dict[Any, Any] = {}


@intrinsic
def _put(typing: Any, address: types.Type, values: types.Type) -> Any:
    def write(context: Any, builder: ir.IRBuilder, signature: Any, arguments: Any) -> Any:
        kind = context.get_value_type(values)
        builder.store(arguments[1], builder.inttoptr(arguments[0], kind.as_pointer()))
        return context.get_dummy_value()

    return types.void(address, values), write


_write: Callable[[int, Any], None] = cast(Any, _put)


@kernel
def _unpack(address: int, values: tuple[Any, ...]) -> None:
    _write(address, values)
