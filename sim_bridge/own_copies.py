"""Compiled kernels that run their own copies of the kernels they call.

numba lays every callee's code into its caller's module, optimises it there, and leaves it under the callee's own
name with a linkage by which the linker keeps one copy of a name: that of whichever module was loaded first. Copies
differ in the last digits (sums are reordered by where they stand), so a flight's would depend on what the process had
computed before it, and on whether its kernels came from the compiler or from the cache. Here a module's copies are
its own.
"""

from __future__ import annotations

from importlib.metadata import version
from typing import Any

from llvmlite.binding import Linkage
from numba.core.codegen import CPUCodeLibrary

_library: Any = CPUCodeLibrary
_WITHIN = ("_finalize_final_module", "_get_module_for_linking")
"""numba's own, not promised to anyone: pyproject.toml admits releases that have them"""
if not all(hasattr(_library, name) for name in _WITHIN):
    raise ImportError(f"kernels cannot keep their own copies with numba {version('numba')}: install numba<0.69")
_emit = _library._finalize_final_module


def _emit_with_own_copies(library: Any) -> None:
    """Make an optimised module machine code, what was linked into it visible to itself alone."""
    functions = library._final_module.functions
    copies = [each for each in functions if not each.is_declaration and each.linkage == Linkage.linkonce_odr]
    if copies:
        # What others link is made before: among them the same copies are still one.
        library._finalized = True
        library._get_module_for_linking()
        library._finalized = False
    for each in copies:
        each.linkage = Linkage.internal
    _emit(library)


def keep_own_copies() -> None:
    """From now on, in this process; kernels that are compiled or loaded already stay as they are."""
    _library._finalize_final_module = _emit_with_own_copies
