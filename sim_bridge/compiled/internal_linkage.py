"""Compiled kernels that run the copies of callees of their own module.

numba places the code of every callee in its caller's module, optimizes it there, and leaves it under the callee's
name with a linkage by which the linker keeps one copy of a name: that of the module that was loaded first. Copies
differ in the last digits, because sums are reordered by the code around them. A flight would depend on what the
process had computed before, and on whether its kernels came from the compiler or from the cache. Internal linkage
makes a module use its own copies.
"""

from __future__ import annotations

from typing import Any

from llvmlite.binding import Linkage
from numba.core.codegen import CPUCodeLibrary

_library: Any = CPUCodeLibrary


def use_internal_linkage() -> None:
    """Change numba in this process; kernels that are compiled or loaded already stay as they are."""
    finalize = _library._finalize_final_module

    def finalize_with_internal_linkage(library: Any) -> None:
        """Turn an optimized module into machine code; what was linked into it becomes visible to itself alone."""
        functions = library._final_module.functions
        copies = [each for each in functions if not each.is_declaration and each.linkage == Linkage.linkonce_odr]
        if copies:
            # The module that others link is made first: in it the same copies must be one.
            library._finalized = True
            library._get_module_for_linking()
            library._finalized = False
        for each in copies:
            each.linkage = Linkage.internal
        finalize(library)

    _library._finalize_final_module = finalize_with_internal_linkage
