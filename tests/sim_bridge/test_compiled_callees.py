"""Kernels that other kernels call have no machine code of their own until Python calls them."""

from __future__ import annotations

import os
import subprocess
import sys
from pathlib import Path
from typing import Any

import pytest
from numba import types

from sim_bridge.compiled import PLAIN, njit, on_compilation

pytestmark = pytest.mark.skipif(PLAIN, reason="public numba compiles everything")


def is_callee(function: Any) -> bool:
    """Whether the one compiled form of a kernel is intermediate code alone."""
    (compiled,) = function.overloads.values()
    return type(compiled.library).__name__ == "CalleeLibrary"


def test_a_callee_gets_machine_code_at_its_first_call_from_python() -> None:
    @njit
    def twice(x: float) -> float:
        return 2.0 * x

    @njit
    def more(x: float) -> float:
        return twice(x) + 1.0

    assert more(3.0) == 7.0 and is_callee(twice) and not is_callee(more)
    assert twice(4.0) == 8.0 and not is_callee(twice)
    assert more(5.0) == 11.0

    @njit
    def other(x: float) -> float:
        return twice(x) + more(x)

    with on_compilation(compiled := [].append):
        assert other(1.0) == 5.0
    assert compiled.__self__ == ["other"]


def test_callees_may_be_passed_as_arguments() -> None:
    @njit
    def squared(x: float) -> float:
        return x * x

    @njit
    def both(x: float) -> float:
        return squared(x) + x

    @njit(types.float64(types.FunctionType(types.float64(types.float64)), types.float64))
    def applied(function: Any, x: float) -> float:
        return function(x)

    assert both(2.0) == 6.0
    assert applied(squared, 3.0) == 9.0


PROGRAM = """
from sim_bridge.compiled import njit, on_compilation
from kernels_of_a_test import inner, outer
with on_compilation(print):
    assert {first} == 5.0
"""
KERNELS = """
from sim_bridge.compiled import njit
@njit
def inner(x):
    return x + 1.0
@njit
def outer(x):
    return inner(x) + 1.0
"""


@pytest.mark.validate
def test_the_cache_has_both_forms(tmp_path: Path) -> None:
    (tmp_path / "kernels_of_a_test.py").write_text(KERNELS)
    path = os.pathsep.join([str(tmp_path), *(entry for entry in sys.path if entry)])
    environment = os.environ | {"WINGBEAT_CACHE": str(tmp_path / "cache"), "PYTHONPATH": path}

    def compiled(first: str) -> list[str]:
        command = [sys.executable, "-c", PROGRAM.format(first=first)]
        ran = subprocess.run(command, env=environment, capture_output=True, text=True, cwd=tmp_path)
        assert ran.returncode == 0, ran.stderr
        return ran.stdout.split()

    assert compiled("outer(3.0)") == ["outer", "inner"]
    assert compiled("outer(3.0)") == []
    assert compiled("inner(4.0)") == ["inner"]
    assert compiled("inner(4.0)") == []


@pytest.mark.validate
def test_a_pickled_kernel_works_in_another_process(tmp_path: Path) -> None:
    """GIVEN a pickled kernel, WHEN another process calls it, THEN it and its callee come from the cache."""
    (tmp_path / "kernels_of_a_test.py").write_text(KERNELS)
    path = os.pathsep.join([str(tmp_path), *(entry for entry in sys.path if entry)])
    environment = os.environ | {"WINGBEAT_CACHE": str(tmp_path / "cache"), "PYTHONPATH": path}
    write = "import pickle; from kernels_of_a_test import outer; outer(1.0); pickle.dump(outer, open('kernel', 'wb'))"
    read = (
        "import pickle; from sim_bridge.compiled import njit, on_compilation\n"
        "kernel = pickle.load(open('kernel', 'rb'))\n"
        "@njit(cache=False)\ndef more(x):\n    return kernel(x) + 1.0\n"
        "with on_compilation(print):\n    assert kernel(2.0) == 4.0 and more(2.0) == 5.0\n"
    )
    for program, compiled in (write, ""), (read, "more\n"):
        command = [sys.executable, "-c", program]
        ran = subprocess.run(command, env=environment, capture_output=True, text=True, cwd=tmp_path)
        assert ran.returncode == 0, ran.stderr
        assert ran.stdout == compiled
