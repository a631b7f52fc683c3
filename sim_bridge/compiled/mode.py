"""How kernels are compiled in this process: environment variables, read once at import."""

from __future__ import annotations

import os

import numba

from sim_bridge.compiled import private_parts

PLAIN_VARIABLE = "WINGBEAT_PLAIN_NUMBA"
"""environment variable: set to 1, kernels use the public interface of numba alone"""
CACHE_VARIABLE = "WINGBEAT_CACHE"
"""environment variable that moves the folder of compiled kernels and generated dialects"""

WITHOUT_JIT = bool(numba.config.DISABLE_JIT)  # type: ignore[attr-defined]
"""numba's own switch NUMBA_DISABLE_JIT: kernels run as Python functions"""
PLAIN = WITHOUT_JIT or os.environ.get(PLAIN_VARIABLE, "0") not in ("", "0") or not private_parts.are_present()
"""nothing private of numba is used: chosen by a switch, or because this release of numba lacks a part"""
