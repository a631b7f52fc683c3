"""The physics without numba's inside and without a compiler: the same numbers."""

from __future__ import annotations

import ast
import math
import os
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
from plant_bench import air, hold_position, vehicle

from sim_bridge.plant import Plant
from sim_bridge.vehicles import with_model

ROOT = Path(__file__).parents[2]
PRIVATE = ("numba.core", "llvmlite")
TICKS = 30


def last_state(name: str, model: str = "strip_theory", ticks: int = TICKS) -> list[float]:
    """The state after ``ticks`` of 5 ms of flapping."""
    plant = Plant(with_model(vehicle(name), model))
    plant.follow([hold_position(0.4 * math.sin(0.13 * i), 0.005) for i in range(ticks)], air())
    return [float(value) for value in plant.y]


def last_state_with(switch: str, *arguments: str | int) -> list[float]:
    """`last_state` in a process with an environment variable set to 1."""
    paths = [str(ROOT), str(ROOT / "tests"), str(ROOT / "tests" / "sim_bridge")]
    code = (
        f"import sys; sys.path[:0] = {paths!r}; import test_compiled_modes as t; print(*t.last_state(*{arguments!r}))"
    )
    environment = os.environ | {switch: "1"}
    answer = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, env=environment)
    assert answer.returncode == 0, answer.stderr
    return [float(word) for word in answer.stdout.split()]


def check(switch: str, *arguments: str | int) -> None:
    expected = last_state(*arguments)  # type: ignore[arg-type]
    np.testing.assert_allclose(last_state_with(switch, *arguments), expected, rtol=1e-8, atol=1e-10)


@pytest.mark.parametrize(
    ("name", "model"),
    [("robo_raven_ii_d", "strip_theory"), pytest.param("slow_hawk", "regression", marks=pytest.mark.validate)],
)
def test_kernels_run_as_python_functions_with_the_same_result(name: str, model: str) -> None:
    check("NUMBA_DISABLE_JIT", name, model)


@pytest.mark.validate  # minutes: numba compiles longer without the tricks, and Python is slow
@pytest.mark.parametrize("switch", ["NUMBA_DISABLE_JIT", "WINGBEAT_PLAIN_NUMBA"])
@pytest.mark.parametrize("model", ["strip_theory", "vortex_lattice"])
def test_every_mode_gives_the_same_result(switch: str, model: str) -> None:
    check(switch, "robo_raven_ii_d", model, 4)


@pytest.mark.parametrize(
    "switch", ["NUMBA_DISABLE_JIT", pytest.param("WINGBEAT_PLAIN_NUMBA", marks=pytest.mark.validate)]
)
def test_a_switch_leaves_numba_as_it_is(switch: str) -> None:
    code = (
        "from numba.core.codegen import CPUCodeLibrary as library; from numba.core.compiler import Flags; "
        "before = library._finalize_final_module, Flags.__hash__; import sim_bridge.plant; "
        "assert (library._finalize_final_module, Flags.__hash__) == before"
    )
    answer = subprocess.run(
        [sys.executable, "-c", code], capture_output=True, text=True, env=os.environ | {switch: "1"}, cwd=ROOT
    )
    assert answer.returncode == 0, answer.stderr


@pytest.mark.parametrize(
    "part", ["registry.CPUDispatcher", pytest.param("caching.CompileResultCacheImpl", marks=pytest.mark.validate)]
)
def test_kernels_use_public_numba_alone_where_a_private_part_is_missing(part: str) -> None:
    """GIVEN a numba without a part, WHEN a kernel is made, THEN a warning names the part and the kernel works."""
    module, _, name = part.partition(".")
    code = (
        f"import numba.core.{module} as module\ndel module.{name}\n"
        "from sim_bridge import compiled\nassert compiled.PLAIN\n"
        "double = compiled.njit(cache=False)(lambda x: 2.0 * x)\nprint(double(3.0))"
    )
    answer = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, cwd=ROOT)
    assert answer.stdout == "6.0\n", answer.stderr
    assert "RuntimeWarning" in answer.stderr and part in answer.stderr


def imports_of(path: Path) -> set[str]:
    """Names that a file imports; none of a file in which no private package is named."""
    source, names = path.read_bytes(), set[str]()
    if not any(package.partition(".")[0].encode() in source for package in PRIVATE):
        return names
    tree = ast.walk(ast.parse(source))
    for node in tree:
        if isinstance(node, ast.Import):
            names |= {alias.name for alias in node.names}
        elif isinstance(node, ast.ImportFrom) and node.module:
            names |= {node.module} | {f"{node.module}.{alias.name}" for alias in node.names}
    return names


def test_only_compiled_imports_the_inside_of_numba() -> None:
    packages = ("wingbeat", "avionics", "sim_bridge", "logs", "groundstation")
    files = [path for package in packages for path in (ROOT / package).rglob("*.py")]
    private = {
        path.relative_to(ROOT).parent.as_posix()
        for path in files
        if any(name == p or name.startswith(f"{p}.") for name in imports_of(path) for p in PRIVATE)
    }
    assert private == {"sim_bridge/compiled"}
