"""Arguments of kernels that are unpacked once and not at every call.

A vehicle's parameters and work space are 140 arrays in nested tuples. numba finds their types and unpacks them at
each call, which takes half as long as the physics of a tick. Here they are unpacked once into a structure of
pointers and numbers, and a kernel takes the address of that structure.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, cast

import numba
import numpy as np
from llvmlite import ir
from numba import types
from numba.core import cgutils
from numba.core.registry import cpu_target
from numba.extending import NativeValue, intrinsic, models, register_model, unbox

from sim_bridge.compiled.decorators import kernel


class BoundType(types.Type):
    """numba's type of a `Bound`."""

    def __init__(self, values: types.Type) -> None:
        self.values = values
        super().__init__(name=f"Bound({values})")


class Bound:
    """Arrays and numbers in nested tuples, unpacked for kernels; inside a kernel `bound_values` returns them.

    The arrays are shared with the caller; the numbers are copied. The cache stores the types of named tuples by name,
    so a kernel for them is found on disk only if their class is importable.
    """

    def __init__(self, values: tuple[Any, ...]) -> None:
        """Unpack ``values`` and keep a reference to them."""
        kind = numba.typeof(values)
        self.values, self._numba_type_ = values, BoundType(kind)
        context = cpu_target.target_context
        self._memory = np.zeros(context.get_abi_sizeof(context.get_value_type(kind)), np.uint8)
        self.address = int(self._memory.ctypes.data)
        """of the structure in memory"""
        _unpack(self.address, values)

    def __reduce__(self) -> tuple[type[Bound], tuple[Any, ...]]:
        """Build a copy from copied arrays; the structure of this one points at the original arrays."""
        return Bound, (self.values,)


@register_model(BoundType)
class _Address(models.OpaqueModel):
    """Representation in compiled code: a pointer without known contents."""


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
        return _load(builder, builder.bitcast(arguments[0], kind.as_pointer()), kind)

    return bound.values(bound), read


bound_values: Callable[[Bound], Any] = cast(Any, _values)
"""In a kernel: the arguments of a `Bound`."""


def _load(builder: ir.IRBuilder, pointer: Any, kind: ir.Type) -> Any:
    """Load the structure at ``pointer`` member by member; the compiler drops the loads that a kernel does not use.

    ``invariant.load`` asserts that no kernel writes to the structure, so each member is loaded next to its use.
    """
    if not isinstance(kind, ir.LiteralStructType | ir.ArrayType):
        value = builder.load(pointer)
        value.set_metadata("invariant.load", builder.module.add_metadata([]))
        return value
    value = ir.Constant(kind, ir.Undefined)
    members = kind.elements if isinstance(kind, ir.LiteralStructType) else [kind.element] * kind.count
    for i, member in enumerate(members):
        value = builder.insert_value(value, _load(builder, cgutils.gep_inbounds(builder, pointer, 0, i), member), i)
    return value


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
