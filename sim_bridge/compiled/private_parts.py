"""Private parts of numba that this package uses; without them kernels use its public interface alone."""

from __future__ import annotations

import warnings
from importlib import import_module
from importlib.metadata import version

_PARTS: dict[str, tuple[str, ...]] = {
    "caching": (
        "CompileResultCacheImpl.get_filename_base",
        "CompileResultCacheImpl.reduce",
        "CompileResultCacheImpl.rebuild",
        "FunctionCache.load_overload",
        "FunctionCache._load_overload",
        "FunctionCache._save_overload",
        "FunctionCache._index_key",
        "FunctionCache._guard_against_spurious_io_errors",
        "IndexDataCacheFile.load",
        "IndexDataCacheFile.flush",
        "_CacheLocator",
    ),
    "ccallback": ("CFunc.compile", "CFunc.address"),
    "cgutils": ("alloca_once", "gep_inbounds", "is_not_null", "memset"),
    "codegen": (
        "CPUCodeLibrary._finalize_final_module",
        "CPUCodeLibrary._get_module_for_linking",
        "JITCodeLibrary._finalize_dynamic_globals",
        "JITCodeLibrary._ensure_finalized",
        "JITCodeLibrary._verify_declare_only_symbols",
    ),
    "compiler": (
        "CompileResult._find_referenced_environments",
        "Flags.no_compile",
        "compile_extra",
        "compile_result",
    ),
    "compiler_lock": ("global_compiler_lock",),
    "cpu": ("CPUTargetOptions.parse_as_flags",),
    "dispatcher": (
        "Dispatcher._rebuild",
        "Dispatcher.add_overload",
        "Dispatcher.get_call_template",
        "Dispatcher.get_compile_result",
    ),
    "event": ("trigger_event",),
    "options": ("TargetOptions.Mapping",),
    "registry": ("CPUDispatcher", "cpu_target"),
    "runtime.nrt": ("rtsys.initialize",),
    "sigutils": ("normalize_signature",),
}
"""names by the module of `numba.core`; pyproject.toml admits the releases that have them"""


def missing() -> list[str]:
    """Return the names of `_PARTS` that the installed numba does not have."""
    return [f"{module}.{name}" for module, names in _PARTS.items() for name in names if not _exists(module, name)]


def _exists(module: str, name: str) -> bool:
    try:
        part = import_module(f"numba.core.{module}")
        for word in name.split("."):
            part = getattr(part, word)
    except (ImportError, AttributeError):
        return False
    return True


def are_present() -> bool:
    """Return whether numba has all private parts; a warning names those that are missing."""
    names = missing()
    if names:
        warnings.warn(
            f"kernels run slower: numba {version('numba')} has no {', '.join(names)}; install numba<0.69",
            RuntimeWarning,
            stacklevel=2,
        )
    return not names
