"""numba's cache of compiled functions with the folders and keys of `cache`."""

from __future__ import annotations

import pickle
from collections.abc import Callable, Mapping
from contextlib import suppress
from pathlib import Path
from typing import Any

from numba.core.caching import CompileResultCacheImpl, FunctionCache, _CacheLocator
from numba.core.runtime.nrt import rtsys

from sim_bridge.compiled import callee_library
from sim_bridge.compiled.cache import create_folder, file_folder, source_digest


class _Locator(_CacheLocator):
    """Locator for numba: folder of a kernel, and the state of the sources it belongs to."""

    def __init__(self, function: Callable[..., object], path: Path) -> None:
        self._path, self._line = path, function.__code__.co_firstlineno

    def ensure_cache_path(self) -> None:
        create_folder(self._path)

    def get_cache_path(self) -> str:
        return str(file_folder(self._path) / source_digest(self._path))

    def get_source_stamp(self) -> str:
        return source_digest(self._path)

    def get_disambiguator(self) -> str:
        return str(self._line)

    @classmethod
    def from_function(cls, function: Callable[..., object], path: str) -> _Locator | None:
        file = Path(path)
        return cls(function, file.resolve()) if file.is_file() else None


class _Implementation(CompileResultCacheImpl):
    _locator_classes = [_Locator]


class _CalleeImplementation(_Implementation):
    def get_filename_base(self, fullname: str, abiflags: str) -> str:
        return f"callee-{super().get_filename_base(fullname, abiflags)}"

    def reduce(self, compiled: Any) -> Any:
        return callee_library.reduced(compiled)

    def rebuild(self, target_context: Any, payload: Any) -> Any:
        return callee_library.rebuilt(target_context, payload)


def _sorted_text(value: object) -> str:
    """Return the text of an option; the order of a set's elements differs between processes."""
    return repr(sorted(value) if isinstance(value, set | frozenset) else value)


class KernelCache(FunctionCache):
    """numba's cache of one function with our folder and key; one function may have several sets of options."""

    _impl_class = _Implementation

    def __init__(self, function: Callable[..., object], options: Mapping[str, Any]) -> None:
        """``options``: of the compiler, as numba's dispatcher has them."""
        super().__init__(function)
        self._options = tuple((name, _sorted_text(value)) for name, value in sorted(options.items()))

    def _index_key(self, signature: Any, codegen: Any) -> tuple[Any, ...]:
        return *super()._index_key(signature, codegen), self._options

    def load_overload(self, signature: Any, target_context: Any) -> Any:
        """Load a compiled kernel, without the tables of the compiler that numba fills before.

        They take a third of a second and import ``scipy.linalg``. Machine code needs the memory manager only; the
        compiler fills the tables itself if the cache has no such kernel.
        """
        rtsys.initialize(target_context)
        with self._guard_against_spurious_io_errors():
            return self._load_overload(signature, target_context)

    def _load_overload(self, signature: Any, target_context: Any) -> Any:
        key = self._index_key(signature, target_context.codegen())
        try:
            data = self._cache_file.load(key)
        except (AttributeError, ImportError, EOFError, pickle.UnpicklingError):
            # A kernel of a named tuple that no longer exists: its class cannot be unpickled.
            self._cache_file.flush()
            return None
        return None if data is None else self._impl.rebuild(target_context, data)

    def _save_overload(self, signature: Any, data: Any) -> None:
        # A full disk, or another process that removed the folder: the kernel is compiled again next time.
        with suppress(OSError):
            super()._save_overload(signature, data)


class CalleeCache(KernelCache):
    """Cache of a function's forms for kernels that call it, see `callee_library`."""

    _impl_class = _CalleeImplementation
