"""numba's dispatcher without machine code for kernels that only other kernels call.

numba gives every compiled function machine code and a wrapper that unpacks Python arguments. A caller uses neither:
it links the intermediate code of its callees. Here a function that a kernel calls is compiled to intermediate code
alone, and compiled again with both at its first call from Python. A kernel must not call itself.
"""

from __future__ import annotations

from typing import Any, cast

import numba
from numba.core import event
from numba.core.compiler import Flags, compile_extra
from numba.core.compiler_lock import global_compiler_lock
from numba.core.registry import CPUDispatcher
from numba.core.sigutils import normalize_signature

from sim_bridge.compiled.callee_library import CalleeLibrary
from sim_bridge.compiled.kernel_cache import CalleeCache, KernelCache
from sim_bridge.compiled.pauses import fewer_collections


class KernelDispatcher(cast(Any, CPUDispatcher)):  # type: ignore[misc]
    """Compiled forms of a function, by the types of its arguments."""

    _callee_cache: Any
    _called_by_kernel = False

    def __init__(self, *arguments: Any, **keywords: Any) -> None:
        """Build a dispatcher as numba does, for instance from a pickled one."""
        super().__init__(*arguments, **keywords)
        self._use_kernel_caches()

    @classmethod
    def of(cls, dispatcher: Any) -> KernelDispatcher:
        """Turn numba's ``dispatcher`` into one with the caches of `kernel_cache`."""
        dispatcher.__class__ = cls
        dispatcher._use_kernel_caches()
        return cast(KernelDispatcher, dispatcher)

    def _use_kernel_caches(self) -> None:
        self._cache = KernelCache(self.py_func, self.targetoptions)
        self._callee_cache = CalleeCache(self.py_func, self.targetoptions)

    def get_call_template(self, args: Any, kws: Any) -> Any:
        """Compile for a kernel that calls this one, see `Dispatcher`."""
        self._called_by_kernel = True
        try:
            return super().get_call_template(args, kws)
        finally:
            self._called_by_kernel = False

    @global_compiler_lock
    def compile(self, sig: Any) -> Any:
        """Load or compile the form for ``sig``, see `Dispatcher`."""
        called_by_kernel, self._called_by_kernel = self._called_by_kernel, False
        with fewer_collections():
            return self._compile(sig, called_by_kernel)

    def _compile(self, sig: Any, called_by_kernel: bool) -> Any:
        arguments, result = normalize_signature(sig)
        present = self.overloads.get(tuple(arguments))
        if called_by_kernel:
            return (present or self._callee(sig, arguments, result)).entry_point
        if present is None or not isinstance(present.library, CalleeLibrary):
            return super().compile(sig)
        del self.overloads[tuple(arguments)]
        try:
            return super().compile(sig)
        except BaseException:
            self.overloads[tuple(arguments)] = present
            raise

    def get_compile_result(self, sig: Any) -> Any:
        """Form with an address, for functions passed as arguments; see `Dispatcher`."""
        present = self.overloads.get(tuple(sig.args))
        if present is not None and isinstance(present.library, CalleeLibrary):
            self.compile(sig)
        return super().get_compile_result(sig)

    def _callee(self, sig: Any, arguments: Any, result: Any) -> Any:
        """Load or compile intermediate code; code with a wrapper in the cache does as well."""
        context = self.targetctx
        compiled = self._callee_cache.load_overload(sig, context) or self._cache.load_overload(sig, context)
        if compiled is not None and not isinstance(compiled.library, CalleeLibrary):
            context.insert_user_function(compiled.entry_point, compiled.fndesc, [compiled.library])
            self.add_overload(compiled)
            return compiled
        if compiled is None:
            details = {"dispatcher": self, "args": arguments, "return_type": result}
            with event.trigger_event("numba:compile", data=details), self._compiling_counter:
                compiled = self._compile_callee(arguments, result)
            self._callee_cache.save_overload(sig, compiled)
        compiled = compiled._replace(entry_point=object())  # numba's key of this form
        context.insert_user_function(compiled.entry_point, compiled.fndesc, [compiled.library])
        self.overloads[tuple(arguments)] = compiled
        return compiled

    def _compile_callee(self, arguments: Any, result: Any) -> Any:
        compiler = self._compiler
        flags: Any = Flags()
        self.targetdescr.options.parse_as_flags(flags, self.targetoptions)
        flags.no_cpython_wrapper = flags.no_cfunc_wrapper = flags.no_compile = True
        library = CalleeLibrary(self.targetctx.codegen(), self.py_func.__qualname__)
        compiled = compile_extra(
            self.typingctx, self.targetctx, self.py_func, arguments, result, flags,
            compiler.locals, library=library, pipeline_class=compiler.pipeline_class,
        )  # fmt: skip
        library._ensure_finalized()
        reload_init = getattr(library, "_reload_init", compiled.reload_init)  # numba 0.60 has it in the result
        return compiled._replace(reload_init=list(reload_init))


def compile_for_callers(kernel: Any, *examples: object) -> None:
    """Compile ``kernel`` for kernels that call it with arguments of the types of ``examples``, if it is compiled."""
    if isinstance(kernel, KernelDispatcher):
        with global_compiler_lock:
            kernel.get_call_template(tuple(numba.typeof(one) for one in examples), {})
