"""Operations on whole arrays inside kernels."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, cast

import numpy as np
from numpy.typing import NDArray

from sim_bridge.compiled.decorators import njit
from sim_bridge.compiled.mode import PLAIN

if PLAIN:

    @njit
    def _clear(array: NDArray[np.float64]) -> None:
        array[:] = 0.0

else:
    from llvmlite import ir
    from numba import types
    from numba.core import cgutils
    from numba.core.errors import TypingError
    from numba.extending import intrinsic

    @intrinsic
    def _clear(typing: Any, array: Any) -> Any:
        if array.layout not in "CF":
            raise TypingError("clear takes a contiguous array")

        def write(context: Any, builder: ir.IRBuilder, signature: Any, arguments: Any) -> Any:
            view = context.make_array(array)(context, builder, arguments[0])
            cast(Any, cgutils).memset(builder, view.data, builder.mul(view.nitems, view.itemsize), 0)
            return context.get_dummy_value()

        return types.void(array), write


clear: Callable[[NDArray[np.float64]], None] = cast(Any, _clear)
"""In a kernel: set a contiguous array to zero by one memset."""
