"""Rotations and small vector kernels shared by the physics; quaternions are (w, x, y, z) of r_ned_from_frd."""

from __future__ import annotations

import hashlib
import os
import tempfile
from collections.abc import Callable
from pathlib import Path
from typing import Any, TypeVar, cast

import numba
import numpy as np
from llvmlite import ir
from numba import njit as njit  # for all who compile: by here the cache has its folder
from numba.core import cgutils
from numba.core.compiler import Flags
from numba.core.cpu import CPUTargetOptions
from numba.core.errors import TypingError
from numba.core.options import TargetOptions
from numba.extending import intrinsic
from numpy.typing import NDArray

from sim_bridge.own_copies import keep_own_copies

Floats = NDArray[np.float64]
Integers = NDArray[np.int64]
Places = NDArray[np.uint64]
"""indices: where a loop's first one has no sign, the compiler need not ask whether it counts from an array's end"""
Compiled = TypeVar("Compiled", bound=Callable[..., object])


CACHE_VARIABLE = "WINGBEAT_CACHE"
"""environment variable that moves the folder of compiled kernels and generated dialects"""


def _cache_folder() -> Path:
    """A folder of its own for every state of the sources.

    numba's cache looks at a kernel's own file alone: a change in another that it inlines would go unnoticed.
    """
    digest = hashlib.sha256()
    for path in sorted(Path(__file__).parent.rglob("*.py")):
        digest.update(path.read_bytes())
    root = os.environ.get(CACHE_VARIABLE) or os.environ.get("XDG_CACHE_HOME") or Path.home() / ".cache"
    folder = Path(root) / "wingbeat" / "kernels" / digest.hexdigest()[:16]
    try:
        folder.mkdir(parents=True, exist_ok=True)
    except OSError:
        pass
    else:
        if os.access(folder, os.W_OK):
            return folder
    return Path(tempfile.gettempdir()) / f"wingbeat-kernels-{os.getuid()}-{digest.hexdigest()[:16]}"


def _hash_of_flags(flags: Any) -> int:
    return hash((flags.forceinline, flags.noalias, flags.no_cpython_wrapper, flags.no_cfunc_wrapper, flags.nrt))


# numba looks its own functions up by the flags of who calls them, and all flags have one hash there: those of our
# kinds of kernels were compared name by name, for a twentieth of a compilation.
Flags.__hash__ = _hash_of_flags  # type: ignore[method-assign]
# numba has this flag, and no option that sets it.
CPUTargetOptions.noalias = cast(Any, TargetOptions).Mapping("noalias")
keep_own_copies()
if "NUMBA_CACHE_DIR" not in os.environ:
    numba.config.CACHE_DIR = str(_cache_folder())  # type: ignore[attr-defined]


def is_compiled(function: Callable[..., object]) -> bool:
    """Whether the cache holds a compiled form of a kernel; a kernel that is not is compiled at its first call."""
    module, name = function.__module__.rpartition(".")[2], function.__name__
    # The cache's folder is the kernel's own: another copy of the sources has another, with the same names in it.
    folder: str = function.stats.cache_path  # type: ignore[attr-defined]
    return any(Path(folder).glob(f"{module}.{name}-*.nbi"))


def _compile(function: Compiled, **options: Any) -> Compiled:
    # Kernels allocate nothing: without numba's reference counts a call with a hundred arrays is three times as fast.
    options |= {"_nrt": False, "error_model": "numpy"}
    fast = {"contract", "arcp", "nsz", "reassoc", "afn"}
    compiled: Compiled = njit(cache=True, fastmath=fast, **options)(function)
    return compiled


def kernel(function: Compiled) -> Compiled:
    """Compile with numba, cached on disk; sums may be reordered, but not-a-number still propagates."""
    return _compile(function, no_cfunc_wrapper=True)


def unlocked(function: Compiled) -> Compiled:
    """A `kernel` beside which other threads of Python go on: for long ones."""
    return _compile(function, no_cfunc_wrapper=True, nogil=True)


def inlined(function: Compiled) -> Compiled:
    """A `kernel` that is laid into its compiled callers: what passes many arrays copies none.

    Pass parts and not the whole: for the compiler an argument is as large as all that is in it.

    A private one (its name begins with an underscore) cannot be called from Python at all, not even by a test: its
    Python side, which takes as long to compile as itself, is left out.
    """
    private = function.__name__.startswith("_")
    return _compile(function, forceinline=True, no_cpython_wrapper=private, no_cfunc_wrapper=True)


def laid_in(function: Compiled) -> Compiled:
    """An `inlined` one that kernels of other files take too, and nobody calls from Python: without a Python side."""
    return _compile(function, forceinline=True, no_cpython_wrapper=True, no_cfunc_wrapper=True)


def apart(function: Compiled) -> Compiled:
    """An `inlined` one whose arrays lie apart: no number that it writes is read or written through another of them.

    The compiler then keeps in registers what it has read, and takes four strips of a loop at a time; nobody checks.
    """
    private = function.__name__.startswith("_")
    return _compile(function, forceinline=True, noalias=True, no_cpython_wrapper=private, no_cfunc_wrapper=True)


def inner(function: Compiled) -> Compiled:
    """A `kernel` that nobody calls from Python: without its Python side, long to compile for many arrays."""
    return _compile(function, no_cpython_wrapper=True, no_cfunc_wrapper=True)


@intrinsic
def _clear(typing: Any, array: Any) -> Any:
    if array.layout not in "CF":
        raise TypingError("clear takes a contiguous array")

    def write(context: Any, builder: ir.IRBuilder, signature: Any, arguments: Any) -> Any:
        view = context.make_array(array)(context, builder, arguments[0])
        cast(Any, cgutils).memset(builder, view.data, builder.mul(view.nitems, view.itemsize), 0)
        return context.get_dummy_value()

    return numba.types.void(array), write


clear: Callable[[Floats], None] = cast(Any, _clear)
"""In a kernel: set all numbers of a contiguous array to zero, in one call and not in one a row."""


@kernel
def cross(a: Floats, b: Floats, out: Floats) -> None:
    """``out = a x b`` for arrays of three; ``out`` may not be ``a`` or ``b``."""
    out[0] = a[1] * b[2] - a[2] * b[1]
    out[1] = a[2] * b[0] - a[0] * b[2]
    out[2] = a[0] * b[1] - a[1] * b[0]


@apart
def add_scaled(a: Floats, factor: float, b: Floats, out: Floats) -> None:
    """``out = a + factor b``, each (n,)."""
    for i in range(a.shape[0]):
        out[i] = a[i] + factor * b[i]


@inlined
def rotation(w: float, x: float, y: float, z: float, out: Floats) -> None:
    """Fill ``out`` (3, 3) with r_ned_from_frd of a quaternion that need not be of unit length."""
    s = 2.0 / (w * w + x * x + y * y + z * z)
    out[0, 0] = 1.0 - s * (y * y + z * z)
    out[0, 1] = s * (x * y - z * w)
    out[0, 2] = s * (x * z + y * w)
    out[1, 0] = s * (x * y + z * w)
    out[1, 1] = 1.0 - s * (x * x + z * z)
    out[1, 2] = s * (y * z - x * w)
    out[2, 0] = s * (x * z - y * w)
    out[2, 1] = s * (y * z + x * w)
    out[2, 2] = 1.0 - s * (x * x + y * y)
