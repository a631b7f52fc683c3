"""Optimized intermediate code of a kernel without machine code, and its form in the cache."""

from __future__ import annotations

from typing import Any

import llvmlite.binding as llvm
from numba.core.codegen import JITCodeLibrary
from numba.core.compiler import compile_result

_Library: Any = JITCodeLibrary


class CalleeLibrary(_Library):  # type: ignore[misc]
    """Optimized intermediate code of a function and its callees."""

    def _finalize_final_module(self) -> None:
        self._finalize_dynamic_globals()
        self._verify_declare_only_symbols()
        self._finalized = True


def reduced(compiled: Any) -> tuple[Any, ...]:
    """What the cache stores of a compiled callee."""
    library, description = compiled.library, compiled.fndesc
    code = library._get_module_for_linking().as_bitcode()
    description.typemap = description.calltypes = None  # neither needed nor always picklable
    environments = tuple(compiled._find_referenced_environments())
    return (
        library.name,
        code,
        description,
        compiled.environment,
        compiled.signature,
        compiled.reload_init,
        environments,
    )


def rebuilt(context: Any, stored: tuple[Any, ...]) -> Any:
    """Return the compiled callee that `reduced` has stored."""
    name, code, description, environment, signature, reload_init, environments = stored
    for function in reload_init:
        function()
    library = CalleeLibrary(context.codegen(), name)
    library._final_module = llvm.parse_bitcode(code)
    library._finalize_final_module()
    return compile_result(
        typing_context=context.typing_context, target_context=context, library=library, environment=environment,
        fndesc=description, signature=signature, objectmode=False, lifted=(), reload_init=reload_init,
        referenced_envs=environments,
    )  # fmt: skip
